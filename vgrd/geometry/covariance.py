"""Uncertainty: covariances of least squares, what the data leave undetermined, 95 % radii, means.

Covariances of poses are (6, 6) of a left tangent perturbation (v, w): `exp(xi) @ pose`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vgrd.errors import InputError, NotObservable
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.pose import Array, Pose

_NOISE_STANDS_OUT = 3.0  # columns of noise alone reach 1 + sqrt(columns / rows) < 2 of their rms
_DEPENDENT = 1e-9  # of the largest singular value of unit columns: seven digits above rounding
_MEAN_STEPS = 4  # of the mean of poses; each squares the error, which is their scatter at first


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """rank of the columns; undetermined: (n - rank, n) directions, each row a unit vector."""

    rank: int
    undetermined: Array


def observability(
    jacobian: Array, scales: Array, tolerance: float, noise: Array | None = None
) -> Observability:
    """Rank of a Jacobian (m, n) whose columns are multiplied by `scales` (n,) first.

    A direction counts when it moves the residuals by more than `tolerance` times the square root
    of the number of rows, in the unit of the residuals. noise: (n,) rms error of the entries of each
    column, if they were measured; a direction then counts only beyond three times what that noise does.
    """
    m, n = jacobian.shape
    _, s, Vt = np.linalg.svd(np.linalg.qr(jacobian * scales, mode="r"), full_matrices=True)
    least = np.full(len(s), tolerance)
    if noise is not None:
        noise_length = np.linalg.norm(Vt[: len(s)] * noise * scales, axis=1)
        least = np.maximum(least, _NOISE_STANDS_OUT * noise_length)
    counts = s > least * np.sqrt(max(m, 1))
    rank = len(s) if counts.all() else int(np.argmin(counts))
    return Observability(rank, Vt[rank:n])


def covariance_from(jacobian: Array) -> Array:
    """Covariance (n, n) of a least-squares estimate from its whitened Jacobian (m, n).

    Raises NotObservable when the columns are dependent to working precision.
    """
    scale = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    scale[scale == 0] = 1.0
    s, Vt = np.linalg.svd(jacobian / scale, full_matrices=False)[1:]
    n = jacobian.shape[1]
    rank = int(np.sum(s > _DEPENDENT * s[0])) if s.size else 0
    if rank < n:
        raise NotObservable(
            f"only {rank} of {n} unknowns are determined by the data", rank=rank, unknowns=n
        )
    half = (Vt.T / s) / scale[:, None]
    out: Array = half @ half.T
    return out


def sqrt_information(covariance: Array) -> Array:
    """Matrices W (..., n, n) with `W.T @ W == inverse(covariance)`.

    Raises InputError on a covariance that is not finite and positive definite.
    """
    try:
        W: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError as fault:
        raise InputError("a covariance must be finite and positive definite") from fault
    if not np.isfinite(W).all():
        raise InputError("a covariance must be finite and positive definite")
    return W


def radius95(covariance: Array) -> float:
    """`radius_of` 95 %: the confidence at which errors are told."""
    return radius_of(covariance, 0.95)


def radius_of(covariance: Array, share: float) -> float:
    """Radius that holds a share of a centred normal vector; same unit as the square root.

    The squared length is taken as g chi2(v) with the right mean and variance (Satterthwaite):
    exact when all eigenvalues that count are equal, within 2 % otherwise.
    """
    total = float(np.trace(covariance))
    if total <= 0:
        return 0.0
    squares = float(np.einsum("ij,ji->", covariance, covariance))
    g, degrees_of_freedom = squares / total, total * total / squares
    return float(np.sqrt(g * chi2_quantile(share, degrees_of_freedom)))


def radius95_of_mixture(covariances: Sequence[Array]) -> float:
    """Radius that holds 95 % of centred normal vectors, each drawn with one of the covariances, all as likely.

    The squared length has the mean m = mean tr C and the variance mean(tr^2 C + 2 tr C^2) - m^2; taken as in
    `radius_of`.
    """
    totals = np.array([np.trace(C) for C in covariances])
    squares = np.array([np.sum(C * C) for C in covariances])
    mean = float(totals.mean())
    if mean <= 0:
        return 0.0
    variance = float(np.mean(totals**2 + 2 * squares)) - mean**2
    return float(np.sqrt(variance / (2 * mean) * chi2_quantile(0.95, 2 * mean**2 / variance)))


def dimensions_of(covariance: Array) -> float:
    """In how many directions a vector of this covariance is uncertain, as `radius_of` counts them."""
    return float(np.trace(covariance)) ** 2 / float(np.einsum("ij,ji->", covariance, covariance))


def wide_directions(covariance: Array, sigma: float) -> Array:
    """Axes (n, k) of a covariance (n, n) along which its sigma is at least that large, scaled by it."""
    variances, axes = np.linalg.eigh(covariance)
    wide = variances >= sigma**2
    return np.asarray(axes[:, wide] * np.sqrt(variances[wide]))


def rms(values: ArrayLike) -> float:
    """Root of the mean of the squares, all of any shape alike."""
    return float(np.sqrt(np.mean(np.square(values))))


def mean_pose(poses: Sequence[Pose], covariances: Sequence[Array]) -> tuple[Pose, Array]:
    """Weighted mean in the tangent space and its covariance (6, 6)."""
    sqrt_informations = [sqrt_information(c) for c in covariances]
    informations = [W.T @ W for W in sqrt_informations]
    covariance = np.linalg.inv(np.sum(informations, axis=0))
    mean = poses[0]
    for _ in range(_MEAN_STEPS):
        inverse = mean.inverse()
        logs = [(pose @ inverse).log() for pose in poses]
        step = covariance @ sum(info @ xi for info, xi in zip(informations, logs, strict=True))
        mean = Pose.exp(step) @ mean
    return mean, covariance
