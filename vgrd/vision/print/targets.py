"""Targets to print: single tags, boards of several tags, ChArUco boards, with all that measuring needs.

A board's frame is as in `vgrd.vision.print.boards`: x along its columns, y along its rows, mm.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.model.cell import SMALLEST_TAG_MM
from vgrd.vision.print.boards import Charuco, SingleTag
from vgrd.vision.print.codes import (
    APRILTAG_FAMILIES,
    code_count,
    dictionary_of,
    family_named,
    marker_cells,
    square_corners,
)
from vgrd.vision.print.sheet import Sheet, SheetRaster, Text

PAGES_MM = {"a5": (148.0, 210.0), "a4": (210.0, 297.0), "a3": (297.0, 420.0)} | {  # ISO 216
    "letter": (215.9, 279.4),  # 8.5 x 11 inches
    "tabloid": (279.4, 431.8),  # 11 x 17 inches
}
BARE = "bare"  # a page as large as the target and its white rim, nothing else on it
_MARGIN_MM = 10.0  # a guess: more than printers leave white; it takes room from targets
_LINE_MM = 5.0  # 14 points: 9 and the space between lines
_LETTER_MM = 3.2  # 9 points: read at arm's length
_BAR_MM = (100.0, 50.0)  # the longest that fits
_FOOTER_MM = 42.0  # 29 from the target to the last line, the margin, 3 to spare


@dataclass(frozen=True, slots=True)
class TagGrid:
    """Board of columns x rows tags with ids from first_id on, row by row; gap_mm: between squares.

    Its origin is the outer corner of the first tag's black square.
    """

    dictionary: str
    columns: int
    rows: int
    size_mm: float
    gap_mm: float
    first_id: int = 0

    def __post_init__(self) -> None:
        last, capacity = self.first_id + self.columns * self.rows - 1, code_count(self.dictionary)
        if self.first_id < 0 or last >= capacity:
            raise InputError(
                f"{self.columns} x {self.rows} tags from id {self.first_id} end with id {last}, "
                f"{self.dictionary} has the ids 0 to {capacity - 1}"
            )
        if self.size_mm <= 0 or self.gap_mm < self.cell_mm:
            raise InputError(
                f"gap_mm = {self.gap_mm:g} must be at least one cell of the tag, "
                f"{self.cell_mm:.3g} mm: tags need a white rim"
            )

    @property
    def cell_mm(self) -> float:
        """Edge of one cell of a tag."""
        return self.size_mm / len(marker_cells(self.dictionary, self.first_id))

    def id_at(self, row: int, column: int) -> int:
        """Id of the tag in a row and a column."""
        return self.first_id + row * self.columns + column

    def joints(self) -> Array:
        """Lowest corners (n, 2) of black squares of edge gap_mm between the tags: none."""
        return np.zeros((0, 2))

    def corners(self) -> Mapping[int, Array]:
        """Corners (4, 3) of every tag by id, in the tag's own order, board frame, mm."""
        pitch = self.size_mm + self.gap_mm
        half = self.size_mm / 2
        square = square_corners(self.size_mm)
        return {
            self.id_at(row, column): square
            + np.array([column * pitch + half, row * pitch + half, 0])
            for row in range(self.rows)
            for column in range(self.columns)
        }


@dataclass(frozen=True, slots=True)
class AprilGrid(TagGrid):
    """Kalibr's AprilGrid: ids from the bottom left, row by row upwards, a black square at every corner of a tag.

    Its origin is the outer corner of the top left tag, as of the other boards: Kalibr counts y upwards from
    the bottom left one. gap_mm: tagSpacing times tagSize.
    """

    def id_at(self, row: int, column: int) -> int:
        """Id of the tag in a row, 0 at the top, and a column."""
        return self.first_id + (self.rows - 1 - row) * self.columns + column

    def joints(self) -> Array:
        """Lowest corners (n, 2) of the black squares of edge gap_mm, board frame, mm."""
        pitch = self.size_mm + self.gap_mm
        return np.array(
            [
                (column * pitch - self.gap_mm, row * pitch - self.gap_mm)
                for row in range(self.rows + 1)
                for column in range(self.columns + 1)
            ]
        )


Printable = SingleTag | TagGrid | Charuco


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """A target at the origin: its rasters, extent, the white rim it needs, mm."""

    rasters: tuple[SheetRaster, ...]
    width_mm: float
    height_mm: float
    rim_mm: float


def target_sheet(target: Printable, page: str) -> Sheet:
    """Lay a target out on a page: a name of PAGES_MM, WIDTHxHEIGHT in mm, or "bare".

    InputError when the page is unknown or too small; it is turned where only that makes it fit.
    """
    drawn = _drawn(target)
    width, height = drawn.width_mm + 2 * drawn.rim_mm, drawn.height_mm + 2 * drawn.rim_mm
    if page == BARE:
        rasters = tuple(_moved(raster, drawn.rim_mm, drawn.rim_mm) for raster in drawn.rasters)
        return Sheet(width, height, rasters, ())
    page_width, page_height = _page(page, width, height)
    left = (page_width - drawn.width_mm) / 2
    top = _MARGIN_MM + drawn.rim_mm
    rasters = tuple(_moved(raster, left, top) for raster in drawn.rasters)
    footer = top + drawn.height_mm + drawn.rim_mm + 3
    bar, bar_texts = _scale_bar(footer + 3 * _LINE_MM + 3, page_width)
    texts = tuple(
        Text(_MARGIN_MM, footer + (i + 1) * _LINE_MM, _LETTER_MM, line)
        for i, line in enumerate(_label(target))
    )
    return Sheet(page_width, page_height, (*rasters, *bar), (*texts, *bar_texts))


def config_lines(target: Printable) -> tuple[str, ...]:
    """The target as TOML: lines of a tag's table of the cell file, or of a [target] table."""
    match target:
        case SingleTag():
            key = "family" if target.dictionary in APRILTAG_FAMILIES else "dictionary"
            values = {key: target.dictionary, "id": target.id, "size_mm": target.size_mm}
        case TagGrid():
            kind = "aprilgrid" if isinstance(target, AprilGrid) else "tags"
            values = {"type": kind, "dictionary": target.dictionary}
            values |= {"columns": target.columns, "rows": target.rows}
            values |= {"size_mm": target.size_mm, "gap_mm": target.gap_mm}
            values |= {"first_id": target.first_id}
        case Charuco():
            values = {"type": "charuco", "columns": target.columns, "rows": target.rows}
            values |= {"square_mm": target.square_mm, "marker_mm": target.marker_mm}
            values |= {"dictionary": target.dictionary}
            values |= {"first_id": target.first_id} if target.first_id else {}
    return tuple(
        f"{key} = " + (f'"{value}"' if isinstance(value, str) else f"{value}")
        for key, value in values.items()
    )


def check_size(what: str, size_mm: float) -> None:
    """InputError for a size below what a cell file takes: it is in metres, or no size at all."""
    if not size_mm >= SMALLEST_TAG_MM:
        metres = f"; in metres? {1000 * size_mm:g} mm" if size_mm > 0 else ""
        raise InputError(
            f"{what} of {size_mm:g} mm: give the edge of the black square in mm, {SMALLEST_TAG_MM:g} or "
            f"more{metres}"
        )


def checked_tag(dictionary: str, tag_id: int, size_mm: float) -> SingleTag:
    """One tag; InputError for an unknown family, an id it has not, or no size."""
    family = family_named(dictionary)
    marker_cells(family, tag_id)
    check_size("a tag", size_mm)
    return SingleTag(family, tag_id, size_mm)


def _drawn(target: Printable) -> _Drawn:
    match target:
        case SingleTag():
            raster = _marker(target.dictionary, target.id, np.zeros(2), target.size_mm)
            cell = target.size_mm / len(raster.cells)
            return _Drawn((raster,), target.size_mm, target.size_mm, 2 * cell)
        case TagGrid():
            markers = tuple(
                _marker(target.dictionary, tag_id, corners.min(0), target.size_mm)
                for tag_id, corners in target.corners().items()
            )
            black = np.ones((1, 1), dtype=np.bool_)
            joints = tuple(
                SheetRaster(float(x), float(y), target.gap_mm, target.gap_mm, black)
                for x, y in target.joints()
            )
            pitch = target.size_mm + target.gap_mm
            width, height = pitch * target.columns, pitch * target.rows
            rim = 2 * target.cell_mm + (target.gap_mm if joints else 0)
            return _Drawn((*markers, *joints), width - target.gap_mm, height - target.gap_mm, rim)
        case Charuco():
            return _charuco(target)


def _charuco(board: Charuco) -> _Drawn:
    width, height = board.columns * board.square_mm, board.rows * board.square_mm
    squares = np.indices((board.rows, board.columns)).sum(0) % 2 == 0
    layout = cv2.aruco.CharucoBoard(
        (board.columns, board.rows),
        board.square_mm,
        board.marker_mm,
        dictionary_of(board.dictionary),
        np.array(board.marker_ids[: board.columns * board.rows // 2]),
    )
    markers = tuple(
        _marker(board.dictionary, int(tag_id), np.min(corners, axis=0), board.marker_mm)
        for tag_id, corners in zip(np.ravel(layout.getIds()), layout.getObjPoints(), strict=True)
    )
    chess = SheetRaster(0, 0, width, height, squares)
    return _Drawn((chess, *markers), width, height, board.square_mm / 4)


def _marker(family: str, tag_id: int, corner_mm: Array, size_mm: float) -> SheetRaster:
    black = np.asarray(marker_cells(family, tag_id) < 0.5)
    return SheetRaster(float(corner_mm[0]), float(corner_mm[1]), size_mm, size_mm, black)


def _moved(raster: SheetRaster, x_mm: float, y_mm: float) -> SheetRaster:
    return SheetRaster(
        raster.x_mm + x_mm, raster.y_mm + y_mm, raster.width_mm, raster.height_mm, raster.cells
    )


def _page(page: str, width: float, height: float) -> tuple[float, float]:
    """Width and height of the page, turned if only that makes the target fit."""
    size = PAGES_MM.get(page.lower())
    if size is None:
        try:
            first, second = (float(number) for number in page.lower().split("x"))
        except ValueError:
            names = ", ".join([*PAGES_MM, "WIDTHxHEIGHT in mm", BARE])
            raise InputError(f"page {page!r} is unknown; known: {names}") from None
        size = (first, second)
    need = (width + 2 * _MARGIN_MM, height + _MARGIN_MM + _FOOTER_MM)
    for page_width, page_height in (size, size[::-1]):
        if need[0] <= page_width and need[1] <= page_height:
            return page_width, page_height
    raise InputError(
        f"the target with its white rim and label needs {need[0]:.1f} x {need[1]:.1f} mm, the page "
        f"has {size[0]:g} x {size[1]:g}: choose a smaller size, a larger --page, or --page {BARE}"
    )


def _label(target: Printable) -> tuple[str, str, str]:
    match target:
        case SingleTag():
            kind = "AprilTag" if target.dictionary in APRILTAG_FAMILIES else "ArUco"
            title = f"{kind} {target.dictionary}, id {target.id}, {target.size_mm:g} mm"
            measured = "Measured edge of the black square: size_mm = ________"
            usage = "Key size_mm of [tags.a] or [tags.b] in the cell file. This side up."
        case TagGrid():
            last = target.first_id + target.columns * target.rows - 1
            title = (
                f"{target.columns} x {target.rows} tags {target.dictionary}, ids {target.first_id} "
                f"to {last}, {target.size_mm:g} mm, gap {target.gap_mm:g} mm"
            )
            measured = "Measured: size_mm = ________  gap_mm = ________"
            usage = "Keys size_mm and gap_mm of [target] in a board file. This side up."
        case Charuco():
            title = (
                f"ChArUco {target.columns} x {target.rows} squares, {target.dictionary}, "
                f"{target.square_mm:g} mm, markers {target.marker_mm:g} mm"
            )
            measured = "Measured over all squares: square_mm = ________  marker_mm = ________"
            usage = "Keys square_mm and marker_mm of [target] in a board file or DATASET.toml."
    return title, measured, usage


def _scale_bar(y_mm: float, page_width_mm: float) -> tuple[list[SheetRaster], list[Text]]:
    """A bar with a tick every 10 mm and what to do with it."""
    room = page_width_mm - 2 * _MARGIN_MM
    length = next((bar for bar in _BAR_MM if bar <= room), None)
    if length is None:
        return [], []
    ticks = int(length // 10) + 1
    black = np.ones((1, 1), dtype=np.bool_)
    line = SheetRaster(_MARGIN_MM, y_mm, length, 0.3, black)
    # The outer faces of the end ticks are what is measured.
    centres = [_MARGIN_MM + 0.1, *(_MARGIN_MM + 10.0 * i for i in range(1, ticks - 1))]
    centres.append(_MARGIN_MM + length - 0.1)
    ruler = [SheetRaster(x - 0.1, y_mm + 0.3, 0.2, 3.0, black) for x in centres]
    text = f"Print at 100 % (actual size). This bar is {length:g} mm over its ends; measured: ________"
    return [line, *ruler], [Text(_MARGIN_MM, y_mm + 8.0, _LETTER_MM, text)]
