"""Pixels, rays, and the local plane "q" in which a target is measured.

q = F (ray - r0): undistorted coordinates that look like pixels around the target's middle (1 in
docs/photometric.md). There, straight edges are straight and the blur is that of the pixels. Without a
camera a ray is a pixel.
Compiled functions take the lens as one vector `lens`: fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel
from vgrd.vision.images.compiling import compiled, inlined

_SLOPE_STEP = 1e-5  # of a ray: 0.1 px at f 10,000 px, over which no lens bends
_NEWTON_STEPS = 20  # at most; each doubles the digits
_STILL_SQUARED = 1e-24  # of a step: 1e-8 px at f 10,000 px

NO_LENS = np.array([1.0, 1.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])


def lens_vector(camera: CameraModel | None) -> Array:
    """Twelve numbers of a camera; None: rays are pixels."""
    if camera is None:
        return NO_LENS
    K, k = camera.matrix, np.zeros(8)
    k[: camera.distortion.size] = camera.distortion
    return np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], k])


@inlined
def project(lens: Array, x: float, y: float) -> tuple[float, float]:
    """Pixel of a ray (x, y, 1)."""
    s = x * x + y * y
    gain = (1 + s * (lens[4] + s * (lens[5] + s * lens[8]))) / (
        1 + s * (lens[9] + s * (lens[10] + s * lens[11]))
    )
    xd = x * gain + 2 * lens[6] * x * y + lens[7] * (s + 2 * x * x)
    yd = y * gain + lens[6] * (s + 2 * y * y) + 2 * lens[7] * x * y
    return lens[0] * xd + lens[2], lens[1] * yd + lens[3]


@inlined
def q_at(H: Array, X: float, Y: float) -> tuple[float, float]:
    """Point of the q plane at a point of the target's plane, by the homography H."""
    w = 1.0 / (H[2, 0] * X + H[2, 1] * Y + H[2, 2])
    return (
        (H[0, 0] * X + H[0, 1] * Y + H[0, 2]) * w,
        (H[1, 0] * X + H[1, 1] * Y + H[1, 2]) * w,
    )


@inlined
def pixel_at(lens: Array, r0: Array, Fi: Array, qx: float, qy: float) -> tuple[float, float]:
    """Pixel of a point of the q plane; Fi: inverse of the frame's F."""
    return project(
        lens, r0[0] + Fi[0, 0] * qx + Fi[0, 1] * qy, r0[1] + Fi[1, 0] * qx + Fi[1, 1] * qy
    )


@compiled
def slopes(lens: Array, x: float, y: float) -> tuple[float, float, float, float]:
    """Derivative of the pixel by the ray, row by row (central differences, exact to 1e-9)."""
    h = _SLOPE_STEP
    a, b = project(lens, x + h, y)
    c, d = project(lens, x - h, y)
    e, f = project(lens, x, y + h)
    g, i = project(lens, x, y - h)
    return (a - c) / (2 * h), (e - g) / (2 * h), (b - d) / (2 * h), (f - i) / (2 * h)


@compiled
def ray(lens: Array, px: float, py: float) -> tuple[float, float]:
    """Ray of a pixel, by Newton's method from the undistorted guess."""
    x, y = (px - lens[2]) / lens[0], (py - lens[3]) / lens[1]
    for _ in range(_NEWTON_STEPS):
        u, v = project(lens, x, y)
        a, b, c, d = slopes(lens, x, y)
        det = a * d - b * c
        dx = (d * (px - u) - b * (py - v)) / det
        dy = (a * (py - v) - c * (px - u)) / det
        x, y = x + dx, y + dy
        if dx * dx + dy * dy < _STILL_SQUARED:
            break
    return x, y


@dataclass(frozen=True, slots=True, eq=False)
class LocalFrame:
    """The q frame around a pixel: q = F (ray - r0). lens (12,), r0 (2,), F (2, 2) px per ray."""

    lens: Array
    r0: Array
    F: Array

    @classmethod
    def around(cls, lens: Array, pixel: Array) -> "LocalFrame":
        """Frame with its origin at a pixel (2,), in which q moves as pixels do there."""
        r0 = np.array(ray(lens, float(pixel[0]), float(pixel[1])))
        return cls(lens, r0, np.array(slopes(lens, r0[0], r0[1])).reshape(2, 2))

    def rays_of(self, pixels: Array) -> Array:
        """Rays (n, 2) of pixels (n, 2)."""
        return np.array([ray(self.lens, float(x), float(y)) for x, y in pixels])

    def q_of(self, pixels: Array) -> Array:
        """Points (n, 2) of the q plane seen at pixels (n, 2)."""
        return np.asarray((self.rays_of(pixels) - self.r0) @ self.F.T)

    def pixels_of(self, q: Array) -> Array:
        """Pixels (n, 2) of points (n, 2) of the q plane."""
        rays = q @ np.linalg.inv(self.F).T + self.r0
        return np.array([project(self.lens, float(x), float(y)) for x, y in rays])

    def pixel_slopes(self, q: Array) -> Array:
        """Derivatives (n, 2, 2) of the pixels by points (n, 2) of the q plane."""
        back = np.linalg.inv(self.F)
        rays = q @ back.T + self.r0
        J = np.array([slopes(self.lens, float(x), float(y)) for x, y in rays])
        return np.asarray(J.reshape(-1, 2, 2) @ back)
