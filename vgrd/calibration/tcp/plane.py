"""TCP from touches of a plane (paper section III-A), known or not, with varied wrists."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.observability import missing_rotation
from vgrd.calibration.tcp.surface import (
    SPARE,
    SurfaceResult,
    check_one_minimum,
    check_rank,
    check_touches,
    check_turns,
    solve_linear,
    surface_result,
    tip_sigma_mm,
)
from vgrd.calibration.touches import TouchSet
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.least_squares import Minimum, check_convergence, minimize
from vgrd.judging.thresholds import PLANE_LINE

_DIRECTIONS = 200  # normals tried, 10 degrees apart: a start that near ends in its minimum
_STARTS = 4  # refined to the end: the plane may lie on either side of the tips
_SAME_DIRECTION = 0.9  # cosine: normals within 26 degrees are one start


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Points y of the base with normal_in_base (3,) @ y == offset_mm; the normal is a unit vector."""

    normal_in_base: Array
    offset_mm: float


def calibrate_plane(touches: TouchSet, plane: Plane | None = None) -> SurfaceResult[Plane]:
    """Least squares of `n @ (R_i p_T + t_i) == d`, over p_T and, where it is unknown, the plane.

    An unknown normal is searched over all directions. Raises InputError, TooFewObservations,
    DidNotConverge, or NotObservable with the motion that is missing.
    """
    fit = fit_plane(touches, plane)
    check_one_plane(fit)
    return fit


def fit_plane(touches: TouchSet, plane: Plane | None = None) -> SurfaceResult[Plane]:
    """The same with its rivals not judged yet: for touches of which some may be bad."""
    if plane is not None:
        n = np.asarray(plane.normal_in_base, dtype=np.float64)
        if n.shape != (3,) or not abs(float(np.linalg.norm(n)) - 1) < 1e-6:
            raise InputError("the normal of a plane is a unit vector of three numbers")
        return _known_plane(touches, Plane(n, plane.offset_mm))
    return _unknown_plane(touches)


def check_one_plane(fit: SurfaceResult[Plane]) -> None:
    """Raise NotObservable where another plane and TCP explain the touches as well."""
    check_one_minimum(fit, "unknown plane", "touch more places, the wrist tilted further")


def _known_plane(touches: TouchSet, plane: Plane) -> SurfaceResult[Plane]:
    n = plane.normal_in_base
    weights = 1 / touches.sigma_along(np.broadcast_to(n, (len(touches), 3)))
    rows = n @ touches.rotations
    check_touches(weights, 3, "plane")
    check_rank(rows[weights > 0], "plane", _tilt(touches))
    b = plane.offset_mm - touches.translations @ n
    tcp = solve_linear(rows * weights[:, None], b * weights)
    return surface_result(tcp, plane, rows @ tcp - b, rows, weights, n)


def _unknown_plane(touches: TouchSet) -> SurfaceResult[Plane]:
    finite = np.isfinite(touches.lateral_sigma_mm) | np.isfinite(touches.axial_sigma_mm)
    center = touches.translations[finite].mean(axis=0)
    problem = _PlaneProblem(touches, center)
    check_touches(finite.astype(float), 6 + SPARE, "unknown plane")
    check_turns(touches.subset(np.flatnonzero(finite)), 6, "unknown plane")
    best, *minima = problem.minima(finite.astype(float))
    tcp, n, d = best.state
    residuals, J = problem.raw(best.state)
    weights = problem.weights(n)
    y = touches.rotations @ tcp + touches.translations
    lever = max(float(np.std(y[finite], axis=0).max()), 1.0)
    scaled = J[weights > 0] * np.array([1, 1, 1, 1, 1 / lever, 1 / lever])
    noise = np.array([0, 0, 0, 0, 1, 1]) * tip_sigma_mm(touches) / lever
    remedy = _spread(y[finite], n) or _tilt(touches)
    check_rank(scaled, "unknown plane", remedy, noise)
    check_convergence(best.report, "plane")
    surface = Plane(n, d + float(n @ center))
    rivals = [(minimum.state[0], minimum.report.cost) for minimum in minima]
    return surface_result(tcp, surface, residuals, J, weights, n, rivals)


PlaneState = tuple[Array, Array, float]


class _PlaneProblem:
    """(p_T, n, d) with `n @ (R_i p_T + t_i - center) == d`."""

    def __init__(self, touches: TouchSet, center: Array) -> None:
        self._touches = touches
        self._R, self._t = touches.rotations, touches.translations - center

    def minima(self, weights: Array) -> list[Minimum[PlaneState]]:
        """Bottoms of the valleys of the starts, weighted anew, the lowest first."""
        ends = [self.fit(n) for n in self.starts(weights)]
        refined = [self.fit(end.state[1], end.state[0]) for end in ends]
        return sorted(refined, key=lambda minimum: minimum.report.cost)

    def starts(self, weights: Array) -> list[Array]:
        """Normals (3,) that leave little when p_T and d are eliminated, best first."""
        normals = _half_sphere(_DIRECTIONS)
        rows = np.einsum("kj,mjl->kml", normals, self._R)
        A = np.concatenate([rows, -np.ones((*rows.shape[:2], 1))], axis=2) * weights[:, None]
        b = -(normals @ self._t.T) * weights
        Q, _ = np.linalg.qr(A)
        left = b - np.einsum("kmi,kji,kj->km", Q, Q, b)
        chosen: list[Array] = []
        for k in np.argsort(np.sum(left**2, axis=1)):
            if all(abs(float(normals[k] @ normal)) < _SAME_DIRECTION for normal in chosen):
                chosen.append(normals[k])
        return chosen[:_STARTS]

    def weights(self, n: Array) -> Array:
        """One over sigma along the normal, (m,)."""
        return 1 / self._touches.sigma_along(np.broadcast_to(n, (len(self._touches), 3)))

    def fit(self, n: Array, tcp: Array | None = None) -> Minimum[PlaneState]:
        """Nearest minimum, weighted as the normal at its start says."""
        weights = self.weights(n)
        if tcp is None:
            rows = np.column_stack([n @ self._R, -np.ones(len(self._t))])
            x = solve_linear(rows * weights[:, None], -(self._t @ n) * weights)
            state: PlaneState = (x[:3], n, float(x[3]))
        else:
            state = (tcp, n, float(np.mean((self._R @ tcp + self._t) @ n)))

        def linearize(state: PlaneState) -> tuple[Array, Array]:
            r, J = self.raw(state)
            return r * weights, J * weights[:, None]

        return minimize(linearize, _retract_plane, state)

    def raw(self, state: PlaneState) -> tuple[Array, Array]:
        """Distances (m,) mm and their derivative (m, 6) by p_T, d and two tilts of n."""
        tcp, n, d = state
        y = self._R @ tcp + self._t
        tilts = y @ across(n).T
        return y @ n - d, np.column_stack([n @ self._R, -np.ones(len(y)), tilts])


def _retract_plane(state: PlaneState, step: Array) -> PlaneState:
    tcp, n, d = state
    tilted = n + step[4:] @ across(n)
    return tcp + step[:3], tilted / np.linalg.norm(tilted), d + float(step[3])


def _tilt(touches: TouchSet) -> str:
    """What is missing when the plane was seen from too few sides."""
    return (
        f"{missing_rotation(list(touches.rotations))}; turns about the normal of the plane do "
        "not count"
    )


def _spread(tips: Array, normal: Array) -> str:
    """What is missing when the touched places do not span the plane."""
    s = np.linalg.svd((tips - tips.mean(axis=0)) @ across(normal).T, compute_uv=False)
    if s[1] > PLANE_LINE * max(float(s[0]), 1e-9) and s[1] > 1:
        return ""
    return "the plane was touched at one place or on one line; touch places far beside it"


def across(normal: Array) -> Array:
    """Two unit vectors (2, 3) across a direction."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:])


def _half_sphere(count: int) -> Array:
    """Evenly spread directions (count, 3), no two opposite (golden spiral)."""
    k = np.arange(count) + 0.5
    z = k / count
    angle = np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
