"""Whether the markers of a board have the size against their distances that its file states, and are seen.

A homography fits a board of wrong proportions almost as well as the right one, only at another distance. The
edges tell the proportion: it is one more unknown in their fit.
"""

import numpy as np

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.edges import edge_offsets, edge_segments, edge_slopes, shows_edges
from vgrd.vision.alignment.printed_lines import robust_step
from vgrd.vision.images.homography import apply, from_points
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster

_PRIOR_SIGMA = 1.0  # of the excess: as good as none
_STEP = 1e-4  # of the size, of the central difference: curvature costs 1e-8, rounding less
_OF_CELL = (
    0.1  # within which an edge is at its place: half a pixel of a board drawn with 5 px a cell
)
_LEAST_REACH_PX = 0.3  # idem, for small cells: three times the noise of one profile in poor light
_FEWEST_EDGES = 20  # twice the 10 unknowns


def marker_excess(
    picture: Grey, raster: Raster, markers: Array, corners_px: Array, lens: Array
) -> tuple[float, float]:
    """Share by which the markers are larger, against their distances, than in the raster, and its sigma.

    markers (n, 2, 2): lowest and highest (x, y) of each, mm; corners_px (4, 2): of the measured raster.
    (0, inf) where too few edges are seen.
    """
    frame = LocalFrame.around(lens, corners_px.mean(0))
    H = from_points(raster.corners, frame.q_of(corners_px))
    q, normal, offset, edge = edge_offsets(picture, raster, frame, H, wide=False)
    if len(np.unique(edge)) < _FEWEST_EDGES:
        return 0.0, np.inf
    points = apply(np.asarray(np.linalg.inv(H), dtype=np.float64), q)
    growth = _STEP * _from_centre(points, edge_segments(raster)[edge], markers)
    slopes = (apply(H, points + growth) - apply(H, points - growth)) / (2 * _STEP)
    scale = float(np.abs(frame.q_of(corners_px)).max())
    J = np.column_stack([edge_slopes(q, normal, scale), np.einsum("ni,ni->n", slopes, normal)])
    try:
        change, residuals, weight = robust_step(J, offset, _PRIOR_SIGMA, np.zeros(1))
        bread = np.linalg.inv((J.T * weight) @ J)
    except np.linalg.LinAlgError:
        return 0.0, np.inf
    scores = np.zeros((edge.max() + 1, J.shape[1]))
    np.add.at(scores, edge, J * (weight * residuals)[:, None])  # an edge errs as a whole
    return float(change[-1]), float(np.linalg.norm(scores @ bread[-1]))


def seen_share(picture: Grey, raster: Raster, corners_px: Array, lens: Array) -> float:
    """Share of the raster's edges that the picture shows within a tenth of a cell of their place.

    Programs that draw boards round each marker to whole pixels: such edges are seen, only elsewhere. 1
    where cells are too small to see an edge alone: what covers them is left to the photometric fit.
    """
    frame = LocalFrame.around(lens, corners_px.mean(0))
    H = from_points(raster.corners, frame.q_of(corners_px))
    if not shows_edges(raster, H):
        return 1.0
    _, _, offset, edge = edge_offsets(picture, raster, frame, H, wide=False)
    extent = np.linalg.norm(raster.corners[1] - raster.corners[0])
    side = np.linalg.norm(corners_px[1] - corners_px[0])
    reach = max(_OF_CELL * raster.smallest_cell * float(side / extent), _LEAST_REACH_PX)
    return len(np.unique(edge[np.abs(offset) < reach])) / len(edge_segments(raster))


def _from_centre(points: Array, segments: Array, markers: Array) -> Array:
    """Vectors (n, 2), mm, from the centre of its marker to each edge point; 0 for points of no marker."""
    middle = ((segments[:, :2] + segments[:, 2:4]) / 2)[:, None]
    slack = 1e-6 * np.ptp(markers)  # rounding
    low, high = markers[:, 0] - slack, markers[:, 1] + slack
    inside = np.all((middle > low) & (middle < high), axis=2)
    vectors = points - markers.mean(1)[inside.argmax(1)]
    return np.asarray(np.where(inside.any(1)[:, None], vectors, 0.0))
