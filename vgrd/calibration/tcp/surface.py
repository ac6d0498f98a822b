"""What the TCP from a plane and from a ball share: one equation per touch, off a surface.

Both fits are free to move where their Jacobian is noise of full rank: a ball shrinks to nothing, a
plane turns about the line that was touched. So the turns of the wrist decide first, as the robot
reports them; then a direction has to stand out of what the touch noise alone does to the Jacobian; and
no other minimum may explain the touches as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from vgrd.calibration.observability import missing_rotation
from vgrd.calibration.touches import TouchSet, studentized_residuals
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Array
from vgrd.geometry.covariance import covariance_from, observability

TOLERANCE = (
    2.5e-3  # mm per mm and touch: 0.1 mm of touch noise then means 10 mm of TCP in 16 touches
)
SPARE = 1  # touch beyond the unknowns of a curved problem: without it several surfaces fit exactly
_BY_CHANCE = 20.0  # of chi2 between two minima: 1 in 100,000 for one unknown
_APART_SIGMA = 5.0  # of the TCP: two minima that noise does not make one
_APART_MM = 0.05  # no two TCPs that near are worth an alarm

SurfaceT = TypeVar("SurfaceT")


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceResult(Generic[SurfaceT]):
    """tcp_in_wrist: (3,) mm; covariance: (3, 3) of it, mm^2.

    residuals_mm: (m,) off the surface; whitened: the same in sigmas, (m, 1); jacobian: (m, n) of
    these; normals_in_base: (m, 3) out of the surface where it was touched; scores: (m,) sigmas each
    touch is off; freedom: touches that count minus unknowns. rivals: TCP (3,) and half the sum of
    squares, in sigmas, of the other minima that were found.
    """

    tcp_in_wrist: Array
    surface: SurfaceT
    covariance: Array
    residuals_mm: Array
    whitened: Array
    jacobian: Array
    normals_in_base: Array
    scores: Array
    degrees_of_freedom: int
    unknowns: int
    rivals: tuple[tuple[Array, float], ...] = ()


def solve_linear(rows: Array, right: Array) -> Array:
    """Shortest least-squares solution (n,) of rows (m, n) @ x == right (m,)."""
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-9)[0], dtype=np.float64)


def fixed_point_rows(touches: TouchSet) -> Array:
    """Derivative (3 m, 6) of `R_i p_T + t_i - c` by p_T and c."""
    R = touches.rotations
    return np.concatenate([R, np.broadcast_to(-np.eye(3), R.shape)], axis=2).reshape(-1, 6)


def surface_result(
    tcp: Array,
    surface: SurfaceT,
    residuals_mm: Array,
    jacobian: Array,
    weights: Array,
    normals_in_base: Array,
    rivals: Sequence[tuple[Array, float]] = (),
) -> SurfaceResult[SurfaceT]:
    """Result of a fit: residuals_mm (m,), jacobian (m, n) with the TCP first, weights (m,) 1/sigma.

    normals_in_base: (m, 3), or one for all (3,).
    """
    J = jacobian * weights[:, None]
    whitened = (residuals_mm * weights)[:, None]
    return SurfaceResult(
        tcp_in_wrist=tcp,
        surface=surface,
        covariance=covariance_from(J)[:3, :3],
        residuals_mm=residuals_mm,
        whitened=whitened,
        jacobian=J,
        normals_in_base=np.broadcast_to(normals_in_base, (len(J), 3)),
        scores=studentized_residuals(whitened, J),
        degrees_of_freedom=int(np.sum(weights > 0)) - jacobian.shape[1],
        unknowns=jacobian.shape[1],
        rivals=tuple(rivals),
    )


def check_touches(weights: Array, needed: int, surface: str) -> None:
    """Raise TooFewObservations when fewer touches than needed have a weight."""
    count = int(np.sum(weights > 0))
    if count < needed:
        raise TooFewObservations(f"{surface}: at least {needed} touches are needed, got {count}")


def check_turns(touches: TouchSet, unknowns: int, surface: str) -> None:
    """Raise NotObservable unless the wrist turned about two axes: else the TCP slides with the surface."""
    null_dimension = 6 - observability(fixed_point_rows(touches), np.ones(6), TOLERANCE).rank
    if null_dimension:
        _refuse(
            surface, unknowns - null_dimension, unknowns, missing_rotation(list(touches.rotations))
        )


def check_rank(jacobian: Array, surface: str, remedy: str, noise: Array | None = None) -> None:
    """Raise NotObservable with the remedy unless all columns (m, n) are independent.

    noise: (n,) mm, as of `observability`.
    """
    unknowns = jacobian.shape[1]
    rank = observability(jacobian, np.ones(unknowns), TOLERANCE, noise).rank
    if rank < unknowns:
        _refuse(surface, rank, unknowns, remedy)


def check_one_minimum(fit: SurfaceResult[SurfaceT], surface: str, remedy: str) -> None:
    """Raise NotObservable where a rival that chance explains as well has its TCP elsewhere.

    Bad touches have to be left out before: with them the wrong minimum may be the lowest.
    """
    squares = float(np.sum(fit.whitened**2))
    scale = max(1.0, squares / fit.degrees_of_freedom) if fit.degrees_of_freedom > 0 else 1.0
    for tcp, cost in fit.rivals:
        offset = tcp - fit.tcp_in_wrist
        apart = float(np.sqrt(offset @ np.linalg.solve(fit.covariance * scale, offset)))
        as_likely = 2 * cost - squares < _BY_CHANCE * scale
        if as_likely and apart > _APART_SIGMA and np.linalg.norm(offset) > _APART_MM:
            raise NotObservable(
                f"{surface}: two TCPs, {np.linalg.norm(offset):.1f} mm apart, explain the touches equally "
                f"well: {remedy}",
                rank=fit.unknowns - 1,
                unknowns=fit.unknowns,
            )


def tip_sigma_mm(touches: TouchSet) -> float:
    """Noise of the tip in one direction of those that were measured, a rough touch counting for less."""
    sigmas = np.column_stack([touches.lateral_sigma_mm] * 2 + [touches.axial_sigma_mm])
    measured = np.isfinite(sigmas)
    squares = np.sum(np.where(measured, sigmas, 0.0) ** 2, axis=1)
    squares = squares / np.maximum(measured.sum(axis=1), 1)
    return float(np.sqrt(1 / np.mean(1 / squares[squares > 0])))


def _refuse(surface: str, rank: int, unknowns: int, remedy: str) -> None:
    raise NotObservable(
        f"{surface}: {rank} of {unknowns} unknowns are determined: {remedy}",
        rank=rank,
        unknowns=unknowns,
    )
