"""Pose of a known target from the pixels of its points (PnP)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vgrd.errors import DidNotConverge, InputError
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import covariance_from
from vgrd.geometry.least_squares import Minimum, minimize
from vgrd.geometry.pose import Array, Pose, hat

_PLANAR = 1e-4  # spread off a plane over that along it: 0.1 mm per metre; only the start minds
_COLLINEAR = 1e-3  # spread beside a line over that along it: turns about it have 1000 x the noise
_TOLERANCE_PX = 1e-7  # what is left of a step, in (1 + rms): below the digits of a pixel in a file


@dataclass(frozen=True, slots=True, eq=False)
class PointsPose:
    """camera_from_target; covariance: (6, 6), left tangent; rms_px: of u and v together."""

    camera_from_target: Pose
    covariance: Array
    rms_px: float


def pose_from_points(
    points_in_target: ArrayLike,
    pixels: ArrayLike,
    camera: CameraModel,
    start: Pose | None = None,
    *,
    sigma_px: float | None = None,
) -> PointsPose:
    """Pose with the lowest reprojection error; points (n, 3) mm, pixels (n, 2).

    Needs 4 coplanar or 6 other points. Without `start`: homography or DLT, for planes both
    mirrored solutions are refined and the better one is kept. sigma_px: of one coordinate; None
    takes it from the residuals. InputError on bad shapes and collinear points.
    """
    p, uv = checked_points(points_in_target, pixels)
    starts = [start] if start is not None else _starts(p, camera.normalize(uv))
    minima = [m for m in (_refine(p, uv, camera, s) for s in starts) if m is not None]
    if not minima:
        raise DidNotConverge("no pose puts the target in front of the camera: check the points")
    best = min(minima, key=lambda minimum: minimum.report.cost)
    squares = 2 * best.report.cost
    degrees_of_freedom = max(best.residuals.size - 6, 1)
    variance = squares / degrees_of_freedom if sigma_px is None else sigma_px**2
    return PointsPose(
        best.state,
        covariance_from(best.jacobian) * variance,
        float(np.sqrt(squares / best.residuals.size)),
    )


def checked_points(points_in_target: ArrayLike, pixels: ArrayLike) -> tuple[Array, Array]:
    """Arrays (n, 3) and (n, 2) fit for a pose; InputError names what is wrong with them."""
    p = np.asarray(points_in_target, dtype=np.float64)
    uv = np.asarray(pixels, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or uv.shape != (len(p), 2):
        raise InputError(
            f"points and pixels need shapes (n, 3) and (n, 2), got {p.shape} and {uv.shape}"
        )
    if not (np.isfinite(p).all() and np.isfinite(uv).all()):
        raise InputError("points and pixels must be finite")
    if len(p) < 4:
        raise InputError(f"a pose needs at least 4 points, got {len(p)}")
    spread = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if spread[1] <= _COLLINEAR * spread[0]:
        raise InputError("the target's points lie on one line: the pose is not determined")
    return p, uv


def _linearize_points(
    camera: CameraModel, camera_from_target: Pose, points_in_target: Array
) -> tuple[Array, Array]:
    """Pixels (n, 2) and their derivative (n, 2, 6) by a left perturbation of the pose."""
    q = camera_from_target @ points_in_target
    pixels, J = camera.linearize(q)
    return pixels, np.concatenate([J, -J @ hat(q)], axis=2)


def _refine(p: Array, uv: Array, camera: CameraModel, start: Pose) -> Minimum[Pose] | None:
    def linearize(pose: Pose) -> tuple[Array, Array]:
        pixels, J = _linearize_points(camera, pose, p)
        return (pixels - uv).ravel(), J.reshape(-1, 6)

    def retract(pose: Pose, step: Array) -> Pose:
        return Pose.exp(step) @ pose

    try:
        return minimize(linearize, retract, start, tolerance=_TOLERANCE_PX)
    except DidNotConverge:
        return None


def _starts(p: Array, xy: Array) -> list[Pose]:
    center = p.mean(axis=0)
    _, spread, axes = np.linalg.svd(p - center)
    if spread[2] > _PLANAR * spread[0]:
        return [_dlt(p, xy)]
    plane = axes * [[1], [1], [np.linalg.det(axes)]]
    camera_from_plane = _homography_pose(((p - center) @ plane.T)[:, :2], xy)
    first = camera_from_plane @ Pose(plane, -plane @ center)
    return [first, _mirrored(first, plane[2], center)]


def _mirrored(pose: Pose, normal: Array, center: Array) -> Pose:
    """Second solution of a plane: the one that looks the same under weak perspective."""
    middle = pose @ center
    view = middle / np.linalg.norm(middle)
    R = (
        (np.eye(3) - 2 * np.outer(view, view))
        @ pose.rotation
        @ (np.eye(3) - 2 * np.outer(normal, normal))
    )
    return Pose(R, middle - R @ center)


def _similarity(points: Array) -> Array:
    """Homogeneous matrix that centres points (n, d) and scales them to unit mean distance."""
    d = points.shape[1]
    center = points.mean(axis=0)
    scale = 1 / max(float(np.linalg.norm(points - center, axis=1).mean()), 1e-12)
    T = np.eye(d + 1) * scale
    T[:d, d] = -scale * center
    T[d, d] = 1
    return T


def _linear_projection(points: Array, xy: Array) -> Array:
    """Projective map (3, d + 1) of points (n, d) to xy (n, 2), both normalised (Hartley)."""
    if not np.isfinite(xy).all():
        raise InputError("some pixels lie where the camera model's distortion has no ray")
    S, T = _similarity(points), _similarity(xy)
    q = points @ S[:-1, :-1].T + S[:-1, -1]
    u = xy @ T[:2, :2].T + T[:2, 2]
    q = np.column_stack([q, np.ones(len(q))])
    zero = np.zeros_like(q)
    rows = np.vstack([np.hstack([q, zero, -u[:, :1] * q]), np.hstack([zero, q, -u[:, 1:] * q])])
    P = np.linalg.svd(rows)[2][-1].reshape(3, -1)
    out: Array = np.linalg.inv(T) @ P @ S
    return out


def _homography_pose(plane_points: Array, xy: Array) -> Pose:
    H = _linear_projection(plane_points, xy)
    H = H / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
    H = H * (1.0 if H[2, 2] > 0 else -1.0)
    M = np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])
    return Pose(_polar(M), H[:, 2])


def _dlt(points: Array, xy: Array) -> Pose:
    if len(points) < 6:
        raise InputError(f"a spatial target needs at least 6 points, got {len(points)}")
    P = _linear_projection(points, xy)
    P = P / np.cbrt(np.linalg.det(P[:, :3]))
    return Pose(_polar(P[:, :3]), P[:, 3])


def _polar(M: Array) -> Array:
    U, _, Vt = np.linalg.svd(M)
    out: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return out
