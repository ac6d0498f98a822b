"""Where answers may send the arm: bounds of the cell, and of single targets."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, radians
from typing import Final

from vgrd.geometry import Array
from vgrd.model.arrays import frozen_array

MARGIN_MM: Final = 10.0  # chosen: ten times the u95 beyond which nothing is served by default
CONE_RAD: Final = radians(60)  # chosen: a tool that leans farther lies rather than stands


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """What a coordinate must satisfy; infinite where nothing is limited. Frame: the robot's base.

    lowest, highest: (3,) corners of a box, mm. inner_radius_mm, outer_radius_mm: from the base's z axis. Both
    for the flange, and for the tip where it is known. margin_mm: of the target's place, beyond where it can be as
    its object moves. cone_rad: of the tool's axis, against the taught approach. step_mm, step_rad: of the
    flange, against how it was taught.
    """

    lowest: Array = field(default_factory=lambda: frozen_array((-inf, -inf, -inf), 3))
    highest: Array = field(default_factory=lambda: frozen_array((inf, inf, inf), 3))
    inner_radius_mm: float = 0.0
    outer_radius_mm: float = inf
    margin_mm: float = MARGIN_MM
    cone_rad: float = CONE_RAD
    step_mm: float = inf
    step_rad: float = inf


@dataclass(frozen=True, slots=True, eq=False)
class CellBounds:
    """Bounds of the cell; targets: those of targets that have their own, by name."""

    cell: Bounds = field(default_factory=Bounds)
    targets: Mapping[str, Bounds] = field(default_factory=dict)

    def of(self, target: str) -> Bounds:
        """Those of a target."""
        return self.targets.get(target, self.cell)
