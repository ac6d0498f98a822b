"""Closed-form hand-eye start: Park and Martin 1994 for the rotation, then least squares."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from vgrd.geometry import Array, Pose, log_rotation

_NEAR_HALF_TURN_RAD = 3.0


def park_martin(moves: Sequence[Pose], cameras: Sequence[Pose]) -> tuple[Pose, Pose]:
    """(X, Y) with `cameras[i] ~ X^-1 moves[i] Y`, from all pairs: A X = X B.

    Rotations near half a turn have no stable axis and are left out.
    """
    A = [moves[i] @ moves[j].inverse() for i, j in combinations(range(len(moves)), 2)]
    B = [cameras[i] @ cameras[j].inverse() for i, j in combinations(range(len(moves)), 2)]
    alpha = np.array([log_rotation(a.rotation) for a in A])
    beta = np.array([log_rotation(b.rotation) for b in B])
    stable = np.linalg.norm(alpha, axis=1) < _NEAR_HALF_TURN_RAD
    U, _, Vt = np.linalg.svd(alpha[stable].T @ beta[stable])
    R: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    rows = np.vstack([a.rotation - np.eye(3) for a in A])
    right = np.concatenate([R @ b.translation - a.translation for a, b in zip(A, B, strict=True)])
    X = Pose(R, np.linalg.lstsq(rows, right, rcond=None)[0])
    return X, _mean([m.inverse() @ X @ c for m, c in zip(moves, cameras, strict=True)])


def _mean(poses: Sequence[Pose]) -> Pose:
    U, _, Vt = np.linalg.svd(np.sum([pose.rotation for pose in poses], axis=0))
    R: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return Pose(R, np.median([pose.translation for pose in poses], axis=0))
