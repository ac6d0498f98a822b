"""What is printed on planes or drilled into them: tags, boards of tags, ChArUco boards, holes.

Planes have x right, y down, z into the paper; mm. White is 1, black is 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from fakes.camera.sensor import Plane
from vgrd.geometry import Array
from vgrd.model import TagSpec
from vgrd.vision.print.boards import BOARD_DICTIONARIES, Charuco

APRILTAG_FAMILIES = ("16h5", "25h9", "36h11")
_ARUCO_NAMED = ("original", "mip_36h12")
_SAME_LINE_MM = 1e-7  # rounding of sums of cells; no printer draws lines so near


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Fields between lines parallel to the axes.

    x_mm (k,), y_mm (m,): ascending; white (m + 1, k + 1): row i lies above y_mm[i], the last one
    below all; the outermost fields have no end.
    """

    x_mm: Array
    y_mm: Array
    white: Plane

    def with_ink_spread(self, spread_mm: float) -> "Pattern":
        """Let every black edge move by `spread_mm` (less than half a field) into the white around it."""
        lines = [
            (edges[:, None] + abs(spread_mm) * np.array([-1, 1])).ravel()
            for edges in (self.x_mm, self.y_mm)
        ]
        wins = np.minimum if spread_mm > 0 else np.maximum
        white = self.white
        for _ in range(2):
            wider = np.repeat(white, 2, axis=0)[:-1]
            wider[1::2] = wins(white[:-1], white[1:])
            white = wider.T
        return Pattern(lines[0], lines[1], white) if spread_mm else self

    def scaled(self, scale: float) -> "Pattern":
        """Print everything larger by a factor."""
        return Pattern(self.x_mm * scale, self.y_mm * scale, self.white)

    def on_paper(self, margin_mm: float, paper: float) -> "Pattern":
        """Cut the paper `margin_mm` outside of the outermost lines; `paper` is the white beyond it."""
        low, high = self.bounds_mm
        x = np.concatenate([[low[0] - margin_mm], self.x_mm, [high[0] + margin_mm]])
        y = np.concatenate([[low[1] - margin_mm], self.y_mm, [high[1] + margin_mm]])
        return Pattern(x, y, np.pad(self.white, 1, constant_values=np.float32(paper)))

    @property
    def bounds_mm(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,) of the lines."""
        return np.array([self.x_mm[0], self.y_mm[0]]), np.array([self.x_mm[-1], self.y_mm[-1]])


@dataclass(frozen=True, slots=True, eq=False)
class Disc:
    """A round field: centre_mm (2,), white inside and outside."""

    centre_mm: Array
    radius_mm: float
    inside: float = 0.0
    outside: float = 1.0

    @property
    def bounds_mm(self) -> tuple[Array, Array]:
        """Lower and upper corner (2,)."""
        return self.centre_mm - self.radius_mm, self.centre_mm + self.radius_mm


Figure = Pattern | Disc


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """A raster of square cells (rows, columns) with its corner of lowest x and y at corner_mm (2,)."""

    cells: Plane
    cell_mm: float
    corner_mm: Array = field(default_factory=lambda: np.zeros(2))


def tag_cells(family: str, tag_id: int) -> Plane:
    """Cells (n, n) of a tag's black square and what is in it, row 0 at its top as published.

    family: of AprilTag ("36h11") or an ArUco dictionary ("4x4_50").
    """
    if family in APRILTAG_FAMILIES:
        # OpenCV draws AprilTags turned by 180 deg.
        return _cells_of(f"apriltag_{family}", tag_id)[::-1, ::-1]
    return _cells_of(family, tag_id)


def tag_pattern(tag: TagSpec) -> Pattern:
    """A tag, origin in its centre."""
    cells = tag_cells(tag.family, tag.id)
    corner = np.full(2, -tag.size_mm / 2)
    return pattern_of([Mark(cells, tag.size_mm / len(cells), corner)])


def grid_pattern(tags: Sequence[TagSpec], columns: int, gap_mm: float) -> Pattern:
    """Tags of one size row by row, `gap_mm` between them, origin in the centre of the first."""
    marks = []
    for i, tag in enumerate(tags):
        cells = tag_cells(tag.family, tag.id)
        place = np.array([i % columns, i // columns]) * (tag.size_mm + gap_mm)
        marks.append(Mark(cells, tag.size_mm / len(cells), place - tag.size_mm / 2))
    return pattern_of(marks)


def charuco_pattern(board: Charuco) -> Pattern:
    """A ChArUco board in OpenCV's present layout, origin in its outer corner."""
    rows, columns = np.indices((board.rows, board.columns))
    squares = ((rows + columns) % 2).astype(np.float32)
    marks = [Mark(squares, board.square_mm)]
    inset = (board.square_mm - board.marker_mm) / 2
    for i, (row, column) in enumerate(np.argwhere(squares == 1)):
        cells = _cells_of(board.dictionary, i)
        corner = board.square_mm * np.array([column, row]) + inset
        marks.append(Mark(cells, board.marker_mm / len(cells), corner))
    return pattern_of(marks)


def pattern_of(marks: Sequence[Mark]) -> Pattern:
    """Marks on infinite white paper; later ones are over earlier ones."""
    x, y = (_lines(marks, axis) for axis in (0, 1))
    white = np.ones((len(y) + 1, len(x) + 1), np.float32)
    mid_x, mid_y = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
    for mark in marks:
        column = np.floor((mid_x - mark.corner_mm[0]) / mark.cell_mm).astype(int)
        row = np.floor((mid_y - mark.corner_mm[1]) / mark.cell_mm).astype(int)
        inside_x = np.flatnonzero((column >= 0) & (column < mark.cells.shape[1]))
        inside_y = np.flatnonzero((row >= 0) & (row < mark.cells.shape[0]))
        white[np.ix_(inside_y + 1, inside_x + 1)] = mark.cells[
            np.ix_(row[inside_y], column[inside_x])
        ]
    return Pattern(x, y, white)


def _lines(marks: Sequence[Mark], axis: int) -> Array:
    """All lines of the marks' cells across an axis (0: x), ascending, each once."""
    lines = np.sort(
        np.concatenate(
            [
                mark.corner_mm[axis] + mark.cell_mm * np.arange(mark.cells.shape[1 - axis] + 1)
                for mark in marks
            ]
        )
    )
    return np.asarray(lines[np.concatenate([[True], np.diff(lines) > _SAME_LINE_MM])])


def _cells_of(dictionary: str, marker_id: int) -> Plane:
    """Cells of a marker as OpenCV draws it."""
    if dictionary not in BOARD_DICTIONARIES:
        raise ValueError(f"no dictionary {dictionary!r}")
    prefix = "DICT_ARUCO_" if dictionary in _ARUCO_NAMED else "DICT_"
    library = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, prefix + dictionary.upper()))
    side = library.markerSize + 2
    marker = cv2.aruco.generateImageMarker(library, marker_id, side, borderBits=1)
    return (marker > 127).astype(np.float32)
