"""Where the lines of a tag were really printed.

Printers and drawing programs put the inner lines of a tag onto whole dots, so the widths of cells differ by
a dot, while the outer square is what was measured. The offsets of the edges tell the place of each
line, in one fit with the homography and the bloom.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.edges import (
    NORMAL_OF_MAD,
    OUTLIER_SIGMAS,
    PROFILE_NOISE_PX,
    edge_offsets,
    edge_segments,
    edge_slopes,
    has_strayed,
)
from vgrd.vision.alignment.scatter import FreeLines
from vgrd.vision.images.homography import apply, moved, normalised
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster

_LINE_SIGMA_CELL = 0.08  # of the smallest cell: rounding, 0.29 dots, in a cell of 3.6 dots
_WORST_CELL = 0.25  # 3 of those sigmas: another pattern than the raster's
_BLOOM_PX = 0.15  # sigma: 0.01 mm of ink at 0.07 mm/px; unbounded it may pass for a larger square
_ROUNDS = 3  # steps, each from edges measured anew: a line moves by a part of a pixel
_REWEIGHTINGS = 4  # as in the fit of edges


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
    shift = max(np.abs(printed.x - raster.x).max(), np.abs(printed.y - raster.y).max())
    return None if shift > _WORST_CELL * raster.smallest_cell else (printed, H)


def free_lines(drawn: Raster, printed: Raster) -> FreeLines:
    """The inner lines as unknowns of a photometric fit of `printed`."""
    rows, columns = drawn.cells.shape
    inner_x, inner_y = _inner(drawn)
    first_y = (columns + 1) * rows
    sides = np.zeros((first_y + (rows + 1) * columns, len(inner_x) + len(inner_y)))
    for k, line in enumerate(inner_x):
        sides[line * rows : (line + 1) * rows, k] = 1
    for k, line in enumerate(inner_y):
        start = first_y + line * columns
        sides[start : start + columns, len(inner_x) + k] = 1
    shifts = np.concatenate([(printed.x - drawn.x)[inner_x], (printed.y - drawn.y)[inner_y]])
    return FreeLines(sides, shifts, _LINE_SIGMA_CELL * drawn.smallest_cell)


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
    J_lines = _line_slopes(printed, H, q, normal, edge, columns, rows)
    J = np.hstack([edge_slopes(q, normal, scale), J_lines])
    sigma = _LINE_SIGMA_CELL * raster.smallest_cell
    shifts = np.concatenate([(printed.x - raster.x)[columns], (printed.y - raster.y)[rows]])
    change = robust_step(J, offset, sigma, shifts)[0]
    lines = change[9:]
    x, y = printed.x.copy(), printed.y.copy()
    x[columns] += lines[: len(columns)]
    y[rows] += lines[len(columns) :]
    return replace(printed, x=x, y=y), moved(H, change[:8], scale)


def _inner(raster: Raster) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the x lines and y lines strictly inside the square that stands for the target."""
    low, high = raster.corners.min(0), raster.corners.max(0)
    tolerance = 1e-6 * (high - low)  # rounding of the lines' places

    def within(lines: Array, axis: int) -> NDArray[np.intp]:
        inside = (lines > low[axis] + tolerance[axis]) & (lines < high[axis] - tolerance[axis])
        return np.flatnonzero(inside)

    return within(raster.x, 0), within(raster.y, 1)


def _line_slopes(
    raster: Raster,
    H: Array,
    q: Array,
    normal: Array,
    edge: NDArray[np.intp],
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
) -> Array:
    """Derivative (n, lines) of the offsets by the place, mm, of each inner line."""
    segments = edge_segments(raster)[edge]
    points = apply(np.asarray(np.linalg.inv(H), dtype=np.float64), q)
    J = np.zeros((len(q), len(columns) + len(rows)))
    for axis, lines, inner, first in (
        (0, raster.x, columns, 0),
        (1, raster.y, rows, len(columns)),
    ):
        across = segments[:, 4 + axis] != 0
        step = np.eye(2)[axis] * 1e-3  # mm, of the central difference
        motion = (apply(H, points + step) - apply(H, points - step)) / 2e-3
        slope = np.einsum("ni,ni->n", motion, normal)
        for k, line in enumerate(inner):
            is_on_line = across & (np.abs(segments[:, axis] - lines[line]) < 1e-9)  # rounding
            J[is_on_line, first + k] = slope[is_on_line]
    return J


def robust_step(
    J: Array, offset: Array, sigma: float, shifts: Array
) -> tuple[Array, Array, Array]:
    """Robust least squares over the 9 unknowns of `edge_slopes` and k more, with a prior on those.

    J (n, 9 + k); shifts (k,): present values of the k unknowns, which the prior holds near zero by
    sigma. Returns the step (9 + k,), the residuals (n,) and their weights (n,).
    """
    change: Array = np.zeros(J.shape[1])
    r, weight = offset.copy(), np.ones(len(offset))
    for _ in range(_REWEIGHTINGS):
        spread = max(NORMAL_OF_MAD * float(np.median(np.abs(r))), PROFILE_NOISE_PX)
        weight = 1 / (1 + (r / (OUTLIER_SIGMAS * spread)) ** 2) ** 2
        A = (J.T * weight) @ J
        b = (J.T * weight) @ offset
        prior = (spread / sigma) ** 2
        A[8, 8] += (spread / _BLOOM_PX) ** 2
        A[9:, 9:] += prior * np.eye(len(shifts))
        b[9:] -= prior * shifts
        change = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
        r = offset - J @ change
    return change, r, weight
