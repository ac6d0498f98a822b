"""TCP from touches of a ball (paper section III-A), its radius known or not, with varied wrists."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.motion import missing_rotation
from vgrd.calibration.tcp_surface import (
    TOLERANCE,
    SurfaceResult,
    require_rank,
    require_touches,
    solve_linear,
    surface_result,
)
from vgrd.calibration.touches import TouchSet
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.covariance import observability
from vgrd.geometry.least_squares import Minimum, minimize, require_convergence


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """center_in_base: (3,) mm; radius_mm: of the ball, the tip's own radius included."""

    center_in_base: Array
    radius_mm: float


def calibrate_sphere(touches: TouchSet, radius_mm: float | None = None) -> SurfaceResult[Sphere]:
    """Least squares of `|R_i p_T + t_i - c| == r` over p_T, c and, where it is unknown, r.

    Raises InputError, TooFewObservations, DidNotConverge, or NotObservable with what is missing.
    """
    if radius_mm is not None and not 0 < radius_mm < np.inf:
        raise InputError(f"the radius of a ball is a positive number of mm, got {radius_mm}")
    unknowns = 6 if radius_mm else 7
    counts = np.isfinite(touches.lateral_sigma_mm) | np.isfinite(touches.axial_sigma_mm)
    require_touches(counts.astype(float), unknowns, "ball")
    problem = _SphereProblem(touches, radius_mm)
    best = problem.fit(problem.start(counts), counts.astype(float))
    best = problem.fit(best.state, problem.weights(best.state))
    require_convergence(best.report, "ball")
    residuals, J = problem.raw(best.state)
    weights = problem.weights(best.state)
    J = J[:, :unknowns]
    remedy = (
        missing_rotation(list(touches.rotations))
        if observability(_fixed_point_rows(touches), np.ones(6), TOLERANCE).rank < 6
        else "touch the ball from several sides, each with the wrist tilted differently"
    )
    require_rank(J[weights > 0], "ball", remedy)
    tcp, center, radius = best.state
    return surface_result(tcp, Sphere(center, radius), residuals, J, weights)


SphereState = tuple[Array, Array, float]


class _SphereProblem:
    """(p_T, c, r); a known r stays."""

    def __init__(self, touches: TouchSet, radius_mm: float | None) -> None:
        self._touches = touches
        self._radius = radius_mm

    def start(self, counts: NDArray[np.bool_]) -> SphereState:
        """As if the ball were a point: what is left over is about its radius."""
        rows = _fixed_point_rows(self._touches)[np.repeat(counts, 3)]
        x = solve_linear(rows, -self._touches.translations[counts].ravel())
        off = np.linalg.norm(self._tips(x[:3]) - x[3:], axis=1)[counts]
        return x[:3], x[3:], self._radius or float(np.mean(off))

    def weights(self, state: SphereState) -> Array:
        """One over sigma across the surface, (m,)."""
        off = self._tips(state[0]) - state[1]
        return 1 / self._touches.sigma_along(off / np.linalg.norm(off, axis=1)[:, None])

    def fit(self, state: SphereState, weights: Array) -> Minimum[SphereState]:
        """Nearest minimum with these weights (m,)."""
        free = np.array([1.0] * 6 + [0.0 if self._radius else 1.0])

        def linearize(state: SphereState) -> tuple[Array, Array]:
            r, J = self.raw(state)
            return r * weights, J * weights[:, None] * free

        def retract(state: SphereState, step: Array) -> SphereState:
            step = step * free
            return state[0] + step[:3], state[1] + step[3:6], state[2] + float(step[6])

        return minimize(linearize, retract, state, damping=1e-3)

    def raw(self, state: SphereState) -> tuple[Array, Array]:
        """Distances (m,) mm and their derivative (m, 7) by p_T, c, r."""
        tcp, center, radius = state
        off = self._tips(tcp) - center
        length = np.linalg.norm(off, axis=1)
        u = off / length[:, None]
        by_tcp = np.einsum("mi,mij->mj", u, self._touches.rotations)
        return length - radius, np.column_stack([by_tcp, -u, -np.ones(len(u))])

    def _tips(self, tcp: Array) -> Array:
        out: Array = self._touches.rotations @ tcp + self._touches.translations
        return out


def _fixed_point_rows(touches: TouchSet) -> Array:
    R = touches.rotations
    return np.concatenate([R, np.broadcast_to(-np.eye(3), R.shape)], axis=2).reshape(-1, 6)
