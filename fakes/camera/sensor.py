"""The fake camera's sensor: light fall-off, shot and read noise, and the rectangles of a picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array

Picture = NDArray[np.uint8]
Plane = NDArray[np.float32]

BLOCK = 4  # px; regions that are drawn exactly are whole blocks
WHITE, BLACK = 205.0, 14.0  # grey levels of paper and ink in full light
SHOT, READ = 0.0209, 0.5  # variance per grey level and sigma: 40 dB at white


@dataclass(frozen=True, slots=True)
class PixelRegion:
    """A rectangle of the picture, px."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def meets(self, other: "PixelRegion") -> bool:
        """Whether two regions have a pixel in common."""
        return (
            self.x < other.x + other.width
            and other.x < self.x + self.width
            and self.y < other.y + other.height
            and other.y < self.y + self.height
        )


def region_around(
    outline: Array, size_px: tuple[int, int], margin_px: float
) -> PixelRegion | None:
    """Whole blocks around an outline (n, 2), cut to the picture; None when nothing is left."""
    low = np.floor(outline.min(0) - margin_px).astype(int)
    high = np.ceil(outline.max(0) + margin_px).astype(int)
    low = np.maximum(low, 0) // BLOCK * BLOCK
    high = np.minimum(-(-high // BLOCK) * BLOCK, np.array(size_px) // BLOCK * BLOCK)
    width, height = (high - low).tolist()
    if width < BLOCK or height < BLOCK:
        return None
    return PixelRegion(int(low[0]), int(low[1]), width, height)


def light(
    size_px: tuple[int, int],
    region: PixelRegion,
    vignetting: float = 0.25,  # a lens of 12 mm loses about so much at the corner (a guess)
    slope: tuple[float, float] = (0.10, -0.06),  # a lamp beside the cell, not above it (a guess)
) -> Plane:
    """Relative illumination (height, width) of a region.

    vignetting: share lost at sqrt(2) half widths from the middle; slope: change over half a
    width, along x and y.
    """
    width, height = size_px
    x = (region.x + np.arange(region.width, dtype=np.float32) - width / 2) / (width / 2)
    y = (region.y + np.arange(region.height, dtype=np.float32) - height / 2) / (width / 2)
    x, y = x[None].astype(np.float32), y[:, None].astype(np.float32)
    fall_off = 1 - vignetting / 2 * (x * x + y * y)
    return np.asarray(fall_off * (1 + slope[0] * x) * (1 + slope[1] * y), np.float32)


def with_noise(
    clean: Plane, rng: np.random.Generator, shot: float = SHOT, read: float = READ
) -> Plane:
    """Add shot noise (variance `shot` per grey level) and read noise (sigma) to grey levels."""
    noise = rng.standard_normal(clean.shape, dtype=np.float32)
    variance = np.float32(shot) * np.maximum(clean, 0) + np.float32(read**2)
    return np.asarray(clean + noise * np.sqrt(variance))


def quantised(levels: Plane) -> Picture:
    """Round to 8 bits."""
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
