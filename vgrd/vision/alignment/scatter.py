"""How far the sides of a print lie from where they were drawn, told by what a fit leaves over.

Ragged ink, dots, halftone and JPEG move a whole side of a cell, or a whole line, at once: the pixels along
it err together. Their number is then no measure of what is known. So the standard deviation of sides
and of lines is estimated (restricted maximum likelihood), and what it does to the fit is added to the
covariance. Numbers in comments are the equations of docs/photometric.md.
"""

import numpy as np

from vgrd.geometry import Array

_LEAST = (
    0.03  # of the largest information: the rest is felt near corners, where no step of colour is
)
_ROUNDS = 12  # of the update; sigma then changes by less than 1 %


def scattered(gradient: Array, M: Array, B: Array, inverted: Array, change: Array) -> Array:
    """Covariance (8, 8) of the shape that scattered sides cause.

    gradient (sides,), M (sides, sides), B (sides, p): of `side_scores`; inverted (p, p): inverse of the
    fit's normal equations; change (p,): of its last step.
    """
    known = np.diag(M) > _LEAST * np.diag(M).max()
    B, M, u = B[known], M[np.ix_(known, known)], gradient[known] - B[known] @ change
    K = M - B @ inverted @ B.T
    D, V = np.linalg.eigh(K)
    good = D / D[-1] > _LEAST
    D, V = D[good], V[:, good]
    z = V.T @ u / np.sqrt(D)
    if np.sum(D * z**2) <= np.sum(D):
        return np.zeros((8, 8))  # the likelihood falls from 0 on
    sigma2 = 1 / np.median(D)
    for _ in range(_ROUNDS):
        w = 1 / (1 + sigma2 * D)
        sigma2 *= float(np.sum(D * (z * w) ** 2) / np.sum(D * w))
    G = inverted[:8] @ B.T
    return np.asarray(sigma2 * G @ G.T)
