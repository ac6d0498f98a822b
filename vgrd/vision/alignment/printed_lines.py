"""Where the lines of a tag were really printed.

Printers and drawing programs put the inner lines of a tag onto whole dots, so cells differ by a dot, while
the outer square is what was measured. The offsets of the edges tell each line's place; of what is
left the homography and the bloom take their share.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.edges import edge_offsets, edge_segments, edge_slopes, has_strayed
from vgrd.vision.images.homography import apply, moved, normalised
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster

_OFF_CELL = 0.08  # standard deviation of an inner line, of the smallest cell
_WORST_CELL = 0.25
_BLOOM_PX = 0.15  # where no line has edges to both sides, it looks as a larger square would
_ROUNDS = 3
_REWEIGHTINGS = 4


def with_printed_lines(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array
) -> tuple[Raster, Array] | None:
    """The raster (of one tag) with its inner lines where the picture shows them, and its homography.

    None where too few edges are seen or a line would be off by a quarter of a cell.
    """
    printed, H = raster, normalised(q_from_target)
    start = apply(H, raster.corners)
    for _ in range(_ROUNDS):
        try:
            step = _step(picture, raster, printed, frame, H)
        except np.linalg.LinAlgError:
            return None
        if step is None:
            return None
        printed, H = step
        if has_strayed(H, raster, start):
            return None
    off = max(np.abs(printed.x - raster.x).max(), np.abs(printed.y - raster.y).max())
    return None if off > _WORST_CELL * raster.smallest_cell else (printed, H)


def _step(
    picture: Grey, raster: Raster, printed: Raster, frame: LocalFrame, H: Array
) -> tuple[Raster, Array] | None:
    """One robust step over the homography, the bloom, and the inner lines."""
    q, normal, offset, edge = edge_offsets(picture, printed, frame, H, wide=False)
    columns, rows = _inner(raster)
    if len(np.unique(edge)) < 9 + len(columns) + len(rows):
        return None
    corners = apply(H, raster.corners)
    scale = float(np.abs(corners - corners.mean(0)).max())
    by_lines = _by_lines(printed, H, q, normal, edge, columns, rows)
    J = np.hstack([edge_slopes(q, normal, scale), by_lines])
    sigma = _OFF_CELL * raster.smallest_cell
    so_far = np.concatenate([(printed.x - raster.x)[columns], (printed.y - raster.y)[rows]])
    change = robust_step(J, offset, sigma, so_far)[0]
    lines = change[9:]
    x, y = printed.x.copy(), printed.y.copy()
    x[columns] += lines[: len(columns)]
    y[rows] += lines[len(columns) :]
    return replace(printed, x=x, y=y), moved(H, change[:8], scale)


def _inner(raster: Raster) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Lines strictly inside the square that stands for the target."""
    low, high = raster.corners.min(0), raster.corners.max(0)
    near = 1e-6 * (high - low)

    def within(lines: Array, axis: int) -> NDArray[np.intp]:
        inside = (lines > low[axis] + near[axis]) & (lines < high[axis] - near[axis])
        return np.flatnonzero(inside)

    return within(raster.x, 0), within(raster.y, 1)


def _by_lines(
    raster: Raster,
    H: Array,
    q: Array,
    normal: Array,
    edge: NDArray[np.intp],
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
) -> Array:
    """Derivative (n, lines) of the offsets by mm of each inner line."""
    segments = edge_segments(raster)[edge]
    at = apply(np.asarray(np.linalg.inv(H), dtype=np.float64), q)
    J = np.zeros((len(q), len(columns) + len(rows)))
    for axis, lines, chosen, first in (
        (0, raster.x, columns, 0),
        (1, raster.y, rows, len(columns)),
    ):
        across = segments[:, 4 + axis] != 0
        direction = np.eye(2)[axis] * 1e-3
        way = (apply(H, at + direction) - apply(H, at - direction)) / 2e-3
        slope = np.einsum("ni,ni->n", way, normal)
        for k, line in enumerate(chosen):
            on = across & (np.abs(segments[:, axis] - lines[line]) < 1e-9)
            J[on, first + k] = slope[on]
    return J


def robust_step(
    J: Array, offset: Array, sigma: float, so_far: Array
) -> tuple[Array, Array, Array]:
    """Weighted least squares over `edge_slopes` and more columns, those held near zero by sigma.

    J (n, 9 + k), so_far (k,): where the k unknowns are already. Returns the step (9 + k,), the
    residuals (n,) and their weights (n,).
    """
    change: Array = np.zeros(J.shape[1])
    r, weight = offset.copy(), np.ones(len(offset))
    for _ in range(_REWEIGHTINGS):
        spread = max(1.4826 * float(np.median(np.abs(r))), 0.02)
        weight = 1 / (1 + (r / (3 * spread)) ** 2) ** 2
        A = (J.T * weight) @ J
        b = (J.T * weight) @ offset
        hold = (spread / sigma) ** 2
        A[8, 8] += (spread / _BLOOM_PX) ** 2
        A[9:, 9:] += hold * np.eye(len(so_far))
        b[9:] -= hold * so_far
        change = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
        r = offset - J @ change
    return change, r, weight
