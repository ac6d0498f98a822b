"""Lenses that others describe in other words, expressed with OpenCV's first eight numbers.

RealSense: rs2_deproject_pixel_to_point and rs2_project_point_to_pixel of librealsense (rsutil.h).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import cv2
import numpy as np
from scipy.optimize import least_squares

from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel

Rays = Callable[[Array, Array, Array], Array]
_OURS = 8  # the most that `CameraModel` takes: without thin prism and tilt
_SAME_PX = 0.02  # by which another model may differ: OpenCV's corners of boards err more
_FIXED_POINT_STEPS = 50  # librealsense does 10


def expressed(
    matrix: Array, size: tuple[int, int], distortion: Array, rays_of: Rays, what: str
) -> CameraModel:
    """The same camera with eight distortion numbers, fitted to rays over the whole picture.

    rays_of(pixels (n, 2), matrix (3, 3), distortion) gives rays (n, 2) at z = 1. InputError where the fit
    leaves more than 0.02 px, with `what` the model is.
    """
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 21), np.linspace(0, size[1] - 1, 17))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    points = np.hstack([rays_of(pixels, matrix, distortion), np.ones((len(pixels), 1))])

    def camera(x: Array) -> CameraModel:
        K = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1]])
        return CameraModel(K, x[4:], size)

    def residuals(x: Array) -> Array:
        return np.asarray((camera(x).project(points) - pixels).ravel())

    start = np.append(matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.zeros(_OURS))
    count = min(distortion.size, _OURS)
    start[4 : 4 + count] = distortion[:count]
    try:
        minimum = least_squares(residuals, start, x_scale="jac")
        worst = float(np.abs(minimum.fun).max())
    except (ValueError, InputError):  # a lens beyond reason: no finite rays
        worst = np.inf
    if not worst < _SAME_PX:
        raise InputError(
            f"its {what} cannot be expressed with 8 numbers ({worst:.2g} px off): calibrate anew "
            "with vgrd intrinsics"
        )
    return camera(minimum.x)


def opencv_rays(pixels: Array, matrix: Array, distortion: Array) -> Array:
    """Rays of OpenCV's full model: thin prisms and tilted sensors too."""
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    rays = cv2.undistortPointsIter(pixels, matrix, distortion, np.eye(3), np.eye(3), criteria)
    return np.asarray(rays, dtype=np.float64).reshape(-1, 2)


def _inverse_brown_conrady(pixels: Array, matrix: Array, distortion: Array) -> Array:
    """The polynomial leads from the distorted point to the ray."""
    k1, k2, p1, p2, k3 = distortion
    x, y = ((pixels - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]).T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        ]
    )


def _modified_brown_conrady(pixels: Array, matrix: Array, distortion: Array) -> Array:
    """As OpenCV's, but the tangential part is of the point already distorted radially."""
    k1, k2, p1, p2, k3 = distortion
    seen = (pixels - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]
    rays = seen.copy()
    for _ in range(_FIXED_POINT_STEPS):
        x, y = rays.T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = x * radial, y * radial
        shift = np.column_stack(
            [2 * p1 * x * y + p2 * (r2 + 2 * x * x), 2 * p2 * x * y + p1 * (r2 + 2 * y * y)]
        )
        rays = (seen - shift) / radial[:, None]
    return rays


RAYS: Mapping[str, Rays] = MappingProxyType(
    {
        "inversebrownconrady": _inverse_brown_conrady,
        "modifiedbrownconrady": _modified_brown_conrady,
    }
)
