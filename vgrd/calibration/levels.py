"""Levels of noise found in the data: restricted maximum likelihood with what was stated as a prior.

The covariance of the residuals is a sum over kinds of noise, S = sum_k exp(xi_k) Q_k, xi_k = 0 where the
stated level holds. With P = S^-1 - S^-1 J (J^T S^-1 J)^-1 J^T S^-1 the restricted log-likelihood has the
score (r^T P S_k P r - tr P S_k) / 2 and the information tr(P S_k P S_l) / 2, S_k = exp(xi_k) Q_k
(Patterson and Thompson 1971; Harville 1977). The prior of a level is log-normal.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile

STATED_FACTOR = 2.0  # a stated sigma is right within this factor in two of three cases: a guess
_ROUNDS = 30  # of scoring, a bound only
_SETTLED = 0.01  # of a logarithm: half a percent of a sigma, of which a tenth is known at best
_LARGEST_STEP = 1.5  # of a logarithm: scoring overshoots far from the optimum
_FINEST = np.log(1e-3)  # of a variance: exact data leave no noise at all, and nothing to weigh by
_LEAST_FREEDOM = 2.5  # below it a t distribution has hardly a variance
_NORMAL_95 = 1.959964  # two-sided 95 % quantile of the normal distribution


@dataclass(frozen=True, slots=True)
class Level:
    """One kind of noise: stated and found in `unit` (standard deviation), e.g. "touches lateral", "mm".

    log_sigma: standard deviation of the found level's natural logarithm; freedom: how many samples of a
    normal distribution would tell as much of it, the prior counted.
    """

    name: str
    unit: str
    stated: float
    found: float
    log_sigma: float

    @property
    def freedom(self) -> float:
        """Degrees of freedom of a chi-square whose logarithm spreads as much: var log sigma = 1 / (2 f)."""
        return 0.5 / self.log_sigma**2

    @property
    def ratio(self) -> float:
        """Found over stated."""
        return self.found / self.stated

    @property
    def interval(self) -> tuple[float, float]:
        """In which the level is at 95 %."""
        factor = float(np.exp(_NORMAL_95 * self.log_sigma))
        return self.found / factor, self.found * factor

    @property
    def surprise(self) -> float:
        """How many sigmas of its prior and of its own spread the level is off what was stated."""
        prior = np.log(STATED_FACTOR)
        return float(abs(np.log(self.ratio)) / np.hypot(prior, self.log_sigma))


@dataclass(frozen=True, slots=True, eq=False)
class Whitened:
    """Residuals (r,) and derivative (r, n) for noise I, and its parts: factors F, sum F F^T = I.

    A factor is (r, q), or (m, b, q) where the noise of m samples of b = r / m rows is independent.
    """

    residuals: Array
    jacobian: Array
    factors: Sequence[Array]


@dataclass(frozen=True, slots=True, eq=False)
class Slope:
    """Score (k,) and expected information (k, k) of the log variances, of the data alone.

    bend: (k, k), minus the second derivative of the likelihood, which is worth a step where it is known.
    """

    score: Array
    information: Array
    bend: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Logarithms of variances over the stated ones (k,), and their covariance (k, k)."""

    log_variances: Array
    covariance: Array

    @classmethod
    def stated(cls, count: int) -> "Levels":
        """As stated, to begin with."""
        return cls(np.zeros(count), np.zeros((count, count)))

    @property
    def scales(self) -> Array:
        """(k,): sigmas over the stated ones."""
        return np.asarray(np.exp(0.5 * self.log_variances))

    def named(self, names: Sequence[tuple[str, str, float]]) -> tuple[Level, ...]:
        """The levels in words: (name, unit, stated) of each."""
        spreads = 0.5 * np.sqrt(np.diag(self.covariance))
        return tuple(
            Level(name, unit, stated, stated * float(scale), float(spread))
            for (name, unit, stated), scale, spread in zip(
                names, self.scales, spreads, strict=True
            )
        )

    def freedom_of(self, parts: Array, total: float | None = None) -> float:
        """Degrees of freedom of a variance that consists of parts (k,), by Satterthwaite (1946).

        total: with what is known beside them; None: their sum.
        """
        shares = parts / (parts.sum() if total is None else total)
        relative = float(shares @ self.covariance @ shares)
        return max(2 / relative if relative > 0 else np.inf, _LEAST_FREEDOM)


def find_levels(
    whiten: Callable[[Array], Whitened],
    count: int,
    *,
    prior_factors: Array | None = None,
    common_factor: float = 1.0,
    start: Array | None = None,
    settled: float = _SETTLED,
) -> Levels:
    """Most likely levels; whiten(log_variances (k,)) gives the residuals near the optimum for them.

    The residuals need not be those of the optimum: what the unknowns take up is projected out.
    prior_factors: (k,), within which a stated sigma is right in two of three cases, inf for none.
    common_factor: the same of what all of them are wrong by alike.
    settled: the search ends with a step of the log variances below it, or worth less than its square.
    """
    return ascend(lambda x: _score(whiten(x)), count, prior_factors, start, common_factor, settled)


def ascend(
    slope_at: Callable[[Array], Slope],
    count: int,
    prior_factors: Array | None,
    start: Array | None,
    common_factor: float = 1.0,
    settled: float = _SETTLED,
) -> Levels:
    """Most likely levels from the slope of the likelihood at log variances (k,), as `find_levels`.

    Newton's steps where the likelihood bends down every way, else Fisher scoring.
    """
    factors = np.full(count, STATED_FACTOR) if prior_factors is None else prior_factors
    own = np.diag(1 / (2 * np.log(factors)) ** 2)  # a log variance is two log sigmas
    common = 2 * np.log(common_factor)
    alike = own.sum(axis=1) * common
    prior_information = own - np.outer(alike, alike) / (1 + common * alike.sum())
    log_variances = np.zeros(count) if start is None else np.maximum(start, _FINEST)
    for _ in range(_ROUNDS):
        slope = slope_at(log_variances)
        score = slope.score - prior_information @ log_variances
        information = slope.information + prior_information
        free = (log_variances > _FINEST) | (score > 0)  # the others stay where no noise is left
        step = np.zeros(count)
        step[free] = _step(slope, prior_information, score, free)
        step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step).max(initial=0)), 1e-300))
        step = np.maximum(step, _FINEST - log_variances)
        gain = float(score @ step)  # of the log-likelihood, twice
        log_variances = log_variances + step
        if float(np.abs(step).max(initial=0)) < settled or gain < settled**2:
            break
    return Levels(log_variances, np.asarray(np.linalg.pinv(information, hermitian=True)))


def _step(slope: Slope, prior_information: Array, score: Array, free: NDArray[np.bool_]) -> Array:
    """Of the log variances that are free, with the prior."""
    inner = np.ix_(free, free)
    if slope.bend is not None:
        bend = (slope.bend + prior_information)[inner]
        if np.linalg.eigvalsh(bend).min(initial=np.inf) > 0:
            return np.asarray(np.linalg.solve(bend, score[free]))
    curvature = np.diag(np.maximum(-slope.score, 0))  # of a level that vanishes: steps overshoot
    matrix = (slope.information + prior_information + curvature)[inner]
    return np.asarray(np.linalg.lstsq(matrix, score[free], rcond=None)[0])


def wider_by_freedom(freedom: float, dimensions: float = 1.0) -> float:
    """Factor of a sigma by which 95 % of a vector are wider where its variance was estimated.

    dimensions: of the vector; of a number (1) it is the t distribution over the normal one, else Hotelling's.
    """
    if not np.isfinite(freedom):
        return 1.0
    estimated = dimensions * float(fisher.ppf(0.95, dimensions, freedom))
    return float(np.sqrt(estimated / chi2_quantile(0.95, dimensions)))


def _score(whitened: Whitened) -> Slope:
    U, s, _ = np.linalg.svd(whitened.jacobian, full_matrices=False)
    U = U[:, s > s.max(initial=0) * 1e-10]  # rounding: a direction that no row feels
    residuals = whitened.residuals - U @ (U.T @ whitened.residuals)
    if whitened.factors[0].ndim == 3:
        return _score_of_blocks(U, residuals, whitened.factors)
    seen = [F - U @ (U.T @ F) for F in whitened.factors]
    squares = [float(np.sum((F.T @ residuals) ** 2)) for F in whitened.factors]
    score = np.array(
        [0.5 * (q - float(np.sum(F * F))) for q, F in zip(squares, seen, strict=True)]
    )
    information = np.empty((len(seen), len(seen)))
    for i, F in enumerate(whitened.factors):
        for j in range(i + 1):
            information[i, j] = information[j, i] = 0.5 * float(np.sum((F.T @ seen[j]) ** 2))
    return Slope(score, information)


def _score_of_blocks(U: Array, residuals: Array, factors: Sequence[Array]) -> Slope:
    """The same where the parts are (m, b, q): tr P S_k P S_l without matrices of all rows."""
    m, b, _ = factors[0].shape
    r, U = residuals.reshape(m, b, 1), U.reshape(m, b, -1)
    turned = [np.swapaxes(F, 1, 2) for F in factors]
    taken = [F @ U for F in turned]
    of_unknowns = [np.tensordot(G, G, axes=((0, 1), (0, 1))) for G in taken]
    score = np.array(
        [
            0.5 * float(np.sum((F @ r) ** 2) - np.sum(F * F) + np.sum(G * G))
            for F, G in zip(turned, taken, strict=True)
        ]
    )
    information = np.empty((len(factors), len(factors)))
    for i, F in enumerate(turned):
        for j in range(i + 1):
            both = F @ factors[j]
            crossed = float(np.sum(taken[i] * (both @ taken[j])))
            alike = float(np.sum(of_unknowns[i] * of_unknowns[j]))
            half = 0.5 * (float(np.sum(both * both)) - 2 * crossed + alike)
            information[i, j] = information[j, i] = half
    return Slope(score, information)
