"""Pictures of a board in a folder, as views of its numbered points; and a picture of the coverage."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vgrd.devices import Grey
from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Array
from vgrd.vision.images.drawing import BLUE, GOOD, RED, Colour, circle_at
from vgrd.vision.images.pictures import SUFFIXES, as_8_bit, read_picture
from vgrd.vision.intrinsics.estimate import IntrinsicsResult
from vgrd.vision.intrinsics.fit import BoardView
from vgrd.vision.print.boards import Charuco, Chessboard, CircleGrid
from vgrd.vision.print.targets import TagGrid
from vgrd.vision.tags.seeing import see_target

Board = Charuco | Chessboard | CircleGrid | TagGrid
COVERAGE_CELLS = (6, 4)  # columns, rows; a guess: each is smaller than the board in a picture
_WIDTH_PX = 1200  # a guess: fits on any screen
_ARROW_PX = 14.0  # length at which a residual of the rms is drawn; a guess: seen, and apart


@dataclass(frozen=True, slots=True, eq=False)
class BoardPictures:
    """points_in_board: (m, 3) mm; views of pictures that show the board; unusable: why, by name."""

    points_in_board: Array
    views: tuple[BoardView, ...]
    size_px: tuple[int, int]
    unusable: dict[str, str]


def read_board_pictures(
    folder: Path, board: Board, report: Callable[[int, int], None]
) -> BoardPictures:
    """Find the board in every picture of a folder; InputError when there is none, or another size."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name one with pictures of the board")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if not files:
        raise InputError(f"{folder}: holds no pictures ({', '.join(SUFFIXES)})")
    points = board_points(board)
    views: dict[str, tuple[BoardView, tuple[int, int]]] = {}
    unusable = {}
    for number, path in enumerate(files):
        report(number, len(files))
        try:
            grey = as_8_bit(read_picture(path).pixels)
            views[path.name] = (
                _view(path.name, grey, board, points),
                (grey.shape[1], grey.shape[0]),
            )
        except (InputError, TagNotSeen) as error:
            unusable[path.name] = str(error).removeprefix(f"{path}: ")
    sizes = Counter(size for _, size in views.values())
    size = sizes.most_common(1)[0][0] if sizes else (1, 1)
    for name, (_, other) in views.items():
        if other != size:
            unusable[name] = (
                f"has {other[0]} x {other[1]} px, most have {size[0]} x {size[1]}: "
                "pictures of one camera, uncropped, are needed"
            )
    usable = tuple(view for view, other in views.values() if other == size)
    return BoardPictures(points, usable, size, unusable)


def board_points(board: Board) -> Array:
    """The board's points (m, 3), mm, in the order of their numbers."""
    match board:
        case TagGrid():
            return np.concatenate(list(board.corners().values()))
        case Charuco():
            grid = _grid(board.columns - 1, board.rows - 1)
            return np.asarray((grid + np.array([1, 1, 0])) * board.square_mm)
        case Chessboard():
            return _grid(board.columns, board.rows) * board.square_mm
        case CircleGrid():
            grid = _grid(board.columns, board.rows)
            if board.asymmetric:
                grid[:, 0] = 2 * grid[:, 0] + grid[:, 1] % 2
            return grid * board.spacing_mm


def _grid(columns: int, rows: int) -> Array:
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.stack([x, y, np.zeros_like(x)], axis=1).astype(np.float64)


def _view(name: str, grey: Grey, board: Board, points: Array) -> BoardView:
    observation = see_target(grey, board)
    distances = np.linalg.norm(observation.points_in_target[:, None] - points, axis=2)
    return BoardView(name, distances.argmin(axis=1), observation.pixels)


def coverage(views: tuple[BoardView, ...], size_px: tuple[int, int]) -> Array:
    """How many points lie in each cell of the picture, (rows, columns)."""
    pixels = np.concatenate([view.pixels for view in views])
    columns, rows = COVERAGE_CELLS
    edges = (np.linspace(0, size_px[1], rows + 1), np.linspace(0, size_px[0], columns + 1))
    return np.asarray(np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges)[0])


def draw_coverage(result: IntrinsicsResult) -> Colour:
    """Where the board was seen: outlines, points, residuals as arrows, cells without points red."""
    width, height = result.camera.size_px
    scale = _WIDTH_PX / width
    drawing = np.full((round(height * scale), _WIDTH_PX, 3), 255, np.uint8)
    counts = coverage(result.views, result.camera.size_px)
    for row, column in np.argwhere(counts == 0).tolist():
        low = (int(column * _WIDTH_PX / counts.shape[1]), int(row * len(drawing) / len(counts)))
        high = (
            int((column + 1) * _WIDTH_PX / counts.shape[1]),
            int((row + 1) * len(drawing) / len(counts)),
        )
        cv2.rectangle(drawing, low, high, (225, 225, 250), -1)
    for view in result.views:
        hull = cv2.convexHull(view.pixels.astype(np.float32))
        outline = np.rint(hull * scale).astype(np.int32)
        cv2.polylines(drawing, [outline], True, (200, 200, 200), 1, cv2.LINE_AA)
    arrow = _ARROW_PX / max(result.rms_px * np.sqrt(2), 1e-9)
    for view, residuals in zip(result.views, result.bundle.residuals, strict=True):
        for pixel, residual in zip(view.pixels * scale, residuals * arrow, strict=True):
            tip = np.rint(pixel - residual).astype(int)
            start = np.rint(pixel).astype(int)
            cv2.line(drawing, tuple(start.tolist()), tuple(tip.tolist()), BLUE, 1, cv2.LINE_AA)
            circle_at(drawing, pixel, 1.5, GOOD, -1)
    centre = result.camera.matrix[:2, 2] * scale
    cv2.drawMarker(
        drawing, tuple(np.rint(centre).astype(int).tolist()), RED, cv2.MARKER_CROSS, 24, 2
    )
    text = (
        f"{len(result.views)} pictures, rms {result.rms_px:.3g} px (arrows x {arrow / scale:.0f}), "
        "cross: principal point, red: no points"
    )
    cv2.putText(
        drawing, text, (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 40, 40), 1, cv2.LINE_AA
    )
    return drawing
