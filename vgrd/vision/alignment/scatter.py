"""How far the sides of a print lie from where they were drawn, told by what a fit leaves over.

Ragged ink, dots, halftone and JPEG move a whole side of a cell at once: the pixels along it err together.
Their number is then no measure of what is known. So the standard deviation of the sides is estimated, and
what it does to the fit is added to the covariance. Lines that were
put elsewhere as a whole are unknowns of the fit. Numbers in comments are the equations of
docs/photometric.md.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.alignment.normal_equations import SHAPE

_LEAST = (
    0.03  # of the largest information: the rest is felt near corners, where no step of colour is
)
_ROUNDS = 8  # of the weights; sigma then changes by less than 1 %


@dataclass(frozen=True, slots=True, eq=False)
class FreeLines:
    """Lines whose place is unknown: sides (sides, lines), 1 where a side is a part of a line.

    shifts (lines,): from where they were drawn to where the raster has them, mm, known to sigma_mm.
    """

    sides: Array
    shifts: Array
    sigma_mm: float


def scattered(
    scores: tuple[Array, Array, Array], inverted: Array, change: Array, lines: FreeLines | None
) -> tuple[Array, Array]:
    """Covariance (8, 8) of the shape, and the change (8,) of it that the free lines ask for.

    scores: of `side_scores`; inverted (p, p): inverse of the fit's normal equations; change (p,): of its
    last step.
    """
    gradient, M, B = scores
    has_step = np.diag(M) > _LEAST * np.diag(M).max()
    gradient, M, B = gradient[has_step], M[np.ix_(has_step, has_step)], B[has_step]
    u = gradient - B @ change
    K, G = M - B @ inverted @ B.T, inverted[:SHAPE] @ B.T  # 22
    covariance, shift = inverted[:SHAPE, :SHAPE], np.zeros(SHAPE)
    if lines is not None:
        belief, sides = 1 / lines.sigma_mm**2, lines.sides[has_step]
        P, X = K @ sides, G @ sides
        S = np.linalg.inv(sides.T @ P + belief * np.eye(len(lines.shifts)))
        step = S @ (sides.T @ u - belief * lines.shifts)
        u, shift = u - P @ step, -X @ step
        K, G, covariance = K - P @ S @ P.T, G - X @ S @ P.T, covariance + X @ S @ X.T
    variance = _variance(K, u)
    return np.asarray(covariance + variance * G @ G.T), shift  # 23


def _variance(K: Array, u: Array) -> float:
    """Variance of the sides, mm^2: u (n,) has the covariance K + variance K K.

    From the squares of u, weighted as the likelihood would if they were independent.
    """
    squares, slope = u * u / np.diag(K), np.sum(K * K, axis=1) / np.diag(K)
    variance = 0.0
    for _ in range(_ROUNDS):
        weight = slope / (1 + variance * slope) ** 2
        variance = max(float(weight @ (squares - 1) / (weight @ slope)), 0.0)  # 24
    return variance
