"""Closed-form hand-eye start: Park and Martin 1994 for the rotation, then least squares."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array, Pose, log_rotation

Indices = NDArray[np.intp]

_NEAR_HALF_TURN_RAD = 3.0


def park_martin(moves: Sequence[Pose], cameras: Sequence[Pose]) -> tuple[Pose, Pose]:
    """(X, Y) with `cameras[i] ~ X^-1 moves[i] Y`, from all pairs: A X = X B.

    Rotations near half a turn have no stable axis and are left out.
    """
    first, second = np.array(list(combinations(range(len(moves)), 2))).T
    R_A, t_A = _between(moves, first, second)
    R_B, t_B = _between(cameras, first, second)
    alpha, beta = log_rotation(R_A), log_rotation(R_B)
    stable = np.linalg.norm(alpha, axis=1) < _NEAR_HALF_TURN_RAD
    U, _, Vt = np.linalg.svd(alpha[stable].T @ beta[stable])
    R: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    rows = (R_A - np.eye(3)).reshape(-1, 3)
    t = np.linalg.lstsq(rows, (t_B @ R.T - t_A).ravel(), rcond=None)[0]
    X = Pose(R, np.asarray(t, dtype=np.float64))
    return X, _mean([m.inverse() @ X @ c for m, c in zip(moves, cameras, strict=True)])


def _mean(poses: Sequence[Pose]) -> Pose:
    U, _, Vt = np.linalg.svd(np.sum([pose.rotation for pose in poses], axis=0))
    R: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return Pose(R, np.median([pose.translation for pose in poses], axis=0))


def _between(poses: Sequence[Pose], first: Indices, second: Indices) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and translations (n, 3) of `poses[first] @ poses[second].inverse()`."""
    R = np.array([pose.rotation for pose in poses])
    t = np.array([pose.translation for pose in poses])
    turned = R[first] @ np.swapaxes(R[second], 1, 2)
    return turned, t[first] - np.einsum("nij,nj->ni", turned, t[second])
