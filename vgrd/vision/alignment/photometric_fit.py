"""What a photometric fit tells: corners, covariance, and how well the picture is explained.

Numbers in comments are the equations of docs/photometric.md.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.alignment.gathering import Cells
from vgrd.vision.images.noise import CameraNoise
from vgrd.vision.images.warp import LocalFrame


@dataclass(frozen=True, slots=True, eq=False)
class PhotometricFit:
    """A raster aligned with a picture.

    corners_px (4, 2) and their covariance (8, 8) px^2, which holds for a tag whose sides lie elsewhere too;
    that of a board is multiplied by chi2 (per degree of freedom) where that is above one. blur: (2, 2)
    covariance of the point spread and the pixel, px^2. bloom_px: shift of the edges towards white, the mean of
    both directions; ink_mm (2,): the part of it in x and y that is ink. gain, offset: coefficients of (8).
    veiled: flat misfit without veils (8a), 0 for a fit that needs none.
    outside: share of the pixels outside the picture.
    residuals (n,): in standard deviations, of pixels at q (n, 2) in the cells (n, 2), (column, row); the
    first `edge_pixels` of them are near edges.
    """

    corners_px: Array
    covariance: Array
    chi2: float
    steps: int
    blur: Array
    bloom_px: float
    ink_mm: Array
    gain: Array
    offset: Array
    noise: CameraNoise
    outside: float
    residuals: Array
    q: Array
    cells: Cells
    edge_pixels: int
    q_from_target: Array
    frame: LocalFrame
    veiled: float = 0.0

    @property
    def contrast(self) -> float:
        """Grey levels between black and white in the middle of the target."""
        return float(self.gain[0])

    @property
    def misfit(self) -> float:
        """Root mean square of what the model leaves beyond the noise, as a share of the contrast."""
        return self._beyond_noise(self.chi2)

    @property
    def flat_misfit(self) -> float:
        """The misfit of flat pixels: there only the light counts, not how sharp the print or the lens is."""
        flat = self.residuals[self.edge_pixels :]
        return self._beyond_noise(float(np.mean(flat**2)) if flat.size else 0.0)

    @property
    def cell_squares(self) -> Array:
        """Mean squares of the residuals of each cell that has pixels."""
        index = np.ravel_multi_index(self.cells.T[::-1], self.cells.max(0)[::-1] + 1)
        counts = np.bincount(index)
        return np.asarray(
            (np.bincount(index, self.residuals**2) / np.maximum(counts, 1))[counts > 0]
        )

    def residual_map(self, shape: tuple[int, int]) -> tuple[tuple[slice, slice], Array]:
        """Region (rows, columns) of a picture (h, w), and its residuals; NaN where no pixel was used."""
        x, y = np.rint(self.frame.pixels_of(self.q)).astype(int).T
        region = (
            slice(max(y.min(), 0), min(y.max() + 1, shape[0])),
            slice(max(x.min(), 0), min(x.max() + 1, shape[1])),
        )
        residuals = np.full(shape, np.nan)
        residuals[y, x] = self.residuals
        return region, residuals[region]

    def _beyond_noise(self, chi2: float) -> float:
        level = self.offset[0] + self.gain[0] / 2
        variance = self.noise.shot * level + self.noise.read
        return float(np.sqrt(max(chi2 - 1, 0) * variance) / max(self.contrast, 1e-9))
