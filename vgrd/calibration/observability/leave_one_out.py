"""Bad touches named and left out: robust weights find them, deleted residuals have to agree."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vgrd.errors import CalibrationError
from vgrd.geometry import Array
from vgrd.judging.thresholds import OUTLIER_SIGMA

_CAUCHY = 2.385  # 95 % efficiency with normal noise (Rey 1983)
_ROUNDS = 8  # a bound only
_SETTLED = 0.01  # of a weight between 0 and 1
_SPARE_FREEDOM = 3  # one touch more than a fit needs, so that it can contradict
_MOST = 1 / 3  # of the touches: where more are bad nobody can say which


class TouchFit(Protocol):
    """A fit to m touches: whitened (m, k), scores (m,), freedom as in the results of the methods."""

    @property
    def whitened(self) -> Array:
        """Residuals in sigmas."""

    @property
    def scores(self) -> Array:
        """How many sigmas each touch is off."""

    @property
    def degrees_of_freedom(self) -> int:
        """Measured directions minus unknowns."""


FitT = TypeVar("FitT", bound=TouchFit)
Solve = Callable[[Array], FitT]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RobustFit(Generic[FitT]):
    """result: the fit of the touches in used (m,); scores (m,): sigmas each one is off that fit."""

    result: FitT
    used: Mask
    scores: Array


def noise_scale(fit: TouchFit) -> float:
    """How many times as much the touches scatter as their sigmas say; 1 where nothing is left over."""
    if fit.degrees_of_freedom < 1:
        return 1.0
    return float(np.sqrt(np.sum(fit.whitened**2) / fit.degrees_of_freedom))


def fit_without_outliers(
    solve: Solve[FitT], count: int, limit: float = OUTLIER_SIGMA
) -> RobustFit[FitT]:
    """Fit `count` touches without those that do not belong to the others, at most a third of them.

    `solve` takes weights (count,), 0 leaves a touch out. Where the touches scatter more than
    their sigmas say, a bad one has to stand out of that. limit: sigmas beyond which one is bad.
    Raises what `solve` raises for all touches.
    """
    fit = solve(np.ones(count))
    search = _Search(solve, int(_MOST * count), fit, np.ones(count, dtype=bool), limit)
    if fit.degrees_of_freedom > _SPARE_FREEDOM and fit.scores.max() > limit:
        search.leave_out(_suspects(solve, fit, limit))
        search.readmit()
        search.drop_the_worst()
    scores = search.fit.scores.copy()
    for i in np.flatnonzero(~search.used):
        scores[i] = search.score_of(int(i))
    return RobustFit(search.fit, search.used, scores)


def _suspects(solve: Solve[FitT], fit: FitT, limit: float) -> list[int]:
    """Touches that Cauchy weights push aside, worst first."""
    weights = np.ones(len(fit.scores))
    for _ in range(_ROUNDS):
        misfits = np.sqrt(np.mean(fit.whitened**2, axis=1) / weights)
        previous, weights = weights, 1 / (1 + (misfits / _CAUCHY) ** 2)
        if np.abs(weights - previous).max() < _SETTLED:
            break
        try:
            fit = solve(weights)
        except CalibrationError:
            break
    typical = max(1.0, float(np.median(misfits)))
    return [int(i) for i in np.argsort(-misfits) if misfits[i] > limit * typical]


class _Search(Generic[FitT]):
    """The touches in use and their fit."""

    def __init__(self, solve: Solve[FitT], most: int, fit: FitT, used: Mask, limit: float) -> None:
        self._limit = limit
        self._solve = solve
        self._most = most
        self.fit = fit
        self.used = used

    def leave_out(self, touches: list[int]) -> None:
        """Leave these out, if what remains determines a fit."""
        self._try(self._with(touches[: self._most], used=False))

    def readmit(self) -> None:
        """Take back what the others do not contradict."""
        for i in np.flatnonzero(~self.used):
            if self.score_of(int(i)) <= self._limit * max(1.0, noise_scale(self.fit)):
                self._try(self._with([int(i)], used=True))

    def drop_the_worst(self) -> None:
        """Leave out one after the other what the rest contradicts."""
        while np.sum(~self.used) < self._most:
            worst = int(np.argmax(self.fit.scores))
            score = float(self.fit.scores[worst])
            used, fit = self.used, self.fit
            if score <= self._limit or not self._try(self._with([worst], used=False)):
                return
            if score <= self._limit * max(1.0, noise_scale(self.fit)):
                self.used, self.fit = used, fit
                return

    def score_of(self, touch: int) -> float:
        """How many sigmas a touch that was left out is off the fit of the others."""
        return float(self._solve(self._with([touch], used=True).astype(float)).scores[touch])

    def _with(self, touches: list[int], *, used: bool) -> Mask:
        changed = self.used.copy()
        changed[touches] = used
        return changed

    def _try(self, used: Mask) -> bool:
        try:
            fit = self._solve(used.astype(float))
        except CalibrationError:
            return False
        if fit.degrees_of_freedom < _SPARE_FREEDOM:
            return False
        self.used, self.fit = used, fit
        return True
