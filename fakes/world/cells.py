"""The fake cells by name: layout, controller, plan of the session, arm, and what has to fit into a hole."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from types import MappingProxyType

from fakes.world.layout import Layout, fruit, sampler
from fakes.world.world import CellNoise, World
from vgrd.errors import InputError
from vgrd.model import Plan

RTDE = "rtde"
DEFAULT = "default"


@dataclass(frozen=True, slots=True)
class CellKind:
    """One fake cell. controller: `RTDE`, or the robot profile whose Modbus registers show the arm."""

    name: str
    purpose: str
    layout: Callable[[], Layout]
    controller: str = RTDE
    plan: Plan = Plan.JOINT
    repeatability_mm: float = CellNoise().repeatability_mm

    def world(
        self, seed: int, speed_mm_s: float, turn_rad_s: float, *, perfect: bool = False
    ) -> World:
        """Its world; perfect: without touch noise and arm errors."""
        noise = CellNoise(repeatability_mm=self.repeatability_mm)
        return World(
            self.layout(),
            seed,
            CellNoise.none() if perfect else noise,
            speed_mm_s=speed_mm_s,
            turn_rad_s=turn_rad_s,
        )


CELLS: Mapping[str, CellKind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            CellKind(DEFAULT, "UR-like arm over a turntable, joint estimate", Layout),
            CellKind(
                "sampler",
                "the paper's experiment B: 4-axis arm, rotary sample changer, special method",
                sampler,
                plan=Plan.SPECIAL,
                repeatability_mm=0.04,  # of the paper's robot
            ),
            CellKind(
                "fruit",
                "the paper's experiment A: JAKA arm read over Modbus, tray of holes, universal method",
                fruit,
                controller="jaka",
                plan=Plan.UNIVERSAL,
            ),
        )
    }
)

CELL_HELP = f"which cell: {', '.join(CELLS)}"


def cell_called(name: str) -> CellKind:
    """The cell of that name; InputError with the known names, the likely one first."""
    if name not in CELLS:
        likely = get_close_matches(name, CELLS, n=1)
        hint = f"; did you mean {likely[0]!r}?" if likely else ";"
        raise InputError(f"there is no cell {name!r}{hint} there are: {', '.join(CELLS)}")
    return CELLS[name]
