"""The universal method (paper section IV, Eq. 7-15): TCP and object from touches of CAD points."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vgrd.calibration.touches import studentized_residuals
from vgrd.calibration.universal.certificate import certify_rotation
from vgrd.calibration.universal.problem import (
    Equations,
    State,
    UniversalProblem,
    checked_points,
    retract,
)
from vgrd.calibration.universal.start import (
    linear_rotation,
    nearest_valley,
    reduced_cost,
    rotation_candidates,
)
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import covariance_from
from vgrd.geometry.least_squares import Convergence, Minimum, check_convergence, minimize
from vgrd.geometry.rotation_relaxation import Certificate, prove, relax

__all__ = [
    "Equations",
    "State",
    "UniversalMethod",
    "UniversalProblem",
    "UniversalResult",
    "calibrate_universal",
    "retract",
]

UniversalMethod = Literal["certified", "gauss-newton"]

_PAPERS_STEP = 1e-3  # norm of a step, mm and rad together: the paper's section VI
_PAPERS_STEPS = 100  # a bound only, the paper names none


@dataclass(frozen=True, slots=True, eq=False)
class UniversalResult:
    """object_from_base: X of Eq. 7; tcp_in_wrist: (3,) mm.

    covariance: (9, 9) of the left tangent of object_from_base and of tcp_in_wrist. residuals_mm:
    (m, 3), e_i of Eq. 12 in the object frame; whitened: the same in sigmas, (m, 3); jacobian:
    (3 m, 9) of these; scores: (m,) sigmas each touch is off; freedom: measured directions minus
    unknowns. certificate: whether this is the global optimum.
    """

    object_from_base: Pose
    tcp_in_wrist: Array
    covariance: Array
    residuals_mm: Array
    whitened: Array
    jacobian: Array
    scores: Array
    degrees_of_freedom: int
    report: Convergence
    certificate: Certificate


def calibrate_universal(
    problem: UniversalProblem,
    method: UniversalMethod = "certified",
    start: tuple[Pose, Array] | None = None,
) -> UniversalResult:
    """Lowest weighted sum of squares of Eq. 8.

    "certified" ends in the proven global optimum (where the semidefinite relaxation is not tight:
    in the best of many starts). "gauss-newton" is Eq. 9-15 as published, from
    `start` (object_from_base, tcp_in_wrist (3,) mm), by default identity and zero: it may end in
    a wrong optimum, which the certificate then shows. Raises InputError, TooFewObservations,
    NotObservable (with the motion that is missing) or DidNotConverge.
    """
    p = checked_points(problem)
    equations = Equations(p, problem.touches)
    K = reduced_cost(p, problem.touches)
    if method == "gauss-newton":
        X, tcp = start or (Pose.identity(), np.zeros(3))
        best = _gauss_newton(equations, (X.rotation, X.translation, np.asarray(tcp)))
        certificate = certify_rotation(K.T @ K, best.state[0])
    else:
        best, certificate = _global_optimum(equations, K)
    equations.check_rank(best.state)
    check_convergence(best.report, "universal method")
    R, t, tcp = best.state
    return UniversalResult(
        object_from_base=Pose(R, t),
        tcp_in_wrist=tcp,
        covariance=covariance_from(best.jacobian),
        residuals_mm=equations.residuals_mm(best.state),
        whitened=best.residuals.reshape(-1, 3),
        jacobian=best.jacobian,
        scores=studentized_residuals(best.residuals.reshape(-1, 3), best.jacobian),
        degrees_of_freedom=problem.touches.equations() - 9,
        report=best.report,
        certificate=certificate,
    )


def _global_optimum(equations: Equations, K: Array) -> tuple[Minimum[State], Certificate]:
    """The linear solution where that is proven best, else the relaxation's, else the best valley."""
    C = K.T @ K
    best = _polish(equations, K, linear_rotation(K))
    certificate = prove(C, best.state[0].T)
    if certificate.tight:
        return best, certificate
    relaxed = relax(C)
    best = _lower(best, _polish(equations, K, relaxed.rotation.T))
    certificate = prove(C, best.state[0].T, relaxed.slack)
    if not certificate.tight:
        best = _lower(best, *(_polish(equations, K, R) for R in rotation_candidates(K)))
        certificate = prove(C, best.state[0].T, relaxed.slack)
    return best, certificate


def _lower(*minima: Minimum[State]) -> Minimum[State]:
    return min(minima, key=lambda minimum: minimum.report.cost)


def _polish(equations: Equations, K: Array, R_X: Array) -> Minimum[State]:
    """Bottom of the valley of a rotation of X."""
    start = equations.start(nearest_valley(K, R_X))
    return minimize(equations.linearize, retract, start, damping=1e-9)


def _gauss_newton(equations: Equations, state: State) -> Minimum[State]:
    """Eq. 9-15: full steps until one is shorter than 1e-3 (mm and rad in one norm)."""
    steps, converged = 0, False
    r, J = equations.linearize(state)
    while steps < _PAPERS_STEPS and not converged:
        step = np.linalg.lstsq(J, -r, rcond=None)[0]
        state = retract(state, np.asarray(step, dtype=np.float64))
        r, J = equations.linearize(state)
        steps += 1
        converged = float(np.linalg.norm(step)) < _PAPERS_STEP
    return Minimum(state, r, J, Convergence(converged, steps, 0.5 * float(r @ r)))
