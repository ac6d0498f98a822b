"""What the TCP from a plane and from a ball share: one equation per touch, off a surface."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from vgrd.calibration.touches import outlier_scores
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Array
from vgrd.geometry.covariance import covariance_from, observability

TOLERANCE = 2.5e-3

SurfaceT = TypeVar("SurfaceT")


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceResult(Generic[SurfaceT]):
    """tcp_in_wrist: (3,) mm; covariance: (3, 3) of it, mm^2.

    residuals_mm: (m,) off the surface; whitened: the same in sigmas, (m, 1); scores: (m,) sigmas
    each touch is off; freedom: touches that count minus unknowns.
    """

    tcp_in_wrist: Array
    surface: SurfaceT
    covariance: Array
    residuals_mm: Array
    whitened: Array
    scores: Array
    freedom: int


def solve_linear(rows: Array, right: Array) -> Array:
    """Shortest least-squares solution (n,) of rows (m, n) @ x == right (m,)."""
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-9)[0], dtype=np.float64)


def surface_result(
    tcp: Array, surface: SurfaceT, residuals_mm: Array, jacobian: Array, weights: Array
) -> SurfaceResult[SurfaceT]:
    """Result of a fit: residuals_mm (m,), jacobian (m, n) with the TCP first, weights (m,) 1/sigma."""
    J = jacobian * weights[:, None]
    whitened = (residuals_mm * weights)[:, None]
    return SurfaceResult(
        tcp_in_wrist=tcp,
        surface=surface,
        covariance=covariance_from(J)[:3, :3],
        residuals_mm=residuals_mm,
        whitened=whitened,
        scores=outlier_scores(whitened, J),
        freedom=int(np.sum(weights > 0)) - jacobian.shape[1],
    )


def require_touches(weights: Array, unknowns: int, what: str) -> None:
    """Raise TooFewObservations when fewer touches than unknowns have a weight."""
    count = int(np.sum(weights > 0))
    if count < unknowns:
        raise TooFewObservations(f"{what}: at least {unknowns} touches are needed, got {count}")


def require_rank(jacobian: Array, what: str, remedy: str) -> None:
    """Raise NotObservable with the remedy unless all columns (m, n) are independent."""
    unknowns = jacobian.shape[1]
    rank = observability(jacobian, np.ones(unknowns), TOLERANCE).rank
    if rank < unknowns:
        raise NotObservable(
            f"{what}: {rank} of {unknowns} unknowns are determined: {remedy}",
            rank=rank,
            unknowns=unknowns,
        )
