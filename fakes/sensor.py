"""The fake camera's sensor: light fall-off, shot and read noise, and the rectangles of a picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Plane = NDArray[np.float32]

WHITE, BLACK = 205.0, 14.0  # grey levels of paper and ink in full light
SHOT, READ = 0.0209, 0.5  # variance per grey level and sigma: 40 dB at white


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle of the picture, px."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)


def light(size_px: tuple[int, int], region: Region) -> Plane:
    """Relative illumination (height, width) of a region: vignetting and a slope."""
    width, height = size_px
    x = (region.x + np.arange(region.width, dtype=np.float32) - width / 2) / (width / 2)
    y = (region.y + np.arange(region.height, dtype=np.float32) - height / 2) / (width / 2)
    x, y = x[None].astype(np.float32), y[:, None].astype(np.float32)
    return np.asarray((1 - 0.125 * (x * x + y * y)) * (1 + 0.10 * x) * (1 - 0.06 * y))


def with_noise(clean: Plane, rng: np.random.Generator) -> Plane:
    """Add shot and read noise to grey levels."""
    noise = rng.standard_normal(clean.shape, dtype=np.float32)
    return np.asarray(clean + noise * np.sqrt(np.float32(SHOT) * clean + np.float32(READ**2)))


def quantised(levels: Plane) -> Picture:
    """Round to 8 bits."""
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
