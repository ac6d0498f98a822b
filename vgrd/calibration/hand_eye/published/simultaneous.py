"""A X = X B, rotation and translation at once."""

import numpy as np

from vgrd.calibration.hand_eye.published.motions import (
    Motions,
    left,
    pure,
    quaternions,
    right,
    rotation_from_scaled,
    rotation_of,
)
from vgrd.calibration.hand_eye.published.separable import park_martin
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.least_squares import check_convergence, minimize

_SMALL = 1e-5  # size of the translations on the sphere of SO(4): its square is what is neglected
_GENERATORS = hat(np.eye(3))


def daniilidis(motions: Motions) -> Pose:
    """Daniilidis 1999, Int. J. Robotics Research 18(3): a x = x b, unit dual quaternions.

    Vector parts only: six rows per motion, a null space of two; |q| = 1 and q . q' = 0 choose
    the solution in it.
    """
    motions, size = motions.scaled()
    a, b = quaternions(motions.R_A), quaternions(motions.R_B)
    a_dual = 0.5 * np.einsum("nij,nj->ni", left(pure(motions.t_A)), a)
    b_dual = 0.5 * np.einsum("nij,nj->ni", left(pure(motions.t_B)), b)
    N, N_dual = _vector_rows(a, b), _vector_rows(a_dual, b_dual)
    rows = np.concatenate(
        [np.concatenate([N, 0 * N], axis=2), np.concatenate([N_dual, N], axis=2)], axis=1
    )
    null = np.linalg.svd(rows.reshape(-1, 8))[2][-2:]
    q, q_dual = _unit_dual(null[:, :4], null[:, 4:])
    return Pose(rotation_of(q), 2 * size * _times_conjugate(q_dual, q))


def _vector_rows(a: Array, b: Array) -> Array:
    """Vector part (n, 3, 4) of a q - q b; screws of A and B are congruent: equal scalars cancel."""
    return (left(pure(a[:, 1:])) - right(pure(b[:, 1:])))[:, 1:]


def _unit_dual(U: Array, V: Array) -> tuple[Array, Array]:
    """The combination of the rows of U, V (2, 4) with q . q' = 0 and the largest |q|, |q| = 1."""
    S = U @ V.T
    e, E = np.linalg.eigh(S + S.T)
    low, high = np.sqrt(max(-e[0], 0.0)), np.sqrt(max(e[1], 0.0))
    if low + high == 0:
        low = 1.0
    choices = E @ np.array([[high, high], [low, -low]])
    lengths = np.linalg.norm(U.T @ choices, axis=0)
    best = int(np.argmax(lengths))
    weights = choices[:, best] / lengths[best]
    return weights @ U, weights @ V


def _times_conjugate(p: Array, q: Array) -> Array:
    """Vector part (3,) of p q*, quaternions (4,)."""
    return np.asarray((right(q[None] * [1, -1, -1, -1])[0] @ p)[1:])


def andreff(motions: Motions) -> Pose:
    """Andreff, Horaud and Espiau 1999, 3DIM: linear in (vec R_X, t_X), Kronecker products.

    (I - R_A x R_B) vec R_X = 0 and (I x t_B^T) vec R_X + (I - R_A) t_X = t_A.
    """
    motions, size = motions.scaled()
    n = len(motions.R_A)
    rows = np.zeros((n, 12, 12))
    rows[:, :9, :9] = np.eye(9) - np.einsum("nij,nkl->nikjl", motions.R_A, motions.R_B).reshape(
        n, 9, 9
    )
    rows[:, 9:, :9] = np.einsum("ij,nk->nijk", np.eye(3), motions.t_B).reshape(n, 3, 9)
    rows[:, 9:, 9:] = np.eye(3) - motions.R_A
    right_side = np.zeros((n, 12))
    right_side[:, 9:] = motions.t_A
    x = np.asarray(np.linalg.lstsq(rows.reshape(-1, 12), right_side.ravel(), rcond=None)[0])
    return Pose(rotation_from_scaled(x[:9].reshape(3, 3)), size * x[9:])


def lu_chou(motions: Motions) -> Pose:
    """Lu and Chou 1995, IEEE Systems, Man and Cybernetics: eight-space (q, p = t_X q).

    a q - q b = 0 and a p - p b + t_A a q - q t_B b = 0, least squares with |q| = 1: p eliminated
    (without its part along q, which is no translation), q the lowest eigenvector of what is left.
    """
    motions, size = motions.scaled()
    a, b = quaternions(motions.R_A), quaternions(motions.R_B)
    N = left(a) - right(b)
    moved_a = np.einsum("nij,nj->ni", left(pure(motions.t_A)), a)
    moved_b = np.einsum("nij,nj->ni", left(pure(motions.t_B)), b)
    K = left(moved_a) - right(moved_b)
    M_pp, M_pq = np.einsum("nki,nkj->ij", N, N), np.einsum("nki,nkj->ij", N, K)
    e, E = np.linalg.eigh(M_pp)
    eliminate = -(E[:, 1:] / e[1:]) @ E[:, 1:].T @ M_pq
    q = np.linalg.eigh(M_pp + np.einsum("nki,nkj->ij", K, K) + M_pq.T @ eliminate)[1][:, 0]
    return Pose(rotation_of(q), size * _times_conjugate(eliminate @ q, q))


def wu(motions: Motions) -> Pose:
    """Wu, Sun, Wang and Liu 2020, IEEE Trans. Instrumentation and Measurement 69(6): SO(4).

    Poses with translations made small become rotations of four dimensions, `p -> l p r` with unit
    quaternions l, r; A X = X B is a_l x_l = x_l b_l and x_r a_r = b_r x_r, two lowest eigenvectors.
    """
    motions, size = motions.scaled()
    a_l, a_r = _isoclinic(_on_sphere(motions.R_A, motions.t_A))
    b_l, b_r = _isoclinic(_on_sphere(motions.R_B, motions.t_B))
    N_l, N_r = left(a_l) - right(b_l), right(a_r) - left(b_r)
    x_l = np.linalg.eigh(np.einsum("nki,nkj->ij", N_l, N_l))[1][:, 0]
    x_r = np.linalg.eigh(np.einsum("nki,nkj->ij", N_r, N_r))[1][:, 0]
    X = left(x_l[None])[0] @ right(x_r[None])[0]
    X = X * np.sign(X[0, 0])
    R = rotation_from_scaled(X[1:, 1:])
    return Pose(R, size / _SMALL * 0.5 * (X[1:, 0] - R @ X[0, 1:]))


def _on_sphere(R: Array, t: Array) -> Array:
    """Rotations (n, 4, 4) of poses, orthonormal to the square of the translations."""
    rotations = np.empty((len(R), 4, 4))
    rotations[:, 1:, 1:] = R
    rotations[:, 1:, 0] = _SMALL * t
    rotations[:, 0, 1:] = -_SMALL * np.einsum("nij,ni->nj", R, t)
    rotations[:, 0, 0] = 1
    return rotations


def _isoclinic(M: Array) -> tuple[Array, Array]:
    """Unit quaternions l, r (n, 4), scalar of l not negative, with `M @ p == l p r`.

    The matrix of the sixteen products l_i r_j is linear in M and of rank one.
    """
    U, _, Vt = np.linalg.svd(np.einsum("abij,nij->nab", _PRODUCTS, M))
    sign = np.where(U[:, :1, 0] < 0, -1.0, 1.0)
    return U[:, :, 0] * sign, Vt[:, 0] * sign


_UNITS = np.eye(4)
_PRODUCTS = np.einsum("aik,bkj->abij", left(_UNITS), right(_UNITS)) / 4  # squared norm of each


def gwak(motions: Motions) -> Pose:
    """Gwak, Kim and Park 2003, IEEE Trans. Robotics and Automation 19(1): descent on SE(3).

    Lowest sum of |A X - X B|^2 (Frobenius, lengths in units of the translations' rms), by damped
    Gauss-Newton from the closed form of Park and Martin. Raises DidNotConverge.
    """
    motions, size = motions.scaled()

    def linearize(X: Pose) -> tuple[Array, Array]:
        R, t = X.rotation, X.translation
        turn = motions.R_A @ R - R @ motions.R_B
        shift = motions.R_A @ t + motions.t_A - motions.t_B @ R.T - t
        G = _GENERATORS[:, None]
        J_turn = motions.R_A @ (_GENERATORS @ R)[:, None] - G @ (R @ motions.R_B)
        lag = motions.R_A - np.eye(3)
        swept = np.einsum("nij,kj->kni", lag, _GENERATORS @ t)
        swept -= np.einsum("kij,nj->kni", _GENERATORS, motions.t_B @ R.T)
        J = np.zeros((len(turn), 12, 6))
        J[:, :9, 3:] = np.moveaxis(J_turn.reshape(3, -1, 9), 0, 2)
        J[:, 9:, :3], J[:, 9:, 3:] = lag, np.moveaxis(swept, 0, 2)
        r = np.concatenate([turn.reshape(-1, 9), shift], axis=1)
        return r.ravel(), J.reshape(-1, 6)

    minimum = minimize(
        linearize,
        lambda X, step: Pose.exp(step) @ X,
        park_martin(motions),
    )
    check_convergence(minimum.report, "hand-eye, Gwak")
    return Pose(minimum.state.rotation, size * minimum.state.translation)
