"""Global minimum of a quadratic in the nine numbers of a rotation, with proof: Shor's relaxation.

The cost is `x.T @ C @ x` with x = (vec S, 1), S in SO(3), rows of S one after the other. Every S
obeys `x.T @ A_k @ x == f_k`: rows and columns orthonormal, cross products of rows and of columns.
For multipliers z with M = C + sum z_k A_k positive semidefinite, -f @ z is a lower bound of every
cost; at a stationary x those with M @ x = 0 reach its cost. Finding the best z is a semidefinite
program (10 x 10), whose other half is the relaxed x x.T. Briales and Gonzalez-Jimenez 2017,
"Convex global 3D registration with Lagrangian duality".
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement

import clarabel
import numpy as np
from scipy.linalg import qr
from scipy.sparse import csc_matrix

from vgrd.geometry import Array, nearest_rotation

TIGHT = 1e-6  # gap of a proof: rounding; the study of certificates left 1.3e-7 at most
_SIZE = 10  # of x
_SQUARED_LENGTH = 4.0  # of x: three of S and one
_FLOOR = 1e-8  # of the cost, over trace(C) / 10: perfect data have no relative gap
_ROUNDS = 20  # tried on 60 fits of points: 8 were the most that a proof needed
_RELAXATION = 1.6  # of a projection: 8 rounds at most in those fits, 12 without (1.0)
_INSIDE = 1e-4  # of the largest eigenvalue: the target, so that 0 is crossed; 0 took 20 rounds
_INDEPENDENT = 1e-9  # of singular values of small integers, which are 0 or about 1


@dataclass(frozen=True, slots=True)
class Certificate:
    """gap: (cost - lower bound of every possible cost) / cost; tight: below 1e-6, proven best."""

    gap: float
    tight: bool


@dataclass(frozen=True, slots=True, eq=False)
class Relaxation:
    """rotation: S (3, 3) nearest to the relaxed x; slack: M (10, 10) of the best lower bound."""

    rotation: Array
    slack: Array


def _constraints() -> tuple[Array, Array]:
    """Independent A_k (n, 10, 10) and f_k (n,)."""
    place = np.arange(9).reshape(3, 3)
    matrices, values = [], []

    def add(terms: list[tuple[int, int, float]], value: float) -> None:
        A = np.zeros((_SIZE, _SIZE))
        for i, j, factor in terms:
            A[i, j] += factor / 2
            A[j, i] += factor / 2
        matrices.append(A)
        values.append(value)

    add([(9, 9, 1.0)], 1.0)
    for grid in (place, place.T):
        for a, b in combinations_with_replacement(range(3), 2):
            add([(grid[a, k], grid[b, k], 1.0) for k in range(3)], float(a == b))
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                product = [(grid[a, i], grid[b, j], 1.0), (grid[a, j], grid[b, i], -1.0)]
                add([*product, (grid[c, k], 9, -1.0)], 0.0)
    flat = np.reshape(matrices, (len(matrices), -1))
    R, order = qr(flat.T, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > _INDEPENDENT))
    chosen = np.sort(order[:rank])
    return np.array(matrices)[chosen], np.array(values)[chosen]


_A, _F = _constraints()

# The semidefinite program as Clarabel wants it: upper triangles by columns, isometrically scaled.
_UPPER = tuple(np.array([(i, j) for j in range(_SIZE) for i in range(j + 1)]).T)
_SCALE = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2))  # off the diagonal one stands for two
_COLUMNS = csc_matrix(-(_A[:, *_UPPER] * _SCALE).T)
_NO_SQUARES = csc_matrix((len(_F), len(_F)))
_CONES = [clarabel.PSDTriangleConeT(_SIZE)]

# All rotations look alike from themselves: with S turned to I these are constants.
_X = np.append(np.eye(3).ravel(), 1.0)
_GRADIENTS = (_A @ _X).T
_FIT = -np.tensordot(np.linalg.pinv(_GRADIENTS, rcond=_INDEPENDENT), _A, (0, 0))


def _stationary() -> Array:
    """Orthonormal basis (n, 100) of the sums of A_k that map x of S = I to zero."""
    _, s, Vt = np.linalg.svd(_GRADIENTS)
    null_space = Vt[int(np.sum(s > _INDEPENDENT)) :]
    flat = np.tensordot(null_space, _A, 1).reshape(len(null_space), -1)
    return np.asarray(np.linalg.qr(flat.T)[0].T)


_STATIONARY = _stationary()


def _settings() -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.max_threads = 1
    return settings


_SETTINGS = _settings()


def relax(C: Array) -> Relaxation:
    """Solve the relaxation for a cost (10, 10), symmetric and positive semidefinite."""
    unit = np.trace(C) / _SIZE
    right = C[_UPPER] * (_SCALE / unit)
    solver = clarabel.DefaultSolver(_NO_SQUARES, _F, _COLUMNS, right, _CONES, _SETTINGS)
    solution = solver.solve()
    Z = np.zeros((_SIZE, _SIZE))
    Z[_UPPER] = np.array(solution.z) / _SCALE
    x = np.linalg.eigh(Z, UPLO="U")[1][:, -1]
    slack = C + unit * np.tensordot(np.array(solution.x), _A, 1)
    S = x[:9].reshape(3, 3) * np.sign(x[9])
    return Relaxation(nearest_rotation(S, tolerance=np.inf), slack)


def prove(C: Array, S: Array, slack: Array | None = None) -> Certificate:
    """Gap at a stationary S (3, 3) of a cost (10, 10).

    It starts from the multipliers with M @ x = 0 that are nearest to those of `slack`; without it from
    the smallest. Alternating projections move them towards a positive semidefinite M. All multipliers
    give a valid bound, so the gap of an optimum may come out too large, never too small. A cost below
    1e-8 of trace(C) / 10 counts as that much.
    """
    turn = np.eye(_SIZE)
    turn[:9, :9] = np.kron(S, np.eye(3))
    unit = np.trace(C) / _SIZE
    C = turn.T @ C @ turn / unit
    cost = max(float(_X @ C @ _X), _FLOOR)
    M = C + np.tensordot(C @ _X, _FIT, 1)
    if slack is not None:
        M = M + _stationary_part(turn.T @ slack @ turn / unit - M)
    gap = np.inf
    for _ in range(_ROUNDS):
        w, V = np.linalg.eigh(M)
        gap = min(gap, (abs(float(_X @ M @ _X)) - _SQUARED_LENGTH * min(0.0, w[0])) / cost)
        if gap < TIGHT:
            break
        nearest = (V * np.maximum(w, _INSIDE * w[-1])) @ V.T
        M = M + _RELAXATION * _stationary_part(nearest - M)
    return Certificate(float(gap), bool(gap < TIGHT))


def _stationary_part(change: Array) -> Array:
    """The part of a change of M (10, 10) that multipliers can make without changing M @ x."""
    return ((_STATIONARY @ change.ravel()) @ _STATIONARY).reshape(_SIZE, _SIZE)
