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
_MANY = 500  # touches: from there on some are judged together
_TOGETHER = 0.01  # of so many: their pull on the fit is no more than that of one in a hundred
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
    for group in search.groups_left_out():
        scores[group] = search.scores_of(group)
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
        self._together = int(_TOGETHER * len(used)) if len(used) >= _MANY else 1
        self.fit = fit
        self.used = used

    def leave_out(self, touches: list[int]) -> None:
        """Leave these out, if what remains determines a fit."""
        self._try(self._with(touches[: self._most], used=False))

    def groups_left_out(self) -> list[list[int]]:
        """The touches that are left out, in groups that can be judged together: one by one where there are few."""
        left_out = np.flatnonzero(~self.used).tolist()
        return [left_out[i : i + self._together] for i in range(0, len(left_out), self._together)]

    def readmit(self) -> None:
        """Take back what the others do not contradict."""
        for group in self.groups_left_out():
            scores = self.scores_of(group)
            limit = self._limit * max(1.0, noise_scale(self.fit))
            fitting = [i for i, score in zip(group, scores, strict=True) if score <= limit]
            if fitting:
                self._try(self._with(fitting, used=True))

    def drop_the_worst(self) -> None:
        """Leave out one after the other, of many a few at once, what the rest contradicts."""
        while (spare := self._most - int(np.sum(~self.used))) > 0:
            worst = np.argsort(-self.fit.scores)[: min(self._together, spare)]
            worst = worst[self.fit.scores[worst] > self._limit]
            scores = self.fit.scores[worst]
            used, fit = self.used, self.fit
            if not len(worst) or not self._try(self._with(worst.tolist(), used=False)):
                return
            bad = scores > self._limit * max(1.0, noise_scale(self.fit))
            if bad.all():
                continue
            self.used, self.fit = used, fit
            if not bad.any() or not self._try(self._with(worst[bad].tolist(), used=False)):
                return

    def scores_of(self, touches: list[int]) -> Array:
        """How many sigmas touches that were left out are off the fit of the others."""
        return self._solve(self._with(touches, used=True).astype(float)).scores[touches]

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
