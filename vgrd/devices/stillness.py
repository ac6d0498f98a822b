"""Was the robot at rest, and where: pure judgement on flange readings, at whatever rate they come.

The stamp of a reading is certain to half of the robot's period, since some robots refresh their
registers unseen. So a reading is surely from before (or after) an instant only when it is half a
period away from it. An arm that moved during an exposure stands elsewhere after it than before.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vgrd.devices import FlangeReading
from vgrd.devices.rate import LONGEST_PERIOD_S, distinct, reading_period_s
from vgrd.errors import NotSteady, TooOld
from vgrd.geometry import Pose, log_rotation, nearest_rotation

GAP_PERIODS = 4.0  # two readings lost, their neighbours late; the rate is known to 1/8
LEAST_GAP_S = 0.1  # of a fast robot on a busy machine; one of 10 Hz never sends more
MEAN_TOLERANCE = 1e-2  # chosen: a mean of rotations 0.2 mrad apart is a rotation to 1e-7
ROTATIONS_PER_STEP = 2.0  # one rotation from three rounded angles, each off by a step at most


@dataclass(frozen=True, slots=True)
class RestLimits:
    """How still is still: spread of the readings around an instant, and what "around" is.

    spread_mm is per axis; both grow by the steps in which the robot tells its pose. before_s:
    readings of this long before the picture are averaged and must agree. half_exposure_s: half of
    the longest exposure that is covered. minimum_readings: of different times, one of them after.
    """

    spread_mm: float = 0.05  # chosen: a tenth of the u95 (0.5 mm) at which answers are degraded
    spread_rad: float = 2e-4  # the same at the end of a tool of 250 mm
    before_s: float = 0.05  # chosen: six readings of a robot of 125 Hz
    half_exposure_s: float = 0.02  # exposures up to 40 ms, see docs/recording.md
    minimum_readings: int = 3  # two before and one after the exposure (decision 13)

    def of(self, reading: FlangeReading) -> tuple[float, float]:
        """How far from it, (mm per axis, rad), a reading is of the same rest."""
        return (
            self.spread_mm + reading.step_mm,
            self.spread_rad + ROTATIONS_PER_STEP * reading.step_rad,
        )


def rest_pose(
    readings: Sequence[FlangeReading], stamp_s: float, limits: RestLimits | None = None
) -> Pose:
    """Mean flange pose around a picture's `stamp_s`, from readings before and after its exposure.

    Raises TooOld when the readings do not cover the exposure, NotSteady when the robot moved.
    """
    limits = limits or RestLimits()
    certain_s = _certain_s(readings, limits)
    ordered, stamps = _ordered(readings)
    earlier = distinct(stamps[: bisect_right(stamps, stamp_s - certain_s)])
    last = bisect_left(stamps, stamp_s + certain_s)
    needed = limits.minimum_readings - 1
    if len(earlier) < needed or last == len(stamps):
        raise TooOld(
            f"the flange readings do not cover the picture: {len(earlier)} come before it ({needed} are "
            f"needed), {len(stamps) - last} after it: is the robot connected?"
        )
    first = bisect_left(stamps, min(earlier[-needed], stamp_s - limits.before_s))
    return _agreed(ordered[first : last + 1], reading_period_s(readings), limits)


def rest_pose_since(
    readings: Sequence[FlangeReading], since_s: float, limits: RestLimits | None = None
) -> Pose:
    """Mean flange pose of the newest readings, all of them from after `since_s`.

    Raises TooOld when there are not enough of them yet, NotSteady when the robot moved.
    """
    limits = limits or RestLimits()
    _certain_s(readings, limits)
    ordered, stamps = _ordered(readings)
    fresh = distinct(stamps[bisect_left(stamps, since_s) :])
    if len(fresh) < limits.minimum_readings or fresh[-1] - fresh[0] < limits.before_s:
        raise TooOld(
            f"{len(fresh)} flange readings came since, {limits.minimum_readings} of "
            f"{1e3 * limits.before_s:.0f} ms or more are needed: is the robot connected?"
        )
    begin_s = min(fresh[-limits.minimum_readings], fresh[-1] - limits.before_s)
    first = bisect_left(stamps, max(begin_s, since_s))
    return _agreed(ordered[first:], reading_period_s(readings), limits)


def is_covered(
    readings: Sequence[FlangeReading], stamp_s: float, limits: RestLimits | None = None
) -> bool:
    """Whether a reading is surely from after the exposure, so that `rest_pose` can judge it."""
    after_s = (limits or RestLimits()).half_exposure_s + 0.5 * reading_period_s(readings)
    return bool(readings) and readings[-1].stamp_s >= stamp_s + after_s


def is_apart(old: Pose, new: Pose, most_mm: float, most_rad: float) -> bool:
    """Whether two poses differ by more than so much per axis, or turn by more; angles are small."""
    turned = (new.rotation - old.rotation).ravel()
    # |R - S| (Frobenius) is sqrt(8) sin(angle / 2), for small angles sqrt(2) times the angle.
    if turned @ turned > 2.0 * most_rad**2:
        return True
    return bool(np.abs(new.translation - old.translation).max() > most_mm)


def mean_rest_pose(poses: Sequence[Pose]) -> Pose:
    """Arithmetic mean of translations and projected mean of rotations, for poses close together."""
    rotation = nearest_rotation(
        np.mean([pose.rotation for pose in poses], axis=0), tolerance=MEAN_TOLERANCE
    )
    return Pose(rotation, np.mean([pose.translation for pose in poses], axis=0))


def _certain_s(readings: Sequence[FlangeReading], limits: RestLimits) -> float:
    """How far from a picture's stamp a reading is surely outside of its exposure."""
    period_s = reading_period_s(readings)
    if period_s > LONGEST_PERIOD_S:
        raise TooOld(
            f"the robot sends a pose each {1e3 * period_s:.0f} ms, at least one each "
            f"{1e3 * LONGEST_PERIOD_S:.0f} ms is needed: raise its rate or the network's"
        )
    return limits.half_exposure_s + 0.5 * period_s


def _ordered(readings: Sequence[FlangeReading]) -> tuple[list[FlangeReading], list[float]]:
    """Readings by stamp, and the stamps: a better mapping of the clocks can set a stamp back."""
    ordered = sorted(readings, key=lambda reading: reading.stamp_s)
    return ordered, [reading.stamp_s for reading in ordered]


def _agreed(window: Sequence[FlangeReading], period_s: float, limits: RestLimits) -> Pose:
    """Mean pose of a window without gaps in which nothing moved."""
    longest_s = max(LEAST_GAP_S, GAP_PERIODS * period_s)
    gap_s = max(after.stamp_s - before.stamp_s for before, after in pairwise(window))
    if gap_s > longest_s:
        raise TooOld(
            f"no flange reading for {1e3 * gap_s:.0f} ms around the picture, "
            f"{1e3 * longest_s:.0f} ms at most are bridged: is the robot connected?"
        )
    poses = [reading.base_from_wrist for reading in window]
    spread_mm, spread_rad = _spread(poses)
    step_mm = max(reading.step_mm for reading in window)
    step_rad = max(reading.step_rad for reading in window)
    most_rad = limits.spread_rad + ROTATIONS_PER_STEP * step_rad
    if not (spread_mm <= limits.spread_mm + step_mm and spread_rad <= most_rad):
        raise NotSteady(
            f"the robot moved {spread_mm:.2f} mm, {1e3 * spread_rad:.1f} mrad around the picture: "
            "wait until it stands still"
        )
    return mean_rest_pose(poses)


def _spread(poses: Sequence[Pose]) -> tuple[float, float]:
    translations = np.array([pose.translation for pose in poses])
    reference = poses[0].rotation.T
    angles = [float(np.linalg.norm(log_rotation(reference @ pose.rotation))) for pose in poses[1:]]
    return float(np.ptp(translations, axis=0).max()), max(angles, default=0.0)
