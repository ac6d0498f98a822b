"""Rotation centre from one hole of the turning object, seen in several turns; Eq. 20-25 without a tag.

The hole of the bearing itself stands still: its mean is p_f. Any other hole runs on a circle about the
axis, whose centre is the point of the axis at the hole's height. Both are points of the axis, which is
all that Eq. 19 asks for.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Array, exp_rotation
from vgrd.geometry.covariance import covariance_from
from vgrd.geometry.least_squares import minimize, require_convergence

_STILL = 0.999
_LEAST_PICTURES = 3
_ARC_SIGMAS = 10.0  # how far the hole must leave its mean chord to tell a circle from a line


@dataclass(frozen=True, slots=True, eq=False)
class HolePath:
    """Path of a hole in the camera, mm.

    center_in_camera: (3,) with its covariance (3, 3); axis_in_camera: (3,), None where the hole is on
    the axis; radius_mm; residuals_mm: (n,), distance of each picture from the path.
    """

    center_in_camera: Array
    covariance: Array
    axis_in_camera: Array | None
    radius_mm: float
    residuals_mm: Array


def find_hole_path(points_in_camera: Array, sigma_mm: float) -> HolePath:
    """Centre, and axis where it can be told, from places (n, 3) of one hole while the object turns.

    sigma_mm: of one coordinate of a place. The point of the axis in tag B, p_f, is `center_in_camera`
    in the tag of any of the pictures. Raises InputError, TooFewObservations below 3 pictures and
    NotObservable where the places do not bend enough to tell a circle.
    """
    q = np.array(points_in_camera, dtype=np.float64)
    if q.ndim != 2 or q.shape[1] != 3 or not np.isfinite(q).all() or not sigma_mm > 0:
        raise InputError(f"finite places (n, 3) and a sigma above 0 are needed, got {q.shape}")
    n = len(q)
    if n < _LEAST_PICTURES:
        raise TooFewObservations(
            f"a rotation centre needs a hole in at least {_LEAST_PICTURES} pictures, got {n}"
        )
    mean = q.mean(axis=0)
    off = q - mean
    if float(np.sum(off**2)) / sigma_mm**2 < 2 * gammaincinv(1.5 * (n - 1), _STILL):
        still = np.linalg.norm(off, axis=1)
        return HolePath(mean, np.eye(3) * sigma_mm**2 / n, None, 0.0, still)
    spread, axes = np.linalg.svd(off, full_matrices=False)[1:]
    if spread[1] < _ARC_SIGMAS * sigma_mm:
        raise NotObservable(
            f"the hole moved along {spread[0] / np.sqrt(n):.1f} mm rms, but bends from a line by "
            f"{spread[1] / np.sqrt(n):.2f} mm only: turn the object by a third of a turn or more "
            "between the pictures, or take a hole further from the centre",
            rank=4,
            unknowns=6,
        )
    return _circle(q, mean, axes, sigma_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Circle:
    center: Array
    axis: Array
    radius: float


def _circle(q: Array, mean: Array, axes: Array, sigma_mm: float) -> HolePath:
    """Least squares of the distances from a circle, from the linear one in the plane of the places."""
    xy = (q - mean) @ axes[:2].T
    rows = np.column_stack([2 * xy, np.ones(len(q))])
    x, y, c = np.linalg.lstsq(rows, np.sum(xy**2, axis=1), rcond=None)[0]
    start = _Circle(mean + x * axes[0] + y * axes[1], axes[2], float(np.sqrt(c + x * x + y * y)))

    def linearize(at: _Circle) -> tuple[Array, Array]:
        d = q - at.center
        height = d @ at.axis
        flat = d - height[:, None] * at.axis
        length = np.linalg.norm(flat, axis=1)
        out = flat / length[:, None]
        by_turn = np.cross(at.axis, d)
        r = np.concatenate([height, length - at.radius]) / sigma_mm
        up = np.column_stack([np.broadcast_to(-at.axis, d.shape), by_turn @ axes[:2].T])
        across = np.column_stack(
            [-out, -(height / length)[:, None] * (np.cross(at.axis, flat) @ axes[:2].T)]
        )
        radius = np.repeat([0.0, -1.0], len(q))[:, None]
        return r, np.hstack([np.vstack([up, across]), radius]) / sigma_mm

    def retract(at: _Circle, step: Array) -> _Circle:
        turn = exp_rotation(step[3:5] @ axes[:2])
        return _Circle(at.center + step[:3], turn @ at.axis, at.radius + float(step[5]))

    minimum = minimize(linearize, retract, start)
    require_convergence(minimum.report, "path of a hole")
    best = minimum.state
    off = minimum.residuals.reshape(2, -1) * sigma_mm
    return HolePath(
        best.center,
        covariance_from(minimum.jacobian)[:3, :3],
        best.axis,
        best.radius,
        np.linalg.norm(off, axis=0),
    )
