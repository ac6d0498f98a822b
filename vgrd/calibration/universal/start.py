"""Global start of the universal method: TCP and translation eliminated, many rotations tried at once.

With S = R_X^T and t' = R_X^T t_X, Eq. 7 reads `S p_i - R_i p_T - t' = t_i`: linear in (S, p_T, t').
What is left of the cost when p_T and t' are eliminated is a quadratic in the nine numbers of S.
"""

from itertools import permutations, product

import numpy as np

from vgrd.calibration.touches import TouchSet
from vgrd.geometry import Array, exp_rotation, hat, nearest_rotation

_FIRST_STEPS = 5  # of all 24 starts, to rank them
_STEPS = 10  # of the promising ones, until they stand within the reach of the final fit
_PROMISING = 8  # starts that go on; several share a valley. 0 wrong optima in 16,000 problems
_COMPARABLE = 4.0  # times the lowest cost: noise does not raise the true valley so far
_CLOSE_RAD = 1e-3  # near enough for the final fit
_MAX_TURN_RAD = 1.0  # longer steps leave the region in which a linearisation holds
_DAMPING = 1e-3  # relative, Levenberg: keeps a singular system solvable, costs no step otherwise
_SAME_RAD = 0.02  # two ends that near are one valley
_KEPT = 3  # each costs one full fit
_NEWTON_STEPS = 50  # a bound only
_FLAT = 1e-9  # of the largest curvature: below it a direction is flat to rounding
_DONE_RAD = 1e-11  # a shorter step changes no digit of the cost
_LAST_RAD = 1e-5  # after a Newton step of this length nothing is left


def _cube_rotations() -> Array:
    """The 24 rotations of a cube, (24, 3, 3), turned a little so that no axis stays special."""
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    cube = np.array([R for R in signed if np.linalg.det(R) > 0])
    return cube @ exp_rotation((0.31, -0.17, 0.23))


_CUBE = _cube_rotations()
_GENERATORS = hat(np.eye(3))
_PRODUCTS = _GENERATORS[:, None] @ _GENERATORS[None]
_SECOND = (_PRODUCTS + _PRODUCTS.swapaxes(0, 1)) / 2
_DIAGONAL = np.arange(3)


def linear_rotation(K: Array) -> Array:
    """Rotation (3, 3) of X nearest to the unconstrained minimum of a `reduced_cost` (n, 10)."""
    S = np.linalg.lstsq(K[:, :9], -K[:, 9], rcond=1e-9)[0].reshape(3, 3)
    return nearest_rotation(S, tolerance=np.inf).T


def nearest_valley(K: Array, R_X: Array) -> Array:
    """Rotation (3, 3) of X at the minimum of a `reduced_cost` (n, 10) below a start.

    Newton steps on SO(3) with the exact second derivative, its eigenvalues taken as positive: where
    the touches contradict each other Gauss-Newton would creep.
    """
    C = K.T @ K
    S = R_X.T
    cost = _cost(K, S)
    for _ in range(_NEWTON_STEPS):
        pull = C[:9, :9] @ S.ravel() + C[:9, 9]
        turns = (_GENERATORS @ S).reshape(3, 9)
        bend = np.einsum("klij,ij->kl", _SECOND @ S, pull.reshape(3, 3))
        w, V = np.linalg.eigh(turns @ C[:9, :9] @ turns.T + bend)
        w = np.maximum(np.abs(w), _FLAT * np.abs(w).max())
        step = -V @ ((V.T @ (turns @ pull)) / w)
        step *= min(1.0, _MAX_TURN_RAD / max(float(np.linalg.norm(step)), 1e-12))
        lower = _turned_lower(K, S, step, cost)
        if lower is None:
            break
        S, cost = lower
        if float(np.linalg.norm(step)) < _LAST_RAD:
            break
    return S.T


def _turned_lower(K: Array, S: Array, step: Array, cost: float) -> tuple[Array, float] | None:
    """S after the step, or as small a part of it as lowers the cost; None when none does."""
    while float(np.linalg.norm(step)) > _DONE_RAD:
        candidate = exp_rotation(step) @ S
        candidate_cost = _cost(K, candidate)
        if candidate_cost < cost:
            return candidate, candidate_cost
        step = step / 4
    return None


def _cost(K: Array, S: Array) -> float:
    r = K[:, :9] @ S.ravel() + K[:, 9]
    return float(r @ r)


def rotation_candidates(K: Array) -> list[Array]:
    """Rotations (3, 3) of X in the best valleys of a `reduced_cost` (n, 10), best first."""
    S, costs = _descend(K, _CUBE, _FIRST_STEPS)
    S, costs = _descend(K, S[np.argsort(costs)[:_PROMISING]], _STEPS)
    order = np.argsort(costs)
    order = order[costs[order] <= _COMPARABLE * costs[order[0]] + 1e-9]
    valleys: list[Array] = []
    for rotation in S[order]:
        if (
            not valleys
            or (np.abs(np.array(valleys) - rotation).max(axis=(1, 2)) > _SAME_RAD).all()
        ):
            valleys.append(rotation)
    return [np.ascontiguousarray(rotation.T) for rotation in valleys[:_KEPT]]


def lowest_cost(K: Array) -> float:
    """The cost at the bottom of the best valleys of a `reduced_cost` (n, 10)."""
    return lowest_valley(K)[1]


def lowest_valley(K: Array) -> tuple[Array, float]:
    """Rotation (3, 3) of X at the bottom of the best valleys of a `reduced_cost` (n, 10), and its cost."""
    bottoms = [nearest_valley(K, R_X) for R_X in rotation_candidates(K)]
    costs = [_cost(K, R_X.T) for R_X in bottoms]
    best = int(np.argmin(costs))
    return bottoms[best], costs[best]


def solve_linear_part(
    points_in_object: Array, touches: TouchSet, R_X: Array
) -> tuple[Array, Array, Array]:
    """(R_X, t_X, p_T) with the least squares t_X and p_T for a given rotation of X."""
    B = touches.base_sqrt_informations()
    N = np.concatenate([B @ touches.rotations, B], axis=2).reshape(-1, 6)
    right = np.einsum("mij,mj->mi", B, points_in_object @ R_X - touches.translations).ravel()
    x = np.linalg.lstsq(N, right, rcond=1e-9)[0]
    return R_X, R_X @ x[3:], x[:3]


def reduced_cost(points_in_object: Array, touches: TouchSet) -> Array:
    """Square root (n, 10), n <= 10, of the cost in (vec S, 1), rows of S one after the other."""
    B, p = touches.base_sqrt_informations(), points_in_object
    A = (B[:, :, :, None] * (p - p.mean(axis=0))[:, None, None, :]).reshape(-1, 9)
    b = np.einsum("mij,mj->mi", B, touches.translations - touches.translations.mean(axis=0))
    N = np.concatenate([B @ touches.rotations, B], axis=2).reshape(-1, 6)
    U, s, _ = np.linalg.svd(N, full_matrices=False)
    U = U[:, s > 1e-9 * s[0]]
    M = np.column_stack([A, -b.ravel()])
    return np.asarray(np.linalg.qr(M - U @ (U.T @ M), mode="r"), dtype=np.float64)


def _descend(K: Array, S: Array, steps: int) -> tuple[Array, Array]:
    """Damped Gauss-Newton on SO(3) for all starts (k, 3, 3) at once; ends and costs."""
    A, b = K[:, :9].T.copy(), K[:, 9]
    for _ in range(steps):
        r = S.reshape(-1, 9) @ A + b
        J = (_GENERATORS @ S[:, None]).reshape(len(S), 3, 9) @ A
        normal = J @ J.transpose(0, 2, 1)
        normal[:, _DIAGONAL, _DIAGONAL] *= 1 + _DAMPING
        normal[:, _DIAGONAL, _DIAGONAL] += 1e-12
        solved = np.linalg.solve(normal, J @ r[:, :, None])
        step = -np.asarray(solved[:, :, 0], dtype=np.float64)
        length = np.sqrt(np.einsum("ki,ki->k", step, step))
        step *= np.minimum(1, _MAX_TURN_RAD / np.maximum(length, 1e-12))[:, None]
        S = _exp(step) @ S
        if length.max() < _CLOSE_RAD:
            break
    r = S.reshape(-1, 9) @ A + b
    return S, np.einsum("ki,ki->k", r, r)


def _exp(rotvecs: Array) -> Array:
    """Rotation matrices (k, 3, 3) of rotation vectors (k, 3)."""
    angle = np.maximum(np.linalg.norm(rotvecs, axis=1), 1e-12)[:, None, None]
    W = hat(rotvecs)
    rotations: Array = (
        np.eye(3) + np.sin(angle) / angle * W + 2 * (np.sin(angle / 2) / angle) ** 2 * (W @ W)
    )
    return rotations
