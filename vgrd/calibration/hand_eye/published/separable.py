"""A X = X B, rotation first: R_A R_X = R_X R_B, then (R_A - I) t_X = R_X t_B - t_A."""

import numpy as np

from vgrd.calibration.hand_eye.published.motions import (
    Motions,
    left,
    quaternions,
    right,
    rotation_of,
)
from vgrd.geometry import Array, Pose, hat, log_rotation, nearest_rotation

_HALF_TURNS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
_FAR = 4.0  # of a tangent: X turns by more than 152 degrees


def translation_for(R_X: Array, motions: Motions) -> Array:
    """Least squares t_X (3,) of `(R_A - I) t_X = R_X t_B - t_A`."""
    rows = (motions.R_A - np.eye(3)).reshape(-1, 3)
    right_side = (motions.t_B @ R_X.T - motions.t_A).ravel()
    return np.asarray(np.linalg.lstsq(rows, right_side, rcond=None)[0])


def tsai_lenz(motions: Motions) -> Pose:
    """Tsai and Lenz 1989, IEEE Trans. Robotics and Automation 5(3): hat(a + b) p = b - a.

    a, b = 2 sin(angle / 2) axis of A and B; p = tan(angle / 2) axis of X. Where X is near a half
    turn, p has no end, and the camera's frame is turned by 180 degrees about one of its axes.
    """
    a, b = 2 * quaternions(motions.R_A)[:, 1:], 2 * quaternions(motions.R_B)[:, 1:]
    for flip in _HALF_TURNS:
        b_flip = b * flip
        rows, right_side = hat(a + b_flip).reshape(-1, 3), (b_flip - a).ravel()
        p, _, rank, _ = np.linalg.lstsq(rows, right_side, rcond=1e-9)
        if rank == 3 and np.linalg.norm(p) < _FAR:
            break
    R = rotation_of(np.concatenate([[1.0], p])) * flip
    return Pose(R, translation_for(R, motions))


def park_martin(motions: Motions) -> Pose:
    """Park and Martin 1994, IEEE Trans. Robotics and Automation 10(5): log R_A = R_X log R_B."""
    M = log_rotation(motions.R_A).T @ log_rotation(motions.R_B)
    R = nearest_rotation(M, tolerance=np.inf)
    return Pose(R, translation_for(R, motions))


def horaud_dornaika(motions: Motions) -> Pose:
    """Horaud and Dornaika 1995, Int. J. Robotics Research 14(3): a q = q b, unit quaternions.

    The closed form: q minimises the sum of |a q - q b|^2, the lowest eigenvector.
    """
    N = left(quaternions(motions.R_A)) - right(quaternions(motions.R_B))
    q = np.linalg.eigh(np.einsum("nki,nkj->ij", N, N))[1][:, 0]
    R = rotation_of(q)
    return Pose(R, translation_for(R, motions))
