"""Why a target is not found although a person sees it: the picture is tried as other targets would read it.

A cause is told only with evidence: markers that read without a wrong cell, or corners of the board.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.devices import Grey
from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Array
from vgrd.vision.print.boards import (
    MIN_POINTS,
    Charuco,
    Chessboard,
    CircleGrid,
    SingleTag,
    TargetSpec,
    detect_board,
)
from vgrd.vision.print.codes import (
    APRILTAG_FAMILIES,
    SQUARE_FAMILIES,
    code_count,
    dictionary_of,
    marker_cells,
)
from vgrd.vision.print.targets import TagGrid
from vgrd.vision.tags.detection import read_cells

_WIDEST_PX = 1300  # as the coarse level of `find_tags`: a cause need not be seen at its finest
_OTHER_FAMILIES = (  # the largest of each size holds the smaller ones' codes
    *("4x4_1000", "5x5_1000", "6x6_1000", "7x7_1000", "original", "mip_36h12"),
    *APRILTAG_FAMILIES,
)
_SAME_CODES = {f"apriltag_{family}": family for family in APRILTAG_FAMILIES}
_OF_A_BOARD = 3  # markers of another family in a picture are no chance; one may be
_DARK_RIM = 0.35  # share of dark cells around a marker from which `read_tag` refuses it
_MOST_CORNERS = 0.7  # of another size that are seen: fewer may be a board half covered
_DARKEST_WHITE = (
    40.0  # grey levels of the brightest hundredth: noise and rounding are a tenth of it
)
_BRIGHTEST_BLACK = 235.0  # grey levels of the darkest hundredth: the ink itself is saturated
_LEAST_CONTRAST = 40.0  # grey levels: a marker read from less is more often a pattern of noise


@dataclass(frozen=True, slots=True, eq=False)
class _Marker:
    """A marker that reads without a wrong cell; thin: its white rim is dark on one side or more."""

    id: int
    thin: bool


def cause_for_target(grey: Grey, target: TargetSpec | TagGrid) -> str | None:
    """Why the target is not found in a grey picture (h, w), with the remedy; None where nothing tells it."""
    grey = _shrunk(grey)
    return _target_cause(grey, target) or _exposure_cause(grey)


def _target_cause(grey: Grey, target: TargetSpec | TagGrid) -> str | None:
    match target:
        case Chessboard():
            return _chessboard_cause(grey, target)
        case CircleGrid():
            return _circles_cause(grey, target)
        case Charuco():
            return _charuco_cause(grey, target) or _marker_cause(
                grey, target.dictionary, target.marker_ids, _OF_A_BOARD
            )
        case TagGrid():
            return _marker_cause(grey, target.dictionary, sorted(target.corners()), _OF_A_BOARD)
        case SingleTag():
            return _marker_cause(grey, target.dictionary, [target.id], 1)


def cause_for_family(grey: Grey, families: Sequence[str]) -> str | None:
    """Why no tag of the families is found at all."""
    grey = _shrunk(grey)
    causes = (_marker_cause(grey, family, None, 1) for family in families)
    return next((cause for cause in causes if cause is not None), None)


def _shrunk(grey: Grey) -> Grey:
    scale = _WIDEST_PX / grey.shape[1]
    if scale >= 1:
        return np.ascontiguousarray(grey)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _charuco_cause(grey: Grey, board: Charuco) -> str | None:
    """Whether the board is one of other columns and rows; the first id that is seen counts as its own."""
    markers = _markers(grey, board.dictionary)
    first = min((marker.id for marker in markers), default=board.first_id)
    columns, rows = board.columns, board.rows
    best, cause = 0.0, None
    for size, told in (
        ((rows, columns), "columns and rows look swapped"),
        ((columns + 1, rows + 1), "columns and rows are those of squares, not of inner corners"),
        ((columns - 1, rows - 1), "columns and rows are one too large"),
        ((columns + 1, rows), "columns are one too few"),
        ((columns - 1, rows), "columns are one too many"),
    ):
        fits = _charuco_corners(grey, board, size, board.first_id) if size[0] != columns else 0
        share = fits / max(1, (size[0] - 1) * (size[1] - 1))
        # Swapped ones fit by no chance: a board that is half covered tells it too.
        least = 0.0 if size == (rows, columns) else _MOST_CORNERS
        if share > max(best, least):
            fit = f"as {size[0]} x {size[1]} squares {fits} corners fit"
            best, cause = share, f"{told}: {fit}; write columns = {size[0]}, rows = {size[1]}"
    if cause is not None:
        return cause
    if first != board.first_id:
        fits = _charuco_corners(grey, board, (columns, rows), first)
        if fits >= _MOST_CORNERS * (columns - 1) * (rows - 1):
            return f"its markers begin with id {first}; is first_id = {first} meant?"
    return None


def _charuco_corners(grey: Grey, board: Charuco, size: tuple[int, int], first_id: int) -> int:
    """How many corners of a board of another size are seen; 0 for one that cannot exist."""
    try:
        other = Charuco(*size, board.square_mm, board.marker_mm, board.dictionary, first_id)
        return len(detect_board(grey, other).pixels) if min(size) > 1 else 0
    except (TagNotSeen, InputError):
        return 0


def _marker_cause(grey: Grey, family: str, wanted: Sequence[int] | None, least: int) -> str | None:
    """wanted: ids of the target, None for any; least: markers that another family has to show."""
    family = _SAME_CODES.get(family, family)
    if family not in SQUARE_FAMILIES:
        return _other_family(grey, family, least)
    markers = _markers(grey, family)
    ids = sorted({marker.id for marker in markers if not marker.thin})
    thin = sorted({marker.id for marker in markers if marker.thin})
    if not ids and "border" not in family and _markers(grey, family, border=2):
        remedy = ': type = "aprilgrid", or dictionary 36h11_border2' if family == "36h11" else ""
        return f"its black border is two cells wide (border bits 2), as Kalibr prints AprilGrids{remedy}"
    if thin and len(thin) > len(ids):
        return (
            f"the white rim of id {_listed(thin)} is thin or dark: a marker needs a rim of at least one "
            "of its cells in white; print it with more paper around it"
        )
    if ids and wanted is not None and not set(ids) & set(wanted):
        first = f"; is first_id = {ids[0]} meant?" if len(wanted) > 1 else ""
        return f"{family} is seen with id {_listed(ids)}, the target has id {_listed(list(wanted))}{first}"
    if _markers(np.asarray(255 - grey, dtype=np.uint8), family):
        return "black and white are swapped: the print or the picture is inverted; print black on white"
    if _markers(np.ascontiguousarray(grey[:, ::-1]), family):
        return "it is seen as in a mirror: printed wrongly, or the picture is flipped"
    return None if ids else _other_family(grey, family, least)


def _other_family(grey: Grey, family: str, least: int) -> str | None:
    best: tuple[int, str] | None = None
    for other in _OTHER_FAMILIES:
        if other == family or _holds_codes_of(family, other):
            continue
        ids = {marker.id for marker in _markers(grey, other) if not marker.thin}
        if len(ids) >= least and (best is None or len(ids) > best[0]):
            name = _smallest(other, max(ids))
            best = len(ids), f"{name} are in the picture (id {_listed(sorted(ids))})"
    if best is None:
        return None
    return f"markers of another family, {best[1]}: is the dictionary right?"


def _holds_codes_of(family: str, other: str) -> bool:
    """Whether a family has all codes of another: 4x4_1000 those of 4x4_50."""
    sizes = family.partition("_")[0], other.partition("_")[0]
    is_numbered = other[0].isdigit() and "x" in sizes[1]
    return is_numbered and sizes[0] == sizes[1] and code_count(family) >= code_count(other)


def _smallest(family: str, tag_id: int) -> str:
    """The smallest dictionary of the same codes that holds the id."""
    size, _, count = family.partition("_")
    if not count.isdigit():
        return family
    return next(f"{size}_{n}" for n in (50, 100, 250, 1000) if tag_id < n)


def _markers(grey: Grey, family: str, border: int | None = None) -> list[_Marker]:
    return list(_read_markers(grey, family, border))


def _read_markers(grey: Grey, family: str, border: int | None) -> Iterator[_Marker]:
    parameters = cv2.aruco.DetectorParameters()
    cells = len(marker_cells(family, 0)) - dictionary_of(family).markerSize
    parameters.markerBorderBits = border or cells // 2
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary_of(family), parameters).detectMarkers(
        grey
    )
    for quad, tag_id in zip(corners, [] if ids is None else np.ravel(ids), strict=True):
        square: Array = np.asarray(quad, dtype=np.float64).reshape(4, 2)
        if family in APRILTAG_FAMILIES:
            square = square[[2, 3, 0, 1]]
        code = marker_cells(family, int(tag_id))
        if border is not None and border != cells // 2:
            code = np.pad(code, border - cells // 2)
        seen = read_cells(grey, square, len(code))
        inner = seen[1:-1, 1:-1]
        white, black = float(np.median(inner[code > 0.5])), float(np.median(inner[code < 0.5]))
        level = (white + black) / 2
        if white - black < _LEAST_CONTRAST or ((inner > level) != (code > 0.5)).any():
            continue
        rim = np.concatenate([seen[0], seen[-1], seen[1:-1, 0], seen[1:-1, -1]])
        thin = bool(np.mean(rim < level) > _DARK_RIM)
        if border is None or not thin:
            yield _Marker(int(tag_id), thin)


def _chessboard_cause(grey: Grey, target: Chessboard) -> str | None:
    size = _chessboard_size(grey)
    stated = target.columns, target.rows
    if size is None or size[0] * size[1] < MIN_POINTS or sorted(size) == sorted(stated):
        return None
    if (size[0] < size[1]) != (stated[0] < stated[1]):
        size = size[::-1]
    told = "a board of other columns and rows is seen"
    if size == (stated[0] - 1, stated[1] - 1):
        told = "columns and rows are those of inner corners, not of squares"
    return f"{told}: columns = {size[0]}, rows = {size[1]} fit, where the whole board is in the picture"


def _chessboard_size(grey: Grey) -> tuple[int, int] | None:
    """Columns and rows of inner corners of the largest chessboard that is seen, either way round."""
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
    ok, _, grid = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), flags)
    return (grid.shape[1], grid.shape[0]) if ok else None


def _circles_cause(grey: Grey, target: CircleGrid) -> str | None:
    columns, rows = target.columns, target.rows
    if columns != rows and _is_seen(grey, target, (rows, columns)):
        return f"columns and rows look swapped: columns = {rows}, rows = {columns} fit"
    if _is_seen(np.asarray(255 - grey, dtype=np.uint8), target, (columns, rows)):
        return "the circles are white on black: print them dark on white, or invert the picture"
    kinds = CircleGrid(columns, rows, target.spacing_mm, not target.asymmetric)
    if _is_seen(grey, kinds, (columns, rows)):
        other_kind = "circles" if target.asymmetric else "asymmetric-circles"
        return f'the grid is of the other kind: type = "{other_kind}"'
    return None


def _exposure_cause(grey: Grey) -> str | None:
    """Whether the picture is too dark or too bright for any target."""
    bright, dark = np.percentile(grey, (99, 1))
    if bright < _DARKEST_WHITE:
        return f"the picture is dark, its white is at {bright:.0f} of 255: expose longer, or add light"
    if dark > _BRIGHTEST_BLACK:
        return f"the picture is too bright, its black is at {dark:.0f} of 255: expose shorter"
    return None


def _is_seen(grey: Grey, target: CircleGrid, size: tuple[int, int]) -> bool:
    other = CircleGrid(*size, target.spacing_mm, target.asymmetric)
    try:
        return len(detect_board(grey, other).pixels) >= MIN_POINTS
    except TagNotSeen:
        return False


def _listed(ids: Sequence[int]) -> str:
    """Ids as words: "3", "0 to 11", "1, 5, 9"."""
    if len(ids) > 2 and ids[-1] - ids[0] == len(ids) - 1:
        return f"{ids[0]} to {ids[-1]}"
    most = 6  # more would hide the remedy
    return ", ".join(map(str, ids[:most])) + (" ..." if len(ids) > most else "")
