"""Cell, arm and time around one robot program; a fault at its moment, and what came of it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tests.robot_programs.arm import Arm
from tests.robot_programs.cell import Cell
from vgrd.geometry import Pose

TURN = math.radians(3.0)
TAUGHT = Pose.from_rotvec((math.pi, 0.0, 0.0), (400.0, -30.0, 200.0))
# What the cell answers, um and urad: off the taught pose, and with words that fold to negative numbers.
COORDINATE = (405_250, -33_125, 203_500, 3_100_000, -20_000, 15_000)
START = Pose(TAUGHT.rotation, (420.0, -20.0, 450.0))
BOX_MM = 40.0  # each way from the taught pose
APPROACH_MM = 50.0
LONGEST_S = 60.0  # no program works for so long without a rest
NEAR_MM = 1e-3


def pose_of(coordinate: tuple[int, ...]) -> Pose:
    """The flange that an answer means."""
    x, y, z, rx, ry, rz = coordinate
    return Pose.from_rotvec((rx * 1e-6, ry * 1e-6, rz * 1e-6), (x * 1e-3, y * 1e-3, z * 1e-3))


def approach_of(coordinate: tuple[int, ...]) -> Pose:
    """Where the arm goes first: back along z of the flange."""
    goal = pose_of(coordinate)
    return Pose(goal.rotation, goal.translation - APPROACH_MM * goal.rotation[:, 2])


class When(StrEnum):
    """The moment of a fault."""

    START = "before anything"
    APPROACH = "on the way to the approach point"
    AT_APPROACH = "at the approach point"
    LAST_LEG = "in the last leg"


class Rest(StrEnum):
    """Where the arm stands in the end."""

    START = "where it was"
    BETWEEN = "between start and approach point"
    APPROACH = "at the approach point"
    POINT = "at the coordinate"
    ELSEWHERE = "somewhere else"


@dataclass(frozen=True)
class Outcome:
    """What a program did until it rested. asks: how often; told_s: from the fault to *stop commanded*."""

    word: str
    status: int
    asks: int
    rest: Rest
    told_s: float | None = None


class World:
    """Everything around one program. `fault` is applied once, when its moment has come."""

    def __init__(self, runtime_dir, when: When, fault: Callable[["World"], None]):
        self.cell = Cell(runtime_dir, COORDINATE)
        self.clock = self.cell.clock
        self.arm = Arm(self.clock, START)
        self.first_trig = 0  # the program counts on from it
        self.fault_s: float | None = None
        self._when, self._fault = when, fault
        self._end_s = self.clock.monotonic() + LONGEST_S
        self._stops_before = 0
        for _ in range(30):  # the cell has run for a while
            self.clock.sleep(0.02)
            self.cell.advance()
        if when is When.START:
            self._apply()
        self._asks_before = len(self.cell.trigs)

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.clock.sleep(seconds)
        assert self.clock.monotonic() < self._end_s, "the program never rests"
        self.cell.advance()
        if self.fault_s is None and self._has_come():
            self._apply()

    def grant(self, seconds: float) -> None:
        """So much time from now on."""
        self._end_s = self.clock.monotonic() + seconds

    def heal(self) -> None:
        """Somebody puts everything right."""
        self.cell.heal()
        self.arm.stuck = False
        self.arm.out_of_reach.clear()
        self.cell.advance()

    def outcome(self, word: str, status: int) -> Outcome:
        """What was done since the last outcome."""
        stops = self.arm.stops[self._stops_before :]
        asks = len(set(self.cell.trigs[self._asks_before :]))  # a signal may write a TRIG again
        self._stops_before, self._asks_before = len(self.arm.stops), len(self.cell.trigs)
        under_way = stops and self._when in (When.APPROACH, When.LAST_LEG)
        told_s = stops[0] - self.fault_s if under_way else None
        return Outcome(word, status if word == "STATUS" else 0, asks, self._rest(), told_s)

    def _apply(self) -> None:
        self.fault_s = self.clock.monotonic()
        self._fault(self)

    def _has_come(self) -> bool:
        leg, under_way = len(self.arm.goals), self.arm.progress > 0.2
        match self._when:
            case When.APPROACH:
                return leg == 1 and self.arm.moving and under_way
            case When.AT_APPROACH:
                return leg == 1 and not self.arm.moving
            case When.LAST_LEG:
                return leg == 2 and self.arm.moving and under_way
        return False

    def _rest(self) -> Rest:
        assert not self.arm.moving, "a program rests while the arm moves"
        flange = self.arm.flange.translation
        answered = self.cell.standing_coordinate
        for rest, pose in (
            (Rest.START, START),
            (Rest.APPROACH, approach_of(answered)),
            (Rest.POINT, pose_of(answered)),
        ):
            if np.linalg.norm(flange - pose.translation) < NEAR_MM:
                return rest
        way = approach_of(answered).translation - START.translation
        part = (flange - START.translation) @ way / (way @ way)
        off_mm = np.linalg.norm(START.translation + part * way - flange)
        return Rest.BETWEEN if 0 < part < 1 and off_mm < NEAR_MM else Rest.ELSEWHERE
