"""An arm in stepped time: flies straight, brakes, and takes one command at a time."""

import numpy as np

from vgrd.geometry import Pose

BRAKE_S = 0.1  # 50 mm/s at 0.5 m/s2


class Arm:
    """A flange, in mm. goals: where it was sent, in order. stops: when it was told to stop."""

    def __init__(self, clock, flange: Pose):
        self.clock = clock
        self.goals: list[Pose] = []
        self.stops: list[float] = []
        self.stuck = False  # the next move ends half-way, as when somebody else stops it
        self.out_of_reach: list[str] = []  # "coordinate", "approach"
        self._from = self._to = flange
        self._start_s = self._end_s = 0.0

    @property
    def moving(self) -> bool:
        """Whether it moves or brakes."""
        return self.clock.monotonic() < self._end_s

    @property
    def progress(self) -> float:
        """The part of the present move that is done."""
        if not self.moving:
            return 1.0
        return (self.clock.monotonic() - self._start_s) / (self._end_s - self._start_s)

    @property
    def flange(self) -> Pose:
        """Where it is."""
        part = self.progress
        translation = (1 - part) * self._from.translation + part * self._to.translation
        return Pose(self._to.rotation, translation)

    def move(self, goal: Pose, mm_s: float) -> None:
        """Start a move."""
        assert not self.moving, "a motion was commanded while another goes on"
        self.goals.append(goal)
        start = self.flange
        if self.stuck:
            self.stuck = False
            goal = Pose(goal.rotation, (start.translation + goal.translation) / 2)
        self._from, self._to = start, goal
        self._start_s = self.clock.monotonic()
        way_mm = float(np.linalg.norm(goal.translation - start.translation))
        self._end_s = self._start_s + way_mm / mm_s

    def stop(self) -> None:
        """Brake where it is."""
        self.stops.append(self.clock.monotonic())
        self._from = self._to = self.flange
        self._start_s = self.clock.monotonic()
        self._end_s = self._start_s + BRAKE_S
