"""Eq. 16, 19 and 20-25, letter by letter.

Nothing here is mended: the sign in Eq. 16, the flange that Eq. 19 takes to stand still, the inverse of Eq. 25 that a
turntable does not have. What serves is in `vgrd.calibration.stepwise` and `vgrd.calibration.turntable`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose


@dataclass(frozen=True, slots=True, eq=False)
class PrintedCenter:
    """Eq. 25: center_in_tag (3,) mm; condition: of the matrix that it inverts, R_D^T R_D."""

    center_in_tag: Array
    condition: float


def equation_25(camera_from_tag: Sequence[Pose]) -> PrintedCenter:
    """Rotation centre by the normal equations of Eq. 21-24, the first picture subtracted from the others.

    Raises TooFewObservations below 2 pictures, NotObservable where the matrix is singular to the last digit.
    """
    if len(camera_from_tag) < 2:
        raise TooFewObservations(
            f"Eq. 21 needs at least 2 pictures of the turned object, got {len(camera_from_tag)}"
        )
    first, *others = camera_from_tag
    R_delta = np.concatenate([pose.rotation - first.rotation for pose in others])
    t_delta = np.concatenate([-pose.translation + first.translation for pose in others])
    normal = R_delta.T @ R_delta
    try:
        center = np.linalg.inv(normal) @ (R_delta.T @ t_delta)
    except np.linalg.LinAlgError as err:
        raise NotObservable(
            "Eq. 25 has no inverse: all turns share one axis, along which the centre is free",
            rank=2,
            unknowns=3,
        ) from err
    return PrintedCenter(center, float(np.linalg.cond(normal)))


def equation_16(
    base_from_tag_a_now: Pose,
    tag_a_from_tag_b_now: Pose,
    tag_a_from_tag_b_ref: Pose,
    point_in_tag_a_ref: Array,
    tcp_in_base: Array,
) -> Array:
    """Flange (3,) in the base, mm, by the TCP (3,) turned into the base; it is added, as printed."""
    moved = base_from_tag_a_now @ tag_a_from_tag_b_now @ tag_a_from_tag_b_ref.inverse()
    return np.asarray(moved @ point_in_tag_a_ref + tcp_in_base)


def equation_19(
    R_base_from_tag_a: Array,
    tag_a_from_tag_b_now: Pose,
    tag_a_from_tag_b_ref: Pose,
    pivot_in_tag_b: Array,
    flange_ref: Array,
    pivot_flange_ref: Array,
) -> Array:
    """Flange (3,) in the base, mm, by p'_i and p'_f of the calibration; Q is that of Eq. 18 and 29."""
    H = tag_a_from_tag_b_now @ tag_a_from_tag_b_ref.inverse()
    p_1 = tag_a_from_tag_b_ref @ pivot_in_tag_b
    t_Q = H.rotation @ p_1 + H.translation - p_1
    R = R_base_from_tag_a
    turned = R @ H.rotation @ R.T @ (flange_ref - pivot_flange_ref)
    return np.asarray(turned + R @ t_Q + pivot_flange_ref)
