"""From coarse corners to the best ones: edge fit, photometric fit, and which of them to believe."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array
from vgrd.vision.edges import EdgeFit, fit_edges
from vgrd.vision.homography import from_points
from vgrd.vision.noise import Noise
from vgrd.vision.photometric import PhotometricFit, align
from vgrd.vision.raster import Raster
from vgrd.vision.warp import LocalFrame

Grey = NDArray[np.uint8]

WORST_CHI2 = 1.5
WORST_MISFIT = 0.02  # of the contrast: what real prints and lenses leave beyond the noise


class Method(StrEnum):
    """Which fit the corners come from."""

    PHOTOMETRIC = "photometric"
    EDGES = "edges"


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Corners (4, 2) px with covariance (8, 8), the fit they come from, and the photometric fit if there is one."""

    corners_px: Array
    covariance: Array
    method: Method
    fit: PhotometricFit | None
    edges: EdgeFit | None


def refine(
    picture: Grey,
    raster: Raster,
    corners_px: Array,
    lens: Array,
    noise: Noise | None = None,
) -> Refined | None:
    """Refine corners (4, 2) that are good to a third of a cell; None when nothing fits.

    lens: `lens_vector` of the camera, or `NO_LENS`.
    """
    frame = LocalFrame.around(lens, corners_px.mean(0))
    try:
        H = from_points(raster.corners, frame.q_of(corners_px))
    except np.linalg.LinAlgError:
        return None
    coarse = fit_edges(picture, raster, frame, H, coarse=True)
    start = H if coarse is None else coarse.q_from_target
    fit = align(picture, raster, frame, start, noise)
    if fit is not None and trusted(fit):
        covariance = fit.covariance * max(fit.chi2, 1.0)
        return Refined(fit.corners_px, covariance, Method.PHOTOMETRIC, fit, coarse)
    edges = fit_edges(picture, raster, frame, start, coarse=False)
    if edges is None:
        return None
    return Refined(edges.corners_px, edges.covariance, Method.EDGES, fit, edges)


def trusted(fit: PhotometricFit) -> bool:
    """Whether the picture is as the model says, up to noise or to what real prints leave."""
    return fit.chi2 < WORST_CHI2 or fit.misfit < WORST_MISFIT
