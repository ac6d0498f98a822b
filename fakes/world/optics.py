"""The fake camera's optics: pinhole, Brown-Conrady distortion, thin lens sharp at one distance."""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array


@dataclass(frozen=True, slots=True, eq=False)
class Optics:
    """Camera matrix (3, 3) px, distortion (5,) in OpenCV order, size (width, height) px.

    focus_mm: distance along the optical axis that is sharp; aperture_mm: diameter of the entrance
    pupil; psf_px: Gaussian sigma of lens and sensor where it is sharp.
    """

    matrix: Array
    distortion: Array
    size_px: tuple[int, int]
    focus_mm: float
    aperture_mm: float
    psf_px: float = 0.7  # a sharp lens: an edge takes two pixels

    def distort(self, rays: Array) -> Array:
        """Distort normalised image coordinates (..., 2) (Brown-Conrady, OpenCV order)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = rays[..., 0], rays[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            -1,
        )

    def undistort(self, distorted: Array) -> Array:
        """Undo `distort` by fixed-point iteration, exact to 1e-12 for this mild distortion."""
        rays = distorted
        for _ in range(7):
            rays = rays + distorted - self.distort(rays)
        return rays

    def project(self, points_in_camera: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in mm in front of the camera."""
        rays = self.distort(points_in_camera[..., :2] / points_in_camera[..., 2:])
        return rays @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def rays(self, pixels: Array) -> Array:
        """Undistorted normalised rays (..., 2) through pixels (..., 2)."""
        return self.undistort((pixels - self.matrix[:2, 2]) / np.diag(self.matrix)[:2])

    def defocus_px(self, depth_mm: float) -> float:
        """Diameter of the blur disc at a depth, px (thin lens)."""
        shift = abs(1 / self.focus_mm - 1 / depth_mm)
        return float(self.matrix[0, 0]) * self.aperture_mm * shift

    def blur_px(self, depth_mm: float) -> float:
        """Combine PSF and defocus to one sigma, px; a disc of diameter d has sigma d / 4."""
        return float(np.hypot(self.psf_px, self.defocus_px(depth_mm) / 4))
