"""Do touches fit CAD as one rigid part? The least cost over every place of it and every TCP within reach.

Works from the first touch on: what nothing determines yet takes away freedom, not the answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import lowest_valley
from vgrd.geometry import Array, hat

_TCP_MM = 300.0  # sigma of a tip's place in the flange: no tool of 1 m, and no tip at infinity
_RANK = 1e-7  # of a column of length 1: below it nothing determines the direction
_GENERATORS = hat(np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class StillPoints:
    """CAD points (k, 3) that the object's motion leaves where they are, as tag B shows it: no tool was there.

    places: (k, 3) in the base; roots: (k, 3, 3) turn an error of a place into one of unit variance, 0 along the axis.
    """

    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    places: Array = field(default_factory=lambda: np.empty((0, 3)))
    roots: Array = field(default_factory=lambda: np.empty((0, 3, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class PlacedTouches:
    """Touches of CAD points (m, 3), brought to where they would be had the object not moved."""

    points: Array
    touches: TouchSet
    still: StillPoints = field(default_factory=StillPoints)

    def __len__(self) -> int:
        return len(self.points)

    def chosen(self, indices: Sequence[int]) -> "PlacedTouches":
        """Those with the given indices."""
        kept = np.asarray(indices, dtype=np.intp)
        return PlacedTouches(self.points[kept], self.touches.subset(kept), self.still)

    def renamed(self, points: Array) -> "PlacedTouches":
        """The same touches, of other points (m, 3)."""
        return PlacedTouches(points, self.touches, self.still)


@dataclass(frozen=True, slots=True, eq=False)
class RigidFit:
    """The likeliest place of the part: squares in sigmas, of so many degrees of freedom (no whole number).

    base_from_object, tip_in_wrist: as far as the touches determine them.
    """

    cost: float
    freedom: float
    rotation: Array
    translation: Array
    tip_in_wrist: Array

    def places(self, points: Array) -> Array:
        """Where CAD points (n, 3) are in the base, mm."""
        return np.asarray(points @ self.rotation.T + self.translation)


def fit_rigidly(placed: PlacedTouches) -> RigidFit:
    """The touches' least cost over base_from_object and TCP; of no touch 0 with no freedom."""
    touches, still, k = placed.touches, placed.still, len(placed.still.points)
    points = np.concatenate([placed.points, still.points])
    m = len(points)
    if not m:
        return RigidFit(0.0, 0.0, np.eye(3), np.zeros(3), np.zeros(3))
    B = np.concatenate([touches.base_sqrt_informations(), still.roots])
    rotations = np.concatenate([touches.rotations, np.zeros((k, 3, 3))])
    translations = np.concatenate([touches.translations, still.places])
    middle = points.mean(axis=0)
    A = (B[:, :, :, None] * (points - middle)[:, None, None, :]).reshape(-1, 9)
    b = np.einsum("mij,mj->mi", B, translations).ravel()
    # t_i = S p_i + t' - R_i tip, and the tip is within reach of the flange.
    N = np.concatenate([B, -B @ rotations], axis=2).reshape(-1, 6)
    N = np.vstack([N, np.hstack([np.zeros((3, 3)), np.eye(3) / _TCP_MM])])
    A, b = np.vstack([A, np.zeros((3, 9))]), np.concatenate([b, np.zeros(3)])
    Q = np.linalg.qr(N)[0]
    M = np.column_stack([A, -b])
    S, cost = _lowest(np.asarray(np.linalg.qr(M - Q @ (Q.T @ M), mode="r")))
    turned = np.column_stack([A @ (G @ S).ravel() for G in _GENERATORS])
    shift, tip = np.split(np.linalg.lstsq(N, b - A @ S.ravel(), rcond=None)[0], 2)
    freedom = 3 * m - k - _determined(np.hstack([N, turned]), 3 * m)  # a still point has no height
    return RigidFit(cost, max(freedom, 0.0), S, shift - S @ middle, tip)


def _lowest(K: Array) -> tuple[Array, float]:
    """Rotation (3, 3) of base_from_object, and the cost there; of touches of one point any will do."""
    if not np.any(np.abs(K[:, :9]) > _RANK):
        return np.eye(3), float(K[:, 9] @ K[:, 9])
    R_X, cost = lowest_valley(K)
    return R_X.T, cost


def _determined(J: Array, rows: int) -> float:
    """How many of the unknowns the first rows of J (r, n) determine: the trace of their share in the fit."""
    lengths = np.linalg.norm(J, axis=0)
    U, s, _ = np.linalg.svd(J / np.where(lengths > 0, lengths, 1.0), full_matrices=False)
    U = U[:rows, s > _RANK]
    return float(np.sum(U**2))
