"""Damped Gauss-Newton (Levenberg-Marquardt) on manifolds: one small solver for every estimate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from vgrd.errors import DidNotConverge
from vgrd.geometry.pose import Array

State = TypeVar("State")

_MAX_DAMPING = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Report:
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
    report: Report


def minimize(
    linearize: Callable[[State], tuple[Array, Array]],
    retract: Callable[[State, Array], State],
    start: State,
    *,
    tolerance: float = 1e-9,
    max_steps: int = 100,
    damping: float = 1e-6,
) -> Minimum[State]:
    """Lowest sum of squares near `start`; `linearize` gives residuals (m,) and Jacobian (m, n).

    Residuals are best in units of their sigma: a step that changes them by less than `tolerance`
    of (1 + their norm) ends the iteration. A state with non-finite residuals is never entered;
    DidNotConverge when `start` is one.
    """
    state, (r, J) = start, linearize(start)
    cost = 0.5 * float(r @ r)
    if not np.isfinite(cost):
        raise DidNotConverge("the start of the iteration has no finite residuals")
    steps = 0
    converged = False
    while steps < max_steps and not converged and damping < _MAX_DAMPING:
        steps += 1
        step, change = _damped_step(r, J, damping)
        if change <= tolerance * (1.0 + np.sqrt(2 * cost)):
            converged = True
        trial = retract(state, step)
        r_trial, J_trial = linearize(trial)
        cost_trial = 0.5 * float(r_trial @ r_trial)
        if cost_trial <= cost:
            state, r, J, cost = trial, r_trial, J_trial, cost_trial
            damping = max(damping / 10, 1e-12)
        else:
            damping *= 10
    return Minimum(state, r, J, Report(converged, steps, cost))


def require_convergence(report: Report, what: str) -> None:
    """Raise DidNotConverge naming `what` unless the iteration found a minimum."""
    if not report.converged:
        raise DidNotConverge(
            f"{what}: no minimum after {report.steps} steps (cost {report.cost:.3g}); "
            "the samples contradict each other or belong to different set-ups"
        )


def _damped_step(r: Array, J: Array, damping: float) -> tuple[Array, float]:
    """Step (n,) of the column-scaled damped normal equations, and the norm by which it moves r."""
    scale = np.sqrt(np.einsum("ij,ij->j", J, J))
    scale[scale == 0] = 1.0
    A = J / scale
    normal = A.T @ A
    normal[np.diag_indices_from(normal)] += damping
    try:
        step = np.linalg.solve(normal, -(A.T @ r))
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(normal, -(A.T @ r), rcond=None)[0]
    return step / scale, float(np.linalg.norm(A @ step))
