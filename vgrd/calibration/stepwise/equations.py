"""Expected coordinates (paper Eq. 5, 6 and 16-19): where the flange must be for the tool to touch."""

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, log_rotation
from vgrd.judging.thresholds import SAME_ORIENTATION_RAD


def point_in_base_live(
    base_from_wrist: Pose,
    wrist_from_tag_a: Pose,
    camera_from_tag_a: Pose,
    camera_from_tag_b: Pose,
    point_in_tag_b: Array,
) -> Array:
    """Eq. 5: a point (3,) of the object in the base, through the live tag A; mm."""
    base_from_camera = base_from_wrist @ wrist_from_tag_a @ camera_from_tag_a.inverse()
    return (base_from_camera @ camera_from_tag_b) @ point_in_tag_b


def flange_for(point_in_base: Array, R_base_from_wrist: Array, tcp_in_wrist: Array) -> Array:
    """Eq. 6: flange position (3,) that puts the TCP on the point with the wrist so oriented.

    The orientation is the one the robot will have when it touches, not the one at the picture.
    """
    return np.asarray(point_in_base - R_base_from_wrist @ tcp_in_wrist)


def motion_about(
    camera_from_tag_now: Pose, camera_from_tag_ref: Pose, point_in_tag: Array
) -> Pose:
    """Q of the appendix, in the camera: rotation of the object since the reference picture.

    `translation` is how far the given point of the object moved, not the origin.
    """
    R_Q = camera_from_tag_now.rotation @ camera_from_tag_ref.rotation.T
    return Pose(R_Q, camera_from_tag_now @ point_in_tag - camera_from_tag_ref @ point_in_tag)


def moved_flange(
    R_base_from_camera: Array, Q: Pose, flange_ref: Array, pivot_flange_ref: Array
) -> Array:
    """Eq. 19 for a camera that stands still: flange (3,) for the target after the motion Q.

    flange_ref, pivot_flange_ref: p'_i and p'_f, both with the wrist's orientation at the touch.
    """
    turn = R_base_from_camera @ Q.rotation @ R_base_from_camera.T
    return np.asarray(
        turn @ (flange_ref - pivot_flange_ref)
        + pivot_flange_ref
        + R_base_from_camera @ Q.translation
    )


def special_expected(
    *,
    base_from_wrist_ref: Pose,
    base_from_wrist_now: Pose,
    tag_a_from_tag_b_ref: Pose,
    tag_a_from_tag_b_now: Pose,
    R_wrist_from_tag_a: Array,
    pivot_in_tag_b: Array,
    flange_ref: Array,
    pivot_flange_ref: Array,
) -> Array:
    """Eq. 16-19 with the displacement of the flange between the pictures (0) and (1); mm.

    Needs the rotation of the hand-eye only. Raises InputError when the wrist's orientation differs
    between the two pictures, for which Eq. 19 does not hold.
    """
    turn_rad = float(
        np.linalg.norm(log_rotation(base_from_wrist_now.rotation @ base_from_wrist_ref.rotation.T))
    )
    if turn_rad > SAME_ORIENTATION_RAD:
        raise InputError(
            f"the wrist is turned by {np.degrees(turn_rad):.3f} degrees against the reference "
            "picture: Eq. 19 needs one orientation; use the fixed camera's path"
        )
    Q = motion_about(tag_a_from_tag_b_now, tag_a_from_tag_b_ref, pivot_in_tag_b)
    R_base_from_tag_a = base_from_wrist_now.rotation @ R_wrist_from_tag_a
    displacement = base_from_wrist_now.translation - base_from_wrist_ref.translation
    return moved_flange(R_base_from_tag_a, Q, flange_ref, pivot_flange_ref) + displacement
