"""Conventional TCP calibration (paper section III-A, Eq. 1-2): touch one fixed point with varied wrists."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.observability import Axes, missing_rotation, turned_axes
from vgrd.calibration.touches import TouchSet, studentized_residuals
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Array
from vgrd.geometry.covariance import covariance_from, observability
from vgrd.judging.thresholds import OPEN_TCP_MM

_TOLERANCE = 2.5e-3  # mm per mm and touch, as in `tcp.surface`


@dataclass(frozen=True, slots=True, eq=False)
class FixedPointResult:
    """tcp_in_wrist, point_in_base: (3,) mm; covariance: (6, 6) of both, in this order.

    residuals_mm: (m, 3), base frame; whitened: the same in sigmas, (m, 3), wrist frame; jacobian:
    (3 m, 6) of these; scores: (m,) sigmas each touch is off; freedom: measured directions minus
    unknowns. open_axis: (3,) unit vector in the wrist along which the TCP stays open and is taken as
    0 mm, None where all of it is determined.
    """

    tcp_in_wrist: Array
    point_in_base: Array
    covariance: Array
    residuals_mm: Array
    whitened: Array
    jacobian: Array
    scores: Array
    degrees_of_freedom: int
    open_axis: Array | None = None


def calibrate_fixed_point(touches: TouchSet, *, allow_open_axis: bool = False) -> FixedPointResult:
    """Weighted least squares of `R_i p_T - p_f = -t_i`.

    allow_open_axis: the wrist may turn about one axis only, as that of a 4-axis arm; the TCP along it then
    has a sigma of 500 mm. Raises TooFewObservations, or NotObservable with the rotation that is missing.
    """
    m = len(touches)
    if m < 3:
        raise TooFewObservations(f"a TCP from one fixed point needs at least 3 touches, got {m}")
    if (measured := touches.equations()) < 6:
        raise TooFewObservations(
            f"a TCP from one fixed point needs 6 directions that were measured, the {m} touches have {measured}: "
            "give sigma_mm of what they measured, inf only where they did not"
        )
    A = _rows(touches)
    B = touches.base_sqrt_informations()
    b = -np.einsum("mij,mj->mi", B, touches.translations).ravel()
    rank = observability(_rows(touches.measured()), np.ones(6), _TOLERANCE).rank
    open_axis = _only_axis(touches) if rank == 5 and allow_open_axis else None
    if rank < 6 and open_axis is None:
        raise NotObservable(
            f"fixed point: {rank} of 6 unknowns are determined: "
            + missing_rotation(list(touches.rotations)),
            rank=rank,
            unknowns=6,
        )
    J, known = A, b
    if open_axis is not None:
        J = np.vstack([A, np.append(open_axis, np.zeros(3)) / OPEN_TCP_MM])
        known = np.append(b, 0.0)
    x = np.linalg.lstsq(J, known, rcond=None)[0]
    whitened = (A @ x - b).reshape(-1, 3)
    return FixedPointResult(
        tcp_in_wrist=x[:3],
        point_in_base=x[3:],
        covariance=covariance_from(J),
        residuals_mm=touches.rotations @ x[:3] + touches.translations - x[3:],
        whitened=whitened,
        jacobian=A,
        scores=studentized_residuals(whitened, A),
        degrees_of_freedom=touches.equations() - rank,
        open_axis=open_axis,
    )


def _only_axis(touches: TouchSet) -> Array | None:
    """Axis (3,) in the wrist about which alone it turned, its largest part positive; else None."""
    count, axis = turned_axes([R.T for R in touches.rotations])
    sign = np.sign(axis[np.argmax(np.abs(axis))])
    return np.asarray(sign * axis) if count is Axes.ONE else None


def _rows(touches: TouchSet) -> Array:
    """Whitened derivative (3 m, 6) of `R_i p_T - p_f`."""
    B = touches.base_sqrt_informations()
    return np.concatenate([B @ touches.rotations, -B], axis=2).reshape(-1, 6)
