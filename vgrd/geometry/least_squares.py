"""Damped Gauss-Newton (Levenberg-Marquardt) on manifolds: one small solver for every estimate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from vgrd.errors import DidNotConverge
from vgrd.geometry.pose import Array

State = TypeVar("State")

_MAX_DAMPING = 1e12  # no shorter step is worth a trial: it changes no digit of the residuals
_MIN_DAMPING = 1e-12  # of unit columns: their products are known to 1e-15 only
_COST_RESOLUTION = 1e-6  # of (1 + cost): no sample minds a smaller difference; it may be rounding


@dataclass(frozen=True, slots=True, eq=False)
class Convergence:
    """How an iteration went; cost is half the sum of the squared residuals."""

    converged: bool
    steps: int
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class Minimum(Generic[State]):
    """Where the iteration ended: residuals (m,), jacobian (m, n) at `state`."""

    state: State
    residuals: Array
    jacobian: Array
    report: Convergence


def minimize(
    linearize: Callable[[State], tuple[Array, Array]],
    retract: Callable[[State, Array], State],
    start: State,
    *,
    tolerance: float = 1e-7,  # docs/decisions/0009
    max_steps: int = 100,  # a bound, a guess: more would cost time where there is no minimum
    damping: float = 1e-6,  # of unit columns: nearly undamped, for starts that are near
) -> Minimum[State]:
    """Lowest sum of squares near `start`; `linearize` gives residuals (m,) and Jacobian (m, n).

    Residuals are best in units of their sigma. The iteration has converged where the undamped
    Gauss-Newton step would change them by less than `tolerance` of (1 + their norm). So a small gradient
    counts, not a step that damping made short (docs/decisions/0009, which gives 1e-7 its reason). A
    state with non-finite residuals is never entered; DidNotConverge when `start` is one.
    """
    here = _Point(start, *linearize(start))
    if not np.isfinite(here.cost):
        raise DidNotConverge("the start of the iteration has no finite residuals")
    steps = 0
    is_last = False
    while steps < max_steps and damping < _MAX_DAMPING and not is_last:
        steps += 1
        is_last = here.is_minimum(tolerance)
        state = retract(here.state, here.newton if is_last else here.step(damping))
        trial = _Point(state, *linearize(state))
        if trial.is_better_than(here):
            here = trial
            damping = max(damping / 10, _MIN_DAMPING)
        else:
            damping *= 10
    report = Convergence(here.is_minimum(tolerance), steps, here.cost)
    return Minimum(here.state, here.residuals, here.jacobian, report)


def check_convergence(report: Convergence, what: str) -> None:
    """Raise DidNotConverge naming `what` unless the iteration found a minimum."""
    if not report.converged:
        raise DidNotConverge(
            f"{what}: no minimum after {report.steps} steps (cost {report.cost:.3g}); "
            "the samples contradict each other or belong to different set-ups"
        )


class _Point(Generic[State]):
    """A state with its residuals (m,), Jacobian (m, n) and column-scaled normal equations.

    newton: (n,) the undamped step; downhill: by how much it would change the residuals.
    """

    def __init__(self, state: State, residuals: Array, jacobian: Array) -> None:
        self.state, self.residuals, self.jacobian = state, residuals, jacobian
        self.cost = 0.5 * float(residuals @ residuals)
        if not np.isfinite(self.cost):
            return
        self._scale = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
        self._scale[self._scale == 0] = 1.0
        A = jacobian / self._scale
        self._normal, self._gradient = A.T @ A, A.T @ residuals
        self.newton = self.step(_MIN_DAMPING)
        fall = -float(self._gradient @ (self.newton * self._scale))
        self.downhill = float(np.sqrt(max(fall, 0.0)))

    def step(self, damping: float) -> Array:
        """Step (n,) of the damped normal equations."""
        normal = self._normal.copy()
        normal[np.diag_indices_from(normal)] += damping
        try:
            step = np.linalg.solve(normal, -self._gradient)
        except np.linalg.LinAlgError:
            step = np.linalg.lstsq(normal, -self._gradient, rcond=None)[0]
        return np.asarray(step / self._scale)

    def is_minimum(self, tolerance: float) -> bool:
        """Whether the undamped step would change next to nothing."""
        return bool(self.downhill <= tolerance * (1.0 + np.sqrt(2 * self.cost)))

    def is_better_than(self, other: "_Point[State]") -> bool:
        """Whether the cost is lower, or as low as rounding can tell and the gradient smaller."""
        if not np.isfinite(self.cost):
            return False
        is_as_low = self.cost - other.cost <= _COST_RESOLUTION * (1.0 + other.cost)
        return self.cost < other.cost or (is_as_low and self.downhill < other.downhill)
