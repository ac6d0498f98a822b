"""What is printed: a plane cut into black and white cells by two sets of lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.print.codes import marker_cells


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Cells (rows, columns), 0 black to 1 white, between the lines x (columns + 1,) and y (rows + 1,).

    Frame of the target, x right, y down, mm. corners: (4, 2) of the square that stands for the target,
    (-,-), (+,-), (+,+), (-,+). The outermost cells are the paper around it.
    """

    cells: Array
    x: Array
    y: Array
    corners: Array

    @property
    def smallest_cell(self) -> float:
        """Smallest distance of two lines, mm."""
        return float(min(np.diff(self.x).min(), np.diff(self.y).min()))


def tag_raster(family: str, tag_id: int, size_mm: float) -> Raster:
    """One tag with one white cell around it."""
    cells = marker_cells(family, tag_id)
    n = len(cells)
    lines = (np.arange(-1, n + 2) - n / 2) * size_mm / n
    half = size_mm / 2
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    return Raster(np.pad(cells, 1, constant_values=1.0), lines, lines, corners)


def joined(
    parts: Sequence[tuple[Array, Array, Array]], rim: tuple[Array, Array], background: float = 1.0
) -> Raster:
    """Raster of several parts (cells, x lines, y lines) on paper between the lines `rim` (2,), (2,)."""
    x = _merged([rim[0], *(part[1] for part in parts)])
    y = _merged([rim[1], *(part[2] for part in parts)])
    middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    cells = np.full((len(middle_y), len(middle_x)), background)
    for part, px, py in parts:
        columns = np.searchsorted(px, middle_x) - 1
        rows = np.searchsorted(py, middle_y) - 1
        inside_x = np.flatnonzero((columns >= 0) & (columns < part.shape[1]))
        inside_y = np.flatnonzero((rows >= 0) & (rows < part.shape[0]))
        cells[np.ix_(inside_y, inside_x)] = part[np.ix_(rows[inside_y], columns[inside_x])]
    low = np.array([min(p[1][0] for p in parts), min(p[2][0] for p in parts)])
    high = np.array([max(p[1][-1] for p in parts), max(p[2][-1] for p in parts)])
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return Raster(cells, x, y, corners)


def _merged(lines: Sequence[Array]) -> Array:
    """All lines once, those within rounding joined."""
    every = np.sort(np.concatenate(lines))
    return np.asarray(every[np.append(True, np.diff(every) > 1e-6 * (every[-1] - every[0]))])
