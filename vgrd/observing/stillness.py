"""Was the robot at rest, and where: pure judgement on flange readings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.devices import FlangeReading
from vgrd.errors import NotSteady, TooOld
from vgrd.geometry import Pose, log_rotation, nearest_rotation


@dataclass(frozen=True, slots=True)
class RestLimits:
    """How still is still: spread inside the window around an instant, and its length on both sides."""

    spread_mm: float = 0.05
    spread_rad: float = 2e-4
    before_s: float = 0.05
    after_s: float = 0.008
    minimum_readings: int = 3


def rest_pose(
    readings: Sequence[FlangeReading], stamp_s: float, limits: RestLimits | None = None
) -> Pose:
    """Mean flange pose in the window around `stamp_s`.

    Raises TooOld when the readings do not cover the window, NotSteady when the robot moved inside it.
    """
    limits = limits or RestLimits()
    start, end = stamp_s - limits.before_s, stamp_s + limits.after_s
    window = [r.base_from_wrist for r in readings if start <= r.stamp_s <= end]
    if len(window) < limits.minimum_readings or readings[-1].stamp_s < stamp_s:
        raise TooOld(
            f"{len(window)} flange readings cover the {1e3 * (end - start):.0f} ms around the picture, "
            f"{limits.minimum_readings} are needed: is the robot connected and fast enough?"
        )
    spread_mm, spread_rad = _spread(window)
    if spread_mm > limits.spread_mm or spread_rad > limits.spread_rad:
        raise NotSteady(
            f"the robot moved {spread_mm:.2f} mm, {1e3 * spread_rad:.1f} mrad around the picture: "
            "wait until it stands still"
        )
    return mean_pose(window)


def mean_pose(poses: Sequence[Pose]) -> Pose:
    """Arithmetic mean of translations and projected mean of rotations, for poses close together."""
    rotation = nearest_rotation(np.mean([pose.rotation for pose in poses], axis=0), tolerance=1e-2)
    return Pose(rotation, np.mean([pose.translation for pose in poses], axis=0))


def _spread(poses: Sequence[Pose]) -> tuple[float, float]:
    translations = np.array([pose.translation for pose in poses])
    reference = poses[0].rotation.T
    angles = [float(np.linalg.norm(log_rotation(reference @ pose.rotation))) for pose in poses[1:]]
    return float(np.ptp(translations, axis=0).max()), max(angles, default=0.0)
