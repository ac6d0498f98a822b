"""A X = Z B, both poses at once from the samples themselves."""

import numpy as np

from vgrd.calibration.hand_eye.published.motions import Motions, rotation_from_scaled
from vgrd.geometry import Pose


def shah(motions: Motions) -> tuple[Pose, Pose]:
    """Shah 2013, J. Mechanisms and Robotics 5(3): (X, Z), rotations first.

    sum of (R_B x R_A) vec R_X = n vec R_Z: its first singular vectors; then least squares of
    R_A t_X - t_Z = R_Z t_B - t_A.
    """
    n = len(motions.R_A)
    K = np.einsum("nij,nkl->ikjl", motions.R_B, motions.R_A).reshape(9, 9)
    U, _, Vt = np.linalg.svd(K)
    R_X = rotation_from_scaled(Vt[0].reshape(3, 3).T)
    R_Z = rotation_from_scaled(U[:, 0].reshape(3, 3).T)
    rows = np.concatenate([motions.R_A, np.broadcast_to(-np.eye(3), (n, 3, 3))], axis=2)
    right_side = (motions.t_B @ R_Z.T - motions.t_A).ravel()
    t = np.linalg.lstsq(rows.reshape(-1, 6), right_side, rcond=None)[0]
    return Pose(R_X, t[:3]), Pose(R_Z, t[3:])


def li(motions: Motions) -> tuple[Pose, Pose]:
    """Li, Wang and Wu 2010, Int. J. Physical Sciences 5(10): (X, Z), linear in all 24 numbers.

    (R_A x I) vec R_X - (I x R_B^T) vec R_Z = 0 and (I x t_B^T) vec R_Z - R_A t_X + t_Z = t_A,
    vec by rows; the rotations are made orthonormal afterwards.
    """
    motions, size = motions.scaled()
    n, eye = len(motions.R_A), np.eye(3)
    rows = np.zeros((n, 12, 24))
    rows[:, :9, :9] = np.einsum("nij,kl->nikjl", motions.R_A, eye).reshape(n, 9, 9)
    rows[:, :9, 9:18] = -np.einsum("ij,nlk->nikjl", eye, motions.R_B).reshape(n, 9, 9)
    rows[:, 9:, 9:18] = np.einsum("ij,nk->nijk", eye, motions.t_B).reshape(n, 3, 9)
    rows[:, 9:, 18:21], rows[:, 9:, 21:] = -motions.R_A, eye
    right_side = np.zeros((n, 12))
    right_side[:, 9:] = motions.t_A
    x = np.asarray(np.linalg.lstsq(rows.reshape(-1, 24), right_side.ravel(), rcond=None)[0])
    R_X, R_Z = (rotation_from_scaled(x[i : i + 9].reshape(3, 3)) for i in (0, 9))
    return Pose(R_X, size * x[18:21]), Pose(R_Z, size * x[21:])
