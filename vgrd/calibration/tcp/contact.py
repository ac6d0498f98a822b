"""The TCP by the touches beside the object that a plan asks for (paper figure 3): of a point, a plane or a ball."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.tcp.fixed_point import calibrate_fixed_point
from vgrd.calibration.tcp.plane import Plane, calibrate_plane
from vgrd.calibration.tcp.sphere import Sphere, calibrate_sphere
from vgrd.calibration.tcp.surface import SurfaceResult
from vgrd.calibration.touches import TouchSet, arm_touches
from vgrd.errors import NotObservable
from vgrd.geometry import Array
from vgrd.model import Plan, Recording


@dataclass(frozen=True, slots=True, eq=False)
class ContactTcp:
    """tcp_in_wrist: (3,) mm; covariance: (3, 3) mm^2; open_axis: as of `FixedPointResult`.

    misses_mm, scores: (m,) how far each touch is off, and in sigmas of the fit to the others.
    """

    tcp_in_wrist: Array
    covariance: Array
    misses_mm: Array
    scores: Array
    open_axis: Array | None = None


def contact_tcp(recording: Recording, *, allow_open_axis: bool = False) -> ContactTcp:
    """TCP by `recording.points`: of an unknown plane or ball in those plans, else of one fixed point.

    allow_open_axis: as of `calibrate_fixed_point`; a plane or a ball always needs turns about two axes.
    Raises TooFewObservations, DidNotConverge, or NotObservable with the motion that is missing.
    """
    touches = arm_touches(recording.points, recording)
    if recording.plan.touches_surface:
        return _by_surface(recording.plan, touches)
    fixed = calibrate_fixed_point(touches, allow_open_axis=allow_open_axis)
    misses_mm = np.linalg.norm(fixed.residuals_mm, axis=1)
    covariance = fixed.covariance[:3, :3]
    return ContactTcp(fixed.tcp_in_wrist, covariance, misses_mm, fixed.scores, fixed.open_axis)


def _by_surface(plan: Plan, touches: TouchSet) -> ContactTcp:
    solve: Callable[[TouchSet], SurfaceResult[Plane] | SurfaceResult[Sphere]]
    solve = calibrate_plane if plan is Plan.PLANE else calibrate_sphere
    try:
        fit = solve(touches)
    except NotObservable as err:
        if turned_axes(list(touches.rotations))[0] is not Axes.ONE:
            raise
        raise NotObservable(
            f"{err}; an arm that cannot, as one with 4 axes, is taught by plan joint or conventional",
            rank=err.rank,
            unknowns=err.unknowns,
        ) from err
    return ContactTcp(fit.tcp_in_wrist, fit.covariance, np.abs(fit.residuals_mm), fit.scores)
