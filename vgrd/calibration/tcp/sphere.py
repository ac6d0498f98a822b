"""TCP from touches of a ball (paper section III-A), its radius known or not, with varied wrists."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.tcp.surface import (
    SPARE,
    SurfaceResult,
    check_one_minimum,
    check_rank,
    check_touches,
    check_turns,
    fixed_point_rows,
    solve_linear,
    surface_result,
    tip_sigma_mm,
)
from vgrd.calibration.touches import TouchSet
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.least_squares import Minimum, check_convergence, minimize

_SIDES = "touch the ball from several sides, each with the wrist tilted differently"
_DIRECTIONS = 30  # 40 degrees apart: a start this near a minimum ends in it
_SHARES = (0.35, 0.7, 1.0)  # of a known radius, by which a TCP from a point may be off
_SHIFTS_MM = (1.5, 4.0, 10.0, 25.0, 60.0)  # the same for balls of 3 to 120 mm
_STARTS = 6  # refined to the end: the ball may lie on either side of the tips
_STARTS_OF_FEW = (
    30  # below _NEEDED touches: with 6 starts 4 of 282 fits missed the lowest valley, with 12 one
)
_DISTINCT = 0.3  # of the larger radius
_NEEDED = 9  # touches that tell one valley from another: two more than unknowns
_CENTER_RCOND = 1e-6  # directions that no touch tells apart from rounding
_TINY_MM = 1e-9  # of the way from centre to tip: no direction at all


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """center_in_base: (3,) mm; radius_mm: of the ball, the tip's own radius included."""

    center_in_base: Array
    radius_mm: float


def calibrate_sphere(touches: TouchSet, radius_mm: float | None = None) -> SurfaceResult[Sphere]:
    """Least squares of `|R_i p_T + t_i - c| == r` over p_T, c and, where it is unknown, r.

    The lowest of the minima below several starts. Raises InputError, TooFewObservations,
    DidNotConverge, or NotObservable with what is missing.
    """
    fit = fit_sphere(touches, radius_mm)
    check_one_sphere(fit)
    return fit


def fit_sphere(touches: TouchSet, radius_mm: float | None = None) -> SurfaceResult[Sphere]:
    """The same with its rivals not judged yet: for touches of which some may be bad."""
    if radius_mm is not None and not 0 < radius_mm < np.inf:
        raise InputError(f"the radius of a ball is a positive number of mm, got {radius_mm}")
    unknowns = 6 if radius_mm else 7
    counts = np.isfinite(touches.lateral_sigma_mm) | np.isfinite(touches.axial_sigma_mm)
    check_touches(counts.astype(float), unknowns + SPARE, "ball")
    check_turns(touches.subset(np.flatnonzero(counts)), unknowns, "ball")
    problem = _SphereProblem(touches, radius_mm, counts)
    best, *minima = problem.minima()
    residuals, J = problem.raw(best.state)
    weights = problem.weights(best.state)
    J = J[:, :unknowns]
    noise = problem.direction_noise(best.state) * np.array([1.0] * 6 + [0.0])[:unknowns]
    check_rank(J[weights > 0], "ball", _SIDES, noise)
    check_convergence(best.report, "ball")
    tcp, center, radius = best.state
    rivals = [(minimum.state[0], minimum.report.cost) for minimum in minima]
    normals = problem.normals(best.state)
    return surface_result(tcp, Sphere(center, radius), residuals, J, weights, normals, rivals)


def check_one_sphere(fit: SurfaceResult[Sphere]) -> None:
    """Raise NotObservable where another ball and TCP explain the touches as well."""
    check_one_minimum(fit, "ball", _SIDES)


SphereState = tuple[Array, Array, float]


class _SphereProblem:
    """(p_T, c, r); a known r stays."""

    def __init__(
        self, touches: TouchSet, radius_mm: float | None, counts: NDArray[np.bool_]
    ) -> None:
        self._touches = touches
        self._radius = radius_mm
        self._counts = counts

    def minima(self) -> list[Minimum[SphereState]]:
        """Bottoms of the valleys of the most promising starts, the one with the least misfit first."""
        ends = [self._bottom(start) for start in self._starts()]
        ends.append(self._bottom(self._turned_over(min(ends, key=self._misfit).state)))
        return sorted(ends, key=self._misfit)

    def _misfit(self, end: Minimum[SphereState]) -> float:
        """Sum of squares without the worst third, where that can be spared: bad touches choose no valley."""
        squares = np.sort(end.residuals[self._counts] ** 2)
        return float(squares[: max(len(squares) - len(squares) // 3, _NEEDED)].sum())

    def _bottom(self, start: SphereState) -> Minimum[SphereState]:
        end = self._fit(start, self._counts.astype(float))
        return self._fit(end.state, self.weights(end.state))

    def _turned_over(self, state: SphereState) -> SphereState:
        """The same ball touched from the other side: nearly as good where all sides are alike in the wrist."""
        tcp, center, radius = state
        sides = np.einsum("mi,mij->mj", self._ways(state)[1], self._touches.rotations)
        return tcp - 2 * radius * sides[self._counts].mean(axis=0), center, radius

    def normals(self, state: SphereState) -> Array:
        """Directions (m, 3) out of the ball, in the base."""
        return self._ways(state)[1]

    def weights(self, state: SphereState) -> Array:
        """One over sigma across the surface, (m,)."""
        return 1 / self._touches.sigma_along(self._ways(state)[1])

    def direction_noise(self, state: SphereState) -> float:
        """Rms error, per component, of the directions from the centre to the tips."""
        length = self._ways(state)[0][self._counts]
        return tip_sigma_mm(self._touches) * float(np.sqrt(np.mean(length**-2.0)))

    def raw(self, state: SphereState) -> tuple[Array, Array]:
        """Distances (m,) mm and their derivative (m, 7) by p_T, c, r."""
        length, u = self._ways(state)
        J_tcp = np.einsum("mi,mij->mj", u, self._touches.rotations)
        return length - state[2], np.column_stack([J_tcp, -u, -np.ones(len(u))])

    def _ways(self, state: SphereState) -> tuple[Array, Array]:
        """How far (m,) and in which direction (m, 3) the tips are from the centre."""
        arms = self._touches.rotations @ state[0] + self._touches.translations - state[1]
        length = np.maximum(np.linalg.norm(arms, axis=1), _TINY_MM)
        return length, arms / length[:, None]

    def _fit(self, state: SphereState, weights: Array) -> Minimum[SphereState]:
        """Nearest minimum with these weights (m,)."""
        free = np.array([1.0] * 6 + [0.0 if self._radius else 1.0])

        def linearize(state: SphereState) -> tuple[Array, Array]:
            r, J = self.raw(state)
            return r * weights, J * weights[:, None] * free

        def retract(state: SphereState, step: Array) -> SphereState:
            step = step * free
            return state[0] + step[:3], state[1] + step[3:6], state[2] + float(step[6])

        return minimize(linearize, retract, state, damping=1e-3)

    def _starts(self) -> list[SphereState]:
        """As if the ball were a point, and the best distinct ones about it, each with its own centre."""
        touches = self._touches.subset(np.flatnonzero(self._counts))
        point_tcp = solve_linear(fixed_point_rows(touches), -touches.translations.ravel())[:3]
        tried = sorted(self._balls(touches, point_tcp), key=lambda pair: pair[0])
        states: list[SphereState] = []
        for _, state in tried:
            if all(
                np.linalg.norm(state[0] - other[0]) > _DISTINCT * max(state[2], other[2])
                for other in states
            ):
                states.append(state)
        return states[: _STARTS if len(touches) >= _NEEDED else _STARTS_OF_FEW]

    def _balls(self, touches: TouchSet, point_tcp: Array) -> Iterator[tuple[float, SphereState]]:
        """Sum of squares and state for TCPs (3,) about one that takes the ball for a point.

        That one is off by the mean direction, in the wrist, in which the ball was touched.
        """
        shares = np.array(_SHARES) * self._radius if self._radius else np.array(_SHIFTS_MM)
        shifts = (shares[:, None, None] * _sphere(_DIRECTIONS)).reshape(-1, 3)
        for shift in (np.zeros(3), *shifts):
            tips = touches.rotations @ (point_tcp + shift) + touches.translations
            middle = tips.mean(axis=0)
            about = tips - middle
            rows = np.column_stack([2 * about, np.ones(len(about))])
            x = np.linalg.lstsq(rows, np.sum(about**2, axis=1), rcond=_CENTER_RCOND)[0]
            radius = self._radius or float(np.sqrt(max(x[3] + x[:3] @ x[:3], _TINY_MM)))
            residuals = np.linalg.norm(about - x[:3], axis=1) - radius
            yield float(residuals @ residuals), (point_tcp + shift, middle + x[:3], radius)


def _sphere(count: int) -> Array:
    """Evenly spread directions (count, 3) (golden spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
