"""How a camera blurs: lens and sensor, defocus, motion during the exposure."""

from dataclasses import dataclass

import cv2
import numpy as np

from fakes.camera.sensor import BLOCK, Plane
from vgrd.geometry import Array


@dataclass(frozen=True, slots=True)
class Blur:
    """Gaussian sigma, radius of a defocus disc, way of a motion during the exposure; px and rad."""

    sigma_px: float
    disc_px: float = 0.0
    motion_px: float = 0.0
    motion_rad: float = 0.0

    @property
    def samples(self) -> int:
        """How many samples per pixel and axis the Gaussian needs."""
        return int(np.clip(np.ceil(2.6 / self.sigma_px), 3, 6))

    @property
    def reach_px(self) -> int:
        """Whole blocks from which light comes into a pixel."""
        reach = 5 * self.sigma_px + self.disc_px + self.motion_px / 2 + 1
        return BLOCK * int(np.ceil(reach / BLOCK))

    def __call__(self, fine: Plane, samples: int) -> Plane:
        """Blur a plane with so many samples per pixel and axis."""
        sigma = self.sigma_px * samples
        size = 2 * int(np.ceil(5 * sigma)) + 1
        plane = cv2.GaussianBlur(fine, (size, size), sigma, borderType=cv2.BORDER_REPLICATE)
        for kernel in self._kernels(samples):
            plane = cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(plane, np.float32)

    def _kernels(self, samples: int) -> list[Plane]:
        kernels = []
        if self.disc_px > 0:
            kernels.append(_disc_kernel(self.disc_px * samples))
        if self.motion_px > 0:
            kernels.append(_line_kernel(self.motion_px * samples, self.motion_rad))
        return kernels


def _disc_kernel(radius: float) -> Plane:
    """Even disc (n, n) that sums to 1, of a radius in samples; its rim is drawn area-accurately."""
    half = int(np.ceil(radius)) + 1
    split = 9
    places = (np.arange((2 * half + 1) * split) + 0.5) / split - half - 0.5
    inside = (places[:, None] ** 2 + places**2 < radius**2).astype(np.float64)
    return _even_kernel(inside, split)


def _line_kernel(length: float, direction_rad: float) -> Plane:
    """Even line (n, n) through the middle that sums to 1, of a length in samples."""
    half = int(np.ceil(length / 2)) + 1
    split = 9
    way = np.linspace(-0.5, 0.5, 4001) * length
    size = (2 * half + 1) * split
    place = [
        ((way * part + half + 0.5) * split).astype(int)
        for part in (np.cos(direction_rad), np.sin(direction_rad))
    ]
    drawn = np.bincount(place[1] * size + place[0], minlength=size * size)
    return _even_kernel(drawn.reshape(size, size).astype(np.float64), split)


def _even_kernel(fine: Array, split: int) -> Plane:
    """Sum squares of split x split and scale the total to 1."""
    n = len(fine) // split
    kernel = fine.reshape(n, split, n, split).sum((1, 3))
    return np.asarray(kernel / kernel.sum(), np.float32)
