"""From coarse corners to the best ones: edge fit, photometric fit, and which of them to believe."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.edges import EdgeFit, coarse_homography, fit_edges, has_strayed
from vgrd.vision.alignment.photometric import align
from vgrd.vision.alignment.photometric_fit import PhotometricFit
from vgrd.vision.alignment.printed_lines import free_lines, with_printed_lines
from vgrd.vision.images.homography import apply, from_points
from vgrd.vision.images.noise import CameraNoise
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster
from vgrd.vision.print.tolerance import PrintTolerance

WORST_CHI2 = 1.5  # drawn: clean 1.0, ink and gamma up to 1.4; motion 2.7, shadow and glare over 50
_BETTER = 0.7  # of the chi-square, for lines printed elsewhere; its noise is 0.03 at 3000 pixels
_USEFUL_CELL = 0.1  # of a cell: the sigma of a corner that is better than a start, good to a third
WORST_MISFIT = 0.02  # of the contrast: what real prints and lenses leave beyond the noise
_WORST_SPREAD = (
    0.03  # idem, if all cells leave it and flat pixels little: JPEG 60 leaves up to 0.028
)
_WORST_FLAT = 0.02  # idem: JPEG 60 0.008 to 0.023, gloss and glare from 0.025 on
_EVEN = (
    0.5  # median of the cells' mean squares over their mean; a cover or a scratch spoils few cells
)


class RefinementMethod(StrEnum):
    """Which fit the corners come from."""

    PHOTOMETRIC = "photometric"
    EDGES = "edges"


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Corners (4, 2) px, their covariance (8, 8), and the method that they come from.

    fit: the photometric fit, if it ended, also where the corners are those of the edges. edge_share:
    share of the edges that agree with the fit of edges.
    """

    corners_px: Array
    covariance: Array
    method: RefinementMethod
    fit: PhotometricFit | None
    edge_share: float


def refine(
    picture: Grey,
    raster: Raster,
    corners_px: Array,
    lens: Array,
    noise: CameraNoise | None = None,
    *,
    lines_are_sure: bool = False,
    ink_mm: float = PrintTolerance().ink_mm,
) -> Refined | None:
    """Refine corners (4, 2) that are good to a third of a cell; None when nothing fits.

    lens: `lens_vector` of the camera, or `NO_LENS`. lines_are_sure: the inner lines are where the raster
    has them; do not estimate where they were printed. ink_mm: how far ink may spread, as a standard
    deviation.
    """
    picture = read_only(picture)
    frame = LocalFrame.around(lens, corners_px.mean(0))
    try:
        H = from_points(raster.corners, frame.q_of(corners_px))
    except np.linalg.LinAlgError:
        return None
    coarse = coarse_homography(picture, raster, frame, H)
    start, edge_share = (H, 0.0) if coarse is None else coarse
    if has_strayed(start, raster, apply(H, raster.corners)):
        start, edge_share = H, 0.0  # of small cells too few sides are seen to correct it
    fit = align(picture, raster, frame, start, noise, ink_mm=ink_mm)
    if fit is not None and fit.chi2 > WORST_CHI2 and not lines_are_sure:
        fit = _as_printed(picture, raster, fit, noise, ink_mm)
    if fit is not None and trusted(fit):
        return Refined(
            fit.corners_px, fit.covariance, RefinementMethod.PHOTOMETRIC, fit, edge_share
        )
    edges = fit_edges(picture, raster, frame, start)
    if edges is None or not _is_useful(edges, raster):
        return None
    if has_strayed(edges.q_from_target, raster, apply(start, raster.corners)):
        return None
    return Refined(
        edges.corners_px, edges.covariance, RefinementMethod.EDGES, fit, edges.edge_share
    )


def read_only(picture: Grey) -> Grey:
    """A view that cannot be written: numba compiles once more for arrays that can be."""
    view = picture.view()
    view.flags.writeable = False
    return view


def _as_printed(
    picture: Grey, raster: Raster, fit: PhotometricFit, noise: CameraNoise | None, ink_mm: float
) -> PhotometricFit:
    """The fit with the inner lines where they were printed, if that explains the picture better."""
    printed = with_printed_lines(picture, raster, fit.frame, fit.q_from_target)
    if printed is None:
        return fit
    lines = free_lines(raster, printed[0])
    other = align(picture, printed[0], fit.frame, printed[1], noise, ink_mm=ink_mm, lines=lines)
    return fit if other is None or other.chi2 > _BETTER * fit.chi2 else other


def _is_useful(edges: EdgeFit, raster: Raster) -> bool:
    """Whether the corners are known better than the coarse detection knew them."""
    side = float(np.linalg.norm(edges.corners_px[1] - edges.corners_px[0]))
    cell = side * raster.smallest_cell / float(np.ptp(raster.corners[:, 0]))
    variances = np.diag(edges.covariance)
    return bool(variances.min() > 0 and variances.max() < (_USEFUL_CELL * cell) ** 2)


def trusted(fit: PhotometricFit) -> bool:
    """Whether the picture is as the model says, up to noise or to what real prints and JPEG leave."""
    if fit.chi2 < WORST_CHI2 or fit.misfit < WORST_MISFIT:
        return True
    squares = fit.cell_squares
    is_even = float(np.median(squares)) > _EVEN * float(np.mean(squares))
    return is_even and fit.misfit < _WORST_SPREAD and fit.flat_misfit < _WORST_FLAT
