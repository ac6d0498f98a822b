"""Robots of every rate: at rest is recorded, what moved during the exposure never is."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vgrd.cell.feeds import HISTORY_S
from vgrd.devices import FlangeReading
from vgrd.devices.rate import (
    LONGEST_PERIOD_S,
    catch_up_s,
    reading_period_s,
    silence_limit_s,
)
from vgrd.devices.stillness import RestLimits, is_covered, rest_pose, rest_pose_since
from vgrd.errors import NotSteady, TooOld
from vgrd.geometry import Pose

LIMITS = RestLimits()
START_S = 100.0
COUNT = 100  # of a fast robot the last readings are enough, and quicker to make
SPREAD_MM = 0.02  # noise of a robot at rest, below the limit of 0.05
STAMP_PERIODS = 0.2  # how far a stamp is off the time at which the pose was true

rates = st.floats(5.0, 500.0)
seeds = st.integers(0, 2**32 - 1)
shares = st.floats(0.0, 0.25)


class Robot:
    """Readings of HISTORY_S and more: late stamps, up to two lost in a row, some told twice."""

    def __init__(self, rate_hz: float, lost: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.period_s = 1.0 / rate_hz
        history_s = min(HISTORY_S, COUNT * self.period_s)
        count = int((history_s + 2.0) * rate_hz)
        ticks = np.arange(count) + rng.uniform() + (HISTORY_S - history_s) * rate_hz
        kept = rng.uniform(size=count) >= lost
        for k in range(2, count):
            kept[k] |= not kept[k - 1] and not kept[k - 2]
        self.true_s = START_S + self.period_s * ticks[kept]
        off = rng.uniform(-STAMP_PERIODS, STAMP_PERIODS, len(self.true_s))
        self.stamps_s = self.true_s + self.period_s * off
        self.twice = rng.uniform(size=len(self.true_s)) < 0.2
        self.rng = rng

    def tell(self, x_mm, until_s: float) -> list[FlangeReading]:
        """What the cell holds at `until_s` of an arm that stands at `x_mm(t)`."""
        told = []
        held = (self.stamps_s >= until_s - HISTORY_S) & (self.stamps_s <= until_s)
        for k in np.flatnonzero(held):
            true_s, stamp_s, twice = self.true_s[k], self.stamps_s[k], self.twice[k]
            pose = Pose.from_rotvec((0, 0, 0), (x_mm(true_s), 0, 0))
            told += [FlangeReading(pose, None, stamp_s, true_s)] * (1 + twice)
        return told


@settings(deadline=None, derandomize=True)
@given(rates, shares, st.floats(0.0, 1.0), seeds)
def test_an_arm_at_rest_is_recorded_at_every_rate(rate_hz, lost, phase, seed):
    robot = Robot(rate_hz, lost, seed)
    picture_s = START_S + HISTORY_S + phase * robot.period_s
    here = robot.tell(lambda _: 0.0, picture_s)
    later = robot.tell(
        lambda _: 7.0 + robot.rng.uniform(-SPREAD_MM, SPREAD_MM), picture_s + catch_up_s(here)
    )
    assert is_covered(later, picture_s)
    assert rest_pose(later, picture_s).translation[0] == pytest.approx(7.0, abs=SPREAD_MM)
    pressed_s = later[-1].stamp_s - max(LIMITS.before_s + 4 * robot.period_s, 7 * robot.period_s)
    assert rest_pose_since(later, pressed_s).translation[0] == pytest.approx(7.0, abs=SPREAD_MM)


@settings(deadline=None, derandomize=True)
@given(rates, shares, seeds, st.floats(-1, 1), st.floats(0.0, 1.0), st.floats(1.0, 400.0))
def test_a_move_during_the_exposure_is_never_accepted(rate_hz, lost, seed, at, length, factor):
    """From rest to rest: the arm moves by `factor` limits in some part of the exposure."""
    robot = Robot(rate_hz, lost, seed)
    picture_s = START_S + HISTORY_S
    half_s = LIMITS.half_exposure_s
    begin_s = picture_s + at * half_s * (1 - 1e-6)
    end_s = begin_s + length * (picture_s + half_s - begin_s) + 1e-9
    size_mm = 1.01 * factor * LIMITS.spread_mm

    def x_mm(t: float) -> float:
        return float(np.interp(t, [begin_s, end_s], [0.0, size_mm]))

    for wait_s in (0.5 * robot.period_s, 0.3, 1.5):
        told = robot.tell(x_mm, picture_s + wait_s)
        if told:
            with pytest.raises((NotSteady, TooOld)):
                rest_pose(told, picture_s)


@settings(deadline=None, derandomize=True)
@given(rates, shares, seeds)
def test_the_period_is_measured_whatever_is_lost_late_or_repeated(rate_hz, lost, seed):
    robot = Robot(rate_hz, lost, seed)
    found_s = reading_period_s(robot.tell(lambda _: 0.0, START_S + HISTORY_S))
    assert 0.75 * robot.period_s < found_s < 1.6 * robot.period_s


@settings(deadline=None, derandomize=True)
@given(rates, st.floats(0.0, 1.0))
def test_a_robot_that_answers_never_counts_as_lost(rate_hz, phase):
    robot = Robot(rate_hz, 0.0, 3)
    stamps = [stamp for stamp in robot.stamps_s if stamp > START_S + HISTORY_S]
    for last_s, next_s in list(pairwise(stamps))[:5]:
        limit_s = silence_limit_s(robot.tell(lambda _: 0.0, last_s))
        assert (next_s - last_s) * (1 + 0.3 * phase) < limit_s


@pytest.mark.parametrize(
    ("rate_hz", "limit_s"), [(500, 0.2), (125, 0.2), (20, 0.2), (10, 0.3), (5, 0.5), (0.5, 0.8)]
)
def test_a_lost_robot_is_told_after_two_periods_and_soon_where_it_is_fast(rate_hz, limit_s):
    readings = [FlangeReading(Pose.identity(), None, k / rate_hz, 0.0) for k in range(40)]
    assert silence_limit_s(readings) == pytest.approx(limit_s, abs=1e-6)


def test_a_robot_that_dies_right_after_its_start_is_lost_as_soon_as_a_fast_one():
    """Two or three readings, the last late: nothing tells yet that this robot is slow."""
    for stamps in ([0.0], [0.0, 0.3], [0.0, 0.008, 0.3]):
        readings = [FlangeReading(Pose.identity(), None, stamp, 0.0) for stamp in stamps]
        assert silence_limit_s(readings) == pytest.approx(0.2)


def test_a_robot_too_slow_to_show_short_moves_is_named_with_its_rate():
    readings = [FlangeReading(Pose.identity(), None, 0.5 * k, 0.0) for k in range(20)]
    with pytest.raises(TooOld, match="a pose each 500 ms, at least one each 350 ms"):
        rest_pose(readings, 5.0)
    assert reading_period_s(readings) > LONGEST_PERIOD_S


def test_a_gap_around_the_picture_is_not_bridged():
    readings = [
        FlangeReading(Pose.identity(), None, 0.1 * k, 0.0) for k in range(20) if not 9 < k < 14
    ]
    with pytest.raises(TooOld, match="no flange reading for 500 ms"):
        rest_pose(readings, 1.1)


def test_a_fast_robot_on_a_busy_machine_may_lose_what_a_slow_one_never_sends():
    def held(longest_s: float) -> list[FlangeReading]:
        return [
            FlangeReading(Pose.identity(), None, 0.008 * k, 0.0)
            for k in range(60)
            if not 0.2 < 0.008 * k < 0.2 + longest_s - 0.004
        ]

    rest_pose(held(0.09), 0.24)
    with pytest.raises(TooOld, match="100 ms at most are bridged"):
        rest_pose(held(0.13), 0.24)


def test_a_robot_that_tells_its_pose_in_steps_is_at_rest_while_the_last_digit_flickers():
    """0.1 mm and 0.1 degrees, as the registers of Doosan and xArm."""

    def read(k: int, x_mm: float, turn_rad: float) -> FlangeReading:
        pose = Pose.from_rotvec((0, 0, turn_rad), (x_mm, 0, 0))
        return FlangeReading(pose, None, 0.1 * k, 0.0, step_mm=0.1, step_rad=np.radians(0.1))

    flickers = [read(k, 0.1 * (k % 2), np.radians(0.1) * (k % 3 == 0)) for k in range(20)]
    assert 0.0 < rest_pose(flickers, 1.0).translation[0] < 0.1
    for moved_mm, turned_deg in ((0.2, 0.0), (0.0, 0.3)):
        moves = [
            read(k, moved_mm * (k > 10), np.radians(turned_deg) * (k > 10)) for k in range(20)
        ]
        with pytest.raises(NotSteady):
            rest_pose(moves, 1.05)
