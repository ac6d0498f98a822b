"""Calibration targets in a grey picture: ChArUco boards, chessboards, circle grids, single tags.

Every target has a frame: x along its columns, y along its rows, z = 0 on its surface, mm. Its
origin is the outer corner of the board (charuco), the first inner corner (chessboard), the first
circle (circles) or the centre (tag). Pixels follow OpenCV: the centre of the first pixel is (0, 0).
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import pyapriltags

from vgrd.devices import Grey
from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Array
from vgrd.vision.print.codes import ARUCO_DICTIONARIES, LIBRARY_FAMILIES, dictionary_of

MIN_POINTS = (
    6  # four of a plane fix a pose without any redundancy: one wrong corner goes unnoticed
)
_MIN_SPREAD = 0.1  # second to first singular value of the points: below it they lie on a line
_ON_GRID = 0.3  # of the spacing: a lens bends less over one circle, a stray spot lies anywhere
_APRILTAG_FAMILIES = {
    "16h5": "tag16h5",
    "25h9": "tag25h9",
    "36h11": "tag36h11",
    **LIBRARY_FAMILIES,
}
BOARD_DICTIONARIES = tuple(ARUCO_DICTIONARIES)
TAG_DICTIONARIES = (*_APRILTAG_FAMILIES, *ARUCO_DICTIONARIES)


@dataclass(frozen=True, slots=True)
class Charuco:
    """ChArUco board of columns x rows squares, in OpenCV's layout before or since 4.6.

    first_id: of its first marker; the others count on from there.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str
    first_id: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.marker_mm < self.square_mm:
            raise InputError(
                f"marker_mm = {self.marker_mm:g} must be below square_mm = {self.square_mm:g}"
            )
        count, capacity = (
            self.columns * self.rows // 2,
            len(dictionary_of(self.dictionary).bytesList),
        )
        if self.first_id < 0 or self.first_id + count > capacity:
            start = f" from id {self.first_id} on" if self.first_id else ""
            raise InputError(
                f"{self.columns} x {self.rows} squares hold {count} markers{start}, dictionary "
                f"{self.dictionary} has {capacity}: columns, rows or dictionary are wrong"
            )

    @property
    def marker_ids(self) -> range:
        """Ids of its markers, in the order of their places; of the layout with the most."""
        return range(self.first_id, self.first_id + (self.columns * self.rows + 1) // 2)


@dataclass(frozen=True, slots=True)
class Chessboard:
    """Chessboard with columns x rows inner corners."""

    columns: int
    rows: int
    square_mm: float


@dataclass(frozen=True, slots=True)
class CircleGrid:
    """Dark circles on white.

    spacing_mm: between neighbouring centres; asymmetric: between neighbouring rows, circles of
    one row are two spacings apart and every other row is shifted by one (OpenCV's layout).
    """

    columns: int
    rows: int
    spacing_mm: float
    asymmetric: bool = False


@dataclass(frozen=True, slots=True)
class SingleTag:
    """One tag: AprilTag family ("36h11") or ArUco dictionary ("4x4_50"), id, edge of its square."""

    dictionary: str
    id: int
    size_mm: float


TargetSpec = Charuco | Chessboard | CircleGrid | SingleTag


def has_direction(target: object) -> bool:
    """Whether a half turn changes the target's looks; otherwise its points may come reversed."""
    match target:
        case Chessboard():
            return (target.columns + target.rows) % 2 == 1
        case CircleGrid():
            return target.asymmetric and target.rows % 2 == 1
        case _:
            return True


@dataclass(frozen=True, slots=True, eq=False)
class BoardObservation:
    """Points found: points_in_target (n, 3) mm, pixels (n, 2); the target has `total` of them."""

    points_in_target: Array
    pixels: Array
    total: int


def detect_board(image: Grey, target: TargetSpec) -> BoardObservation:
    """Find the target in a grey 8-bit picture (h, w); TagNotSeen says why it cannot be used."""
    if image.ndim != 2 or image.dtype != np.uint8:
        raise InputError(f"a grey 8-bit picture is needed, got {image.dtype} {image.shape}")
    match target:
        case Charuco():
            observation = _detect_charuco(image, target)
        case Chessboard():
            observation = _detect_chessboard(image, target)
        case CircleGrid():
            observation = _detect_circles(image, target)
        case SingleTag():
            observation = _detect_tag(image, target)
    return observation


def _observation(points: Array, pixels: object, total: int) -> BoardObservation:
    flat = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    planar = np.zeros((len(flat), 3))
    planar[:, : points.shape[1]] = points
    return BoardObservation(planar, flat, total)


def _grid(columns: int, rows: int) -> Array:
    """Row-major (x, y) indices, shape (columns * rows, 2)."""
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.stack([x, y], axis=-1).astype(np.float64)


@cache
def _charuco_detector(target: Charuco, *, legacy: bool) -> cv2.aruco.CharucoDetector:
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        target.square_mm,
        target.marker_mm,
        dictionary_of(target.dictionary),
        np.array(target.marker_ids[: target.columns * target.rows // 2]),
    )
    board.setLegacyPattern(legacy)
    return cv2.aruco.CharucoDetector(board)


def _detect_charuco(image: Grey, target: Charuco) -> BoardObservation:
    total = (target.columns - 1) * (target.rows - 1)
    best: BoardObservation | None = None
    marker_count = 0
    for legacy in (False, True):
        detector = _charuco_detector(target, legacy=legacy)
        corners, ids, _, marker_ids = detector.detectBoard(image)
        marker_count = max(marker_count, 0 if marker_ids is None else len(marker_ids))
        if ids is not None and (best is None or len(ids) > len(best.pixels)):
            all_corners = np.asarray(detector.getBoard().getChessboardCorners(), dtype=np.float64)
            best = _observation(all_corners[np.ravel(ids)], corners, total)
        if best is not None and len(best.pixels) >= MIN_POINTS:
            return _spread(best)
    count = 0 if best is None else len(best.pixels)
    raise TagNotSeen(
        f"no usable charuco board: {count} of {total} corners ({marker_count} markers) found, "
        f"at least {MIN_POINTS} are needed"
    )


def _spread(observation: BoardObservation) -> BoardObservation:
    values = np.linalg.svd(
        observation.points_in_target - observation.points_in_target.mean(0), compute_uv=False
    )
    if values[1] < _MIN_SPREAD * values[0]:
        raise TagNotSeen(
            f"the {len(observation.pixels)} corners found lie on one line: they do not fix a pose"
        )
    return observation


def _detect_chessboard(image: Grey, target: Chessboard) -> BoardObservation:
    size = (target.columns, target.rows)
    ok, corners = cv2.findChessboardCornersSB(
        image, size, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not ok:
        raise TagNotSeen(
            f"no chessboard with {target.columns} x {target.rows} inner corners found; the whole "
            "board with a white rim must be in the picture"
        )
    points = _grid(*size) * target.square_mm
    pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    if has_direction(target) and not _first_square_is_dark(image, pixels, size):
        pixels = pixels[::-1]
    return _observation(points, pixels, len(points))


def _first_square_is_dark(image: Grey, pixels: Array, size: tuple[int, int]) -> bool:
    """Colour of the square at the first corners; a half turn of a board with a direction swaps it."""
    columns, rows = size
    grid = pixels.reshape(rows, columns, 2)
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.round(centres).astype(int).reshape(-1, 2).T
    grey = image[y.clip(0, image.shape[0] - 1), x.clip(0, image.shape[1] - 1)].astype(float)
    parity = (np.indices(centres.shape[:2]).sum(0) % 2).ravel()
    return bool(grey[parity == 0].mean() < grey[parity == 1].mean())


def _detect_circles(image: Grey, target: CircleGrid) -> BoardObservation:
    indices = _grid(target.columns, target.rows)
    layout = cv2.CALIB_CB_SYMMETRIC_GRID
    if target.asymmetric:
        layout = cv2.CALIB_CB_ASYMMETRIC_GRID
        indices[:, 0] = 2 * indices[:, 0] + indices[:, 1] % 2
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minArea = 20
    parameters.maxArea = image.size / len(indices)
    blobs = cv2.SimpleBlobDetector.create(parameters)
    for flags in (layout, layout | cv2.CALIB_CB_CLUSTERING):
        size = (target.columns, target.rows)
        ok, centres = cv2.findCirclesGrid(image, size, flags=flags, blobDetector=blobs)
        if ok:
            break
    else:
        kind = "asymmetric" if target.asymmetric else "symmetric"
        raise TagNotSeen(
            f"no {kind} grid of {target.columns} x {target.rows} dark circles found; the whole grid "
            "must be in the picture"
        )
    pixels = np.asarray(centres, dtype=np.float64).reshape(-1, 2)
    seen = np.array([blob.pt for blob in blobs.detect(image)]).reshape(-1, 2)
    _check_whole_grid(target, indices, pixels, seen)
    return _observation(indices * target.spacing_mm, pixels, len(indices))


def _check_whole_grid(target: CircleGrid, indices: Array, pixels: Array, seen: Array) -> None:
    """Raise TagNotSeen where circles of the grid were skipped, or a whole row or column goes on beyond it."""
    if min(target.columns, target.rows) < 2:
        return
    H, _ = cv2.findHomography(indices, pixels)
    last_x, last_y = indices.max(0)
    rows = {y: indices[indices[:, 1] == abs(y) % 2] for y in (-1, int(last_y) + 1)}
    beyond = {y: np.column_stack([row[:, 0], np.full(len(row), y)]) for y, row in rows.items()}
    sides = {"rows": list(beyond.values())}
    if not target.asymmetric:
        column = np.arange(target.rows)
        sides["columns"] = [
            np.column_stack([np.full(target.rows, x), column]) for x in (-1, last_x + 1)
        ]
    spacing = np.linalg.norm(pixels[1] - pixels[0]) / np.abs(indices[1] - indices[0]).sum()
    fitted = cv2.perspectiveTransform(indices[None].astype(np.float64), H)[0]
    if np.linalg.norm(fitted - pixels, axis=1).max() > _ON_GRID * spacing:
        raise TagNotSeen(
            f"the circles found lie on no grid of {target.columns} x {target.rows}: correct columns and rows"
        )
    for word, places in sides.items():
        for place in places:
            expected = cv2.perspectiveTransform(place[None].astype(np.float64), H)[0]
            misses = np.linalg.norm(expected[:, None] - seen, axis=2).min(axis=1)
            if misses.max() < _ON_GRID * spacing:
                raise TagNotSeen(
                    f"the grid of circles goes on beyond {target.columns} x {target.rows}: it has more "
                    f"{word}, and its origin is another; correct {word}"
                )


def _detect_tag(image: Grey, target: SingleTag) -> BoardObservation:
    corners = (
        _apriltag_corners(image, target)
        if target.dictionary in _APRILTAG_FAMILIES
        else _aruco_corners(image, target)
    )
    unit = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    return _observation(unit * target.size_mm / 2, corners, len(unit))


@cache
def _apriltag_detector(family: str) -> pyapriltags.Detector:
    return pyapriltags.Detector(families=_APRILTAG_FAMILIES[family])


def _apriltag_corners(image: Grey, target: SingleTag) -> Array:
    """Corners (4, 2), as OpenCV counts: pyapriltags starts at (-1, +1) and at a pixel's rim."""
    tags = _apriltag_detector(target.dictionary).detect(np.ascontiguousarray(image))
    good = [tag for tag in tags if tag.tag_id == target.id and tag.hamming == 0]
    _check_one(len(good), target, sorted({tag.tag_id for tag in tags}))
    return np.asarray(good[0].corners, dtype=np.float64)[[3, 2, 1, 0]] - 0.5


@cache
def _aruco_detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(dictionary_of(dictionary), parameters)


def _aruco_corners(image: Grey, target: SingleTag) -> Array:
    corners, ids, _ = _aruco_detector(target.dictionary).detectMarkers(image)
    markers = [] if ids is None else [int(marker) for marker in np.ravel(ids)]
    _check_one(markers.count(target.id), target, sorted(set(markers)))
    return np.asarray(corners[markers.index(target.id)], dtype=np.float64).reshape(4, 2)


def _check_one(count: int, target: SingleTag, ids: list[int]) -> None:
    if count == 0:
        hint = f"; other ids seen: {ids}" if ids else ""
        raise TagNotSeen(f"tag {target.id} of {target.dictionary} is not in the picture{hint}")
    if count > 1:
        raise TagNotSeen(f"tag {target.id} of {target.dictionary} is in the picture {count} times")
