"""Camera model: pinhole with OpenCV's distortion, its Jacobians, and rays from pixels.

Pixels as in OpenCV: the centre of the first pixel is (0, 0). z of the camera frame looks forward.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vgrd.errors import InputError
from vgrd.geometry.pose import Array

_NEWTON_STEPS = 20  # at most; each doubles the digits
_STILL = 1e-14  # of a step of a ray: rounding
_ON_RAY = 1e-9  # of a ray: 1e-5 px at f 10,000 px; more where no ray maps to the pixel
_NEAREST_MM = 1e-6  # in front of the camera; nearer points have no pixel
_COEFFICIENTS = (0, 4, 5, 8)  # of OpenCV's models without thin prism and tilt
_FOCAL_SHARES = (0.1, 100.0)  # of the width: 0.3 is 118 deg wide, 14 a lens of 100 mm on 7 mm
_FOCAL_PX = (10.0, 1e6)  # where no size is told: below a picture of 100 px, above any telescope
_MOST_ASPECT = 2.0  # fx / fy: pixels are square, or two are binned in one direction
_CENTRE_SHARES = (-1.0, 2.0)  # of the size: a picture cut out of a larger one may lie aside
INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2")


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """matrix: (3, 3) px without skew; distortion: 0, 4, 5 or 8 numbers in OpenCV's order.

    (k1, k2, p1, p2[, k3[, k4, k5, k6]]); size_px: (width, height). Raises InputError naming the
    fault.
    """

    matrix: Array
    distortion: Array
    size_px: tuple[int, int]

    def __post_init__(self) -> None:
        K = np.array(self.matrix, dtype=np.float64)
        d = np.array(self.distortion, dtype=np.float64).ravel()
        if K.shape != (3, 3) or not np.isfinite(K).all() or not np.isfinite(d).all():
            raise InputError("a camera matrix is (3, 3) and finite, as its distortion is")
        shape = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]])
        if K[0, 0] <= 0 or K[1, 1] <= 0 or np.abs(K - shape).max() > 1e-9:
            raise InputError(
                "a camera matrix is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0"
            )
        if d.size not in _COEFFICIENTS:
            raise InputError(f"distortion has {d.size} numbers, one of {_COEFFICIENTS} is known")
        K.setflags(write=False)
        d.setflags(write=False)
        object.__setattr__(self, "matrix", K)
        object.__setattr__(self, "distortion", d)

    def intrinsics(self) -> Array:
        """Refinable numbers (6,): fx, fy, cx, cy in px, k1, k2."""
        K, d = self.matrix, self._coefficients()
        return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], d[0], d[1]])

    def with_intrinsics(self, values: ArrayLike) -> "CameraModel":
        """Replace fx, fy, cx, cy, k1, k2 by `values` (6,)."""
        fx, fy, cx, cy, k1, k2 = np.asarray(values, dtype=np.float64)
        rest = self.distortion[2:] if self.distortion.size else np.zeros(2)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return CameraModel(K, np.concatenate([[k1, k2], rest]), self.size_px)

    def project(self, points_in_camera: ArrayLike) -> Array:
        """Pixels (n, 2) of points (n, 3), mm; NaN for points that are not in front."""
        normalized = _normalized(np.asarray(points_in_camera, dtype=np.float64))
        return self._pixels(self._distort(normalized)[0])

    def linearize(self, points_in_camera: ArrayLike) -> tuple[Array, Array]:
        """Pixels (n, 2) and their derivative (n, 2, 3) by the point, px / mm."""
        p = np.asarray(points_in_camera, dtype=np.float64)
        xy = _normalized(p)
        distorted, D = self._distort(xy)
        focal = np.array([self.matrix[0, 0], self.matrix[1, 1]])
        D = D * focal[:, None] / p[:, 2, None, None]
        J = np.empty((len(p), 2, 3))
        J[:, :, :2] = D
        J[:, :, 2] = -np.einsum("nij,nj->ni", D, xy)
        return self._pixels(distorted), J

    def intrinsics_jacobian(self, points_in_camera: ArrayLike) -> Array:
        """How the pixels change, (n, 2, 6), with fx, fy, cx, cy, k1, k2."""
        xy = _normalized(np.asarray(points_in_camera, dtype=np.float64))
        distorted = self._distort(xy)[0]
        k = self._coefficients()
        s = np.einsum("ni,ni->n", xy, xy)
        denominator = 1 + s * (k[5] + s * (k[6] + s * k[7]))
        J = np.zeros((len(xy), 2, 6))
        for i in range(2):
            J[:, i, i] = distorted[:, i]
            J[:, i, 2 + i] = 1.0
            J[:, i, 4] = self.matrix[i, i] * xy[:, i] * s / denominator
            J[:, i, 5] = J[:, i, 4] * s
        return J

    def normalize(self, pixels: ArrayLike) -> Array:
        """Undistorted x / z, y / z (n, 2) of pixels (n, 2); NaN where no ray maps to the pixel.

        One fixed-point step, then Newton's method.
        """
        p = np.asarray(pixels, dtype=np.float64)
        wanted = np.column_stack(
            [
                (p[:, 0] - self.matrix[0, 2]) / self.matrix[0, 0],
                (p[:, 1] - self.matrix[1, 2]) / self.matrix[1, 1],
            ]
        )
        if not self.distortion.any():
            return wanted
        xy = wanted - (self._distort(wanted)[0] - wanted)
        for _ in range(_NEWTON_STEPS):
            distorted, D = self._distort(xy)
            step = _solve2(D, wanted - distorted)
            xy = xy + step
            if not np.abs(step).max(initial=0) > _STILL:
                break
        fits = np.abs(self._distort(xy)[0] - wanted).max(axis=1) < _ON_RAY
        return np.where(fits[:, None], xy, np.nan)

    def _coefficients(self) -> Array:
        return np.concatenate([self.distortion, np.zeros(8 - self.distortion.size)])

    def _pixels(self, distorted: Array) -> Array:
        return distorted * np.diag(self.matrix)[:2] + self.matrix[:2, 2]

    def _distort(self, xy: Array) -> tuple[Array, Array]:
        """Distorted coordinates (n, 2) and their derivative (n, 2, 2)."""
        if not self.distortion.any():
            return xy, np.broadcast_to(np.eye(2), (len(xy), 2, 2))
        k1, k2, p1, p2, k3, k4, k5, k6 = self._coefficients()
        x, y = xy[:, 0], xy[:, 1]
        s = x * x + y * y
        above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
        gain = above / below
        slope = (k1 + s * (2 * k2 + 3 * s * k3) - gain * (k4 + s * (2 * k5 + 3 * s * k6))) / below
        out = np.column_stack(
            [
                x * gain + 2 * p1 * x * y + p2 * (s + 2 * x * x),
                y * gain + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
            ]
        )
        D = np.empty((len(xy), 2, 2))
        D[:, 0, 0] = gain + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        D[:, 0, 1] = D[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        D[:, 1, 1] = gain + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return out, D


def implausible_matrix(matrix: Array, size_px: tuple[int, int] | None) -> str | None:
    """What no camera matrix (3, 3) in px has, with the remedy; None where nothing is odd.

    size_px: (width, height), None where it is not told.
    """
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    low, high = _FOCAL_PX
    of = ""
    if size_px is not None:
        low, high = (share * size_px[0] for share in _FOCAL_SHARES)
        of = f" of a picture {size_px[0]} px wide"
        for value, name, extent in ((cx, "cx", size_px[0]), (cy, "cy", size_px[1])):
            least, most = (share * extent for share in _CENTRE_SHARES)
            if not least <= value <= most:
                return (
                    f"{name} = {value:g} px lies far outside the picture of {size_px[0]} x {size_px[1]} px: "
                    "in mm, of another picture size, or fx fy cx cy in another order?"
                )
    for value, name in ((fx, "fx"), (fy, "fy")):
        if value > 0 and not low <= value <= high:  # `CameraModel` refuses the others
            return (
                f"{name} = {value:g} is no focal length{of} ({low:g} to {high:g} px): in mm, or as a "
                "share of the width? Give px"
            )
    if fx > _MOST_ASPECT * fy > 0 or fy > _MOST_ASPECT * fx > 0:
        return (
            f"fx = {fx:g} and fy = {fy:g} px differ by more than a factor of two: is one mistyped?"
        )
    return None


def implausible_distortion(camera: CameraModel) -> str | None:
    """Whether the distortion has no ray where every lens has one; with the remedy."""
    size = np.array(camera.size_px, dtype=np.float64)
    halfway = size * np.array([(1, 1), (3, 1), (1, 3), (3, 3)]) / 4  # from the middle to a corner
    with np.errstate(all="ignore"):  # absurd numbers overflow: the answer stays NaN
        rays = camera.normalize(halfway)
    if np.isfinite(rays).all():
        return None
    numbers = ", ".join(f"{value:g}" for value in camera.distortion)
    return (
        f"[{numbers}] has no ray for pixels half-way to the picture's corners: give OpenCV's k1 k2 p1 p2 "
        "[k3 ...] in this order, without a unit"
    )


def _normalized(points: Array) -> Array:
    front = np.where(points[:, 2] > _NEAREST_MM, points[:, 2], np.nan)
    return points[:, :2] / front[:, None]


def _solve2(A: Array, b: Array) -> Array:
    """Solutions (n, 2) of n systems of two equations; NaN where singular."""
    determinant = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    determinant = np.where(np.abs(determinant) > 1e-12, determinant, np.nan)
    return (
        np.column_stack(
            [
                A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1],
                A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0],
            ]
        )
        / determinant[:, None]
    )
