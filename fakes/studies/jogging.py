"""An operator who only jogs and touches, in the simulated cell, and what the daemon's rule harvests of it.

He comes above a target, stops, turns the wrist where he tilts it, stops, touches, lifts and stops:
as somebody does who lets go of one key to press the next. He turns the table a few times meanwhile.
That a stop lasts for two pictures (a second) is a guess.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.harvest import Harvest, HarvestKind
from vgrd.geometry import Array, Pose
from vgrd.model import Observation, Plan, Recording, Touch

_ABOVE_MM = (60.0, 120.0)  # a guess: clear of the object, so that the way is seen
_BESIDE_MM = 20.0  # a guess: nobody comes exactly above
_LIFT_MM = 40.0  # a guess: clear of the hole
_PICTURES = 2  # of each stop


@dataclass(slots=True)
class Jogging:
    """The session so far; harvested samples are told apart from touches by where they are kept."""

    cell: Simulation
    harvested: dict[HarvestKind, list[Observation]] = field(
        default_factory=lambda: {kind: [] for kind in HarvestKind}
    )
    touches: list[Touch] = field(default_factory=list)
    harvest: Harvest = field(init=False)

    def __post_init__(self) -> None:
        self.harvest = Harvest(self.cell.facts())

    def stop(self, reported: Pose, angle_rad: float = 0.0) -> None:
        """Let the arm stand for a moment."""
        for seen in self.cell.watch(reported, angle_rad, _PICTURES):
            sample = self.harvest.consider(seen)
            if sample is not None:
                self.harvested[sample.kind].append(seen)
                self._give_back(sample.given_back)

    def turn(self, angles_rad: Sequence[float]) -> None:
        """Turn the table, the arm aside."""
        for angle in angles_rad:
            self.stop(self.cell.standing, angle)

    def touch(self, target: str, R: Array) -> None:
        """Come, turn the wrist to R (3, 3), touch and lift."""
        rng = self.cell.rng
        beside = rng.uniform(-_BESIDE_MM, _BESIDE_MM, 2)
        above = np.array([*beside, rng.uniform(*_ABOVE_MM)])
        self.stop(Pose(WORK_ROTATION, self.cell.flange(target, 0.0, WORK_ROTATION) + above))
        if not np.array_equal(R, WORK_ROTATION):
            self.stop(Pose(R, self.cell.flange(target, 0.0, R) + above))
        touch = self.cell.touch(target, R)
        self.touches.append(touch)
        if touch.observation is not None:
            self._give_back(self.harvest.note(touch.observation))
        away = -_LIFT_MM * R[:, 2]
        self.stop(Pose(R, touch.base_from_wrist.translation + away))

    def recording(self) -> Recording:
        """What the session holds in the end."""
        return Recording(
            session="jogged",
            plan=Plan.JOINT,
            facts=self.cell.facts(),
            looks=tuple(self.harvested[HarvestKind.LOOK]),
            spins=tuple(self.harvested[HarvestKind.SPIN]),
            touches=tuple(self.touches),
        )

    def _give_back(self, samples: Sequence[Observation]) -> None:
        for kind, kept in self.harvested.items():
            self.harvested[kind] = [one for one in kept if not any(one is s for s in samples)]


def jog_and_touch(cell: Simulation, wrists: Sequence[Array], turns: int) -> Recording:
    """A session of touches, one target after the other, with the table turned so often before them."""
    jogging = Jogging(cell)
    names = list(cell.targets)
    jogging.stop(cell.standing)
    jogging.turn([float(a) for a in np.linspace(0, 1.6 * np.pi, turns + 1)[1:]])
    for k, R in enumerate(wrists):
        jogging.touch(names[k % len(names)], R)
    return jogging.recording()


def without_harvest(recording: Recording) -> Recording:
    """The same with nothing but what was asked for: the touches."""
    return replace(recording, looks=(), spins=())
