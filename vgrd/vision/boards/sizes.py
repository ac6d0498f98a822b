"""Whether the markers of a board have the size against their distances that its file states.

A homography fits a board of wrong proportions almost as well as the right one, at another distance: edges
tell it, as one number more in their fit.
"""

import numpy as np

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.edges import edge_offsets, edge_segments, edge_slopes
from vgrd.vision.alignment.printed_lines import robust_step
from vgrd.vision.images.homography import apply, from_points
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster

_FREE = 1.0  # standard deviation that the excess is held by: not at all
_STEP = 1e-4
_FEWEST_EDGES = 20


def marker_excess(
    picture: Grey, raster: Raster, markers: Array, corners_px: Array, lens: Array
) -> tuple[float, float]:
    """By which share the markers are larger, against their distances, than in the raster; 1 sigma.

    markers (n, 2, 2): lowest and highest (x, y) of each, mm; corners_px (4, 2): of the measured raster.
    (0, inf) where too few edges are seen.
    """
    frame = LocalFrame.around(lens, corners_px.mean(0))
    H = from_points(raster.corners, frame.q_of(corners_px))
    q, normal, offset, edge = edge_offsets(picture, raster, frame, H, wide=False)
    if len(np.unique(edge)) < _FEWEST_EDGES:
        return 0.0, np.inf
    at = apply(np.asarray(np.linalg.inv(H), dtype=np.float64), q)
    growth = _STEP * _from_centre(at, edge_segments(raster)[edge], markers)
    grown = (apply(H, at + growth) - apply(H, at - growth)) / (2 * _STEP)
    scale = float(np.abs(frame.q_of(corners_px)).max())
    J = np.column_stack([edge_slopes(q, normal, scale), np.einsum("ni,ni->n", grown, normal)])
    try:
        change, residuals, weight = robust_step(J, offset, _FREE, np.zeros(1))
        bread = np.linalg.inv((J.T * weight) @ J)
    except np.linalg.LinAlgError:
        return 0.0, np.inf
    scores = np.zeros((edge.max() + 1, J.shape[1]))
    np.add.at(scores, edge, J * (weight * residuals)[:, None])  # an edge errs as a whole
    return float(change[-1]), float(np.linalg.norm(scores @ bread[-1]))


def _from_centre(at: Array, segments: Array, markers: Array) -> Array:
    """Ways (n, 2) mm from the centres of the markers that edge points belong to; zero where to none."""
    middle = ((segments[:, :2] + segments[:, 2:4]) / 2)[:, None]
    near = 1e-6 * np.ptp(markers)
    inside = np.all((middle > markers[:, 0] - near) & (middle < markers[:, 1] + near), axis=2)
    ways = at - markers.mean(1)[inside.argmax(1)]
    return np.asarray(np.where(inside.any(1)[:, None], ways, 0.0))
