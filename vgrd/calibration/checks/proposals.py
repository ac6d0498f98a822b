"""A motion that is missing, and the pose that makes it out of one that the robot had."""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose, exp_rotation

_TILT_DEG = 25.0  # large enough to tell an axis, small enough to keep the tag in view
_FLANGE = "xyz"


@dataclass(frozen=True, slots=True, eq=False)
class MissingMotion:
    """What to do next, because without it `rank` of `unknowns` are determined.

    code: hand_eye_motion, wrist_tilt, targets_in_line, few_touches, target_untouched, fixed_point_motion,
    surface_motion or object_turn. base_from_wrist: where to go, None where no motion of the robot is missing or its
    place is not known; target: what to touch there. essential: expected coordinates need it.
    """

    code: str
    sentence: str
    rank: int
    unknowns: int
    base_from_wrist: Pose | None = None
    target: str | None = None
    essential: bool = True


def tilted(pose: Pose, fixed_point_in_wrist: Array, used_axis: Array | None) -> tuple[Pose, str]:
    """The pose turned about a flange axis across `used_axis` (3,) of the base, a point kept; words."""
    k = 0 if used_axis is None else int(np.argmin(np.abs(pose.rotation.T @ used_axis)))
    R = pose.rotation @ exp_rotation(np.radians(_TILT_DEG) * np.eye(3)[k])
    t = pose @ fixed_point_in_wrist - R @ fixed_point_in_wrist
    return Pose(
        R, t
    ), f"tilt the wrist by about {_TILT_DEG:.0f} degrees about the flange's {_FLANGE[k]}"


def direction(axis: Array) -> str:
    """A vector (3,) in words."""
    x, y, z = axis
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
