"""Find square tags in any grey picture, without a camera model: which, where, how sure.

Corners are good to a fraction of a pixel; `vgrd.vision.alignment.photometric` makes them exact.
"""

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import pyapriltags
from numpy.typing import NDArray

from vgrd.devices import Grey
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.vision.print.codes import (
    APRILTAG_FAMILIES,
    BORDER_CELLS,
    border_cells,
    dictionary_of,
    family_named,
    marker_cells,
)

_COARSE_WIDTH_PX = 1300  # wider pictures are halved until they are not wider: 12 megapixels twice
_FINEST_WIDTH_PX = 2600  # of the pictures that a fast search looks at: one level finer than coarse
_LEAST_REGION_PX = 16  # twice _LEAST_PICTURE_PX
_REGION_RIM_PX = 8  # around a region, beyond its margin: the white rim of a small tag
_CELL_PX = 6  # of the straightened tag that is read; its outer pixels are left out
_MIXED_CELL_PX = 3.0  # at 4 sigma of the blur, a cell has 94 % of its own level
_BLUR_PX = 0.75  # sigma of a good lens and the pixel's square, as `read_cells` reads them
_LEAST_OWN = 0.25  # share of a cell in its level: below 1.3 px the code cannot be told
_LEAST_CONTRAST = 12.0  # grey levels between ink and paper: 6 sigma of white's noise at 40 dB
_MOST_RING_WHITE = 0.1  # share of the black ring that may be too bright: 2 of 28 cells of a 36h11
_MOST_RIM_BLACK = 0.35  # share of the white rim that may be too dark: one side of four, and more
_WIDER_SCALES = (1.25, 1.17, 1.09)  # 10 cells by 8, down to a quadrangle near the outer edge
_SMALL_PX = (
    24.0  # a side below it is seen better at twice its size: corners else are off by up to 2 px
)
_LEAST_SIDE_PX = 6.0  # of the smallest code, 4 x 4, a cell has 1 px
_LEAST_PICTURE_PX = 8  # that and its rim; on less than 3 px pyapriltags crashes
_FAST_WINDOW_PX = 13  # of the adaptive threshold: the middle of OpenCV's three, 3, 13 and 23
_WIDEST_WINDOW_PX = 53  # thorough: larger than the 23 of OpenCV, for large cells
_LEAST_PERIMETER = 0.01  # thorough, of the picture's longer side: a third of OpenCV's 0.03
_PUBLISHED_BY_LIBRARY = ("16h5", "25h9", "36h11")


@dataclass(frozen=True, slots=True, eq=False)
class FoundTag:
    """A tag in a picture.

    corners_px: (4, 2) in the order (-,-), (+,-), (+,+), (-,+) of the tag's x right, y down, OpenCV pixel
    convention (centre of the first pixel is 0, 0). hamming: cells of the code that read wrongly;
    contrast: grey levels between its white and black cells.
    """

    family: str
    id: int
    corners_px: Array
    hamming: int
    contrast: float

    @property
    def mirrored(self) -> bool:
        """Whether the corners turn the other way: printed as in a mirror, or a flipped picture."""
        (ax, ay), (bx, by) = (
            self.corners_px[2] - self.corners_px[0],
            self.corners_px[3] - self.corners_px[1],
        )
        return bool(ax * by - ay * bx < 0)

    @property
    def side_px(self) -> float:
        """Root of the area, px."""
        return float(np.sqrt(abs(cv2.contourArea(self.corners_px.astype(np.float32)))))


def find_tags(
    grey: Grey, families: Sequence[str], *, max_hamming: int = 0, thorough: bool = True
) -> list[FoundTag]:
    """All tags of the families in a grey picture (h, w), sorted by family and id.

    A tag that appears twice is listed twice. families: names as `family_named` takes them. thorough:
    search at all resolutions, small pictures at twice theirs too, with two detectors; otherwise only at
    the coarsest, at most 1300 px wide.
    Raises InputError for an unknown family or another kind of picture.
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise InputError(f"a grey 8-bit picture is needed, got {grey.dtype} {grey.shape}")
    names = [family_named(name) for name in families]
    grey = np.ascontiguousarray(grey)
    levels = _pyramid(grey)
    # What is seen without interpolation is exacter, and the later of equals is kept.
    searched = [*_doubled(grey), *reversed(levels)] if thorough else levels[-1:]
    tags: list[FoundTag] = []
    small: list[FoundTag] = []
    for scale, level in searched:
        for name in names:
            for tag_id, corners in _candidates(level, name, thorough=thorough):
                full = scale * (corners + 0.5) - 0.5
                tag = read_tag(grey, name, tag_id, full)
                if tag is not None and tag.hamming <= max_hamming:
                    _keep(tags, tag)
                    small += [tag] if scale < 1 and tag.side_px < _SMALL_PX else []
    for tag in small:
        _keep(tags, tag)
    if thorough:
        _keep_mirrored(tags, grey, names, levels[-1])
    tags = [tag for tag in tags if not _is_inside_wider(tag, grey)]
    return sorted(tags, key=lambda tag: (tag.family, tag.id, tag.corners_px[0].tolist()))


def _is_inside_wider(tag: FoundTag, grey: Grey) -> bool:
    """Whether a tag is the inner part of one of the same code whose border is wider.

    Both edges of the wide border pull at a quadrangle; between them it reads as a tag, at a wrong place.
    """
    wider = f"{tag.family}_border2"
    if wider not in BORDER_CELLS:
        return False
    middle = tag.corners_px.mean(0)
    likeness = _likeness(grey, tag)
    for scale in _WIDER_SCALES:
        corners = middle + scale * (tag.corners_px - middle)
        other = read_tag(grey, wider, tag.id, corners)
        if other is not None and other.hamming == 0 and _likeness(grey, other) > likeness:
            return True
    return False


def _likeness(grey: Grey, tag: FoundTag) -> float:
    """Correlation of a tag's cells and their white rim with what is drawn."""
    code = np.pad(marker_cells(tag.family, tag.id), 1, constant_values=1.0)
    cells = read_cells(grey, tag.corners_px, len(code) - 2)
    return float(np.corrcoef(code.ravel(), cells.ravel())[0, 1])


def _keep_mirrored(
    tags: list[FoundTag], grey: Grey, names: Sequence[str], coarsest: tuple[float, Grey]
) -> None:
    """Add tags that can only be read in a mirror."""
    scale, level = coarsest
    flipped = np.ascontiguousarray(level[:, ::-1])
    for name in names:
        for tag_id, corners in _candidates(flipped, name, thorough=False):
            back = np.column_stack([level.shape[1] - 1 - corners[:, 0], corners[:, 1]])
            tag = read_tag(grey, name, tag_id, scale * (back + 0.5) - 0.5)
            if tag is None or tag.hamming or _covers_another(tags, tag):
                continue
            _keep(tags, tag)


def _covers_another(tags: Sequence[FoundTag], tag: FoundTag) -> bool:
    """Whether a tag lies where one was found without a mirror."""
    middle = tag.corners_px.mean(0)
    return any(
        np.linalg.norm(other.corners_px.mean(0) - middle) < other.side_px / 2 for other in tags
    )


def search_tags(grey: Grey, ids: Set[tuple[str, int]]) -> list[FoundTag]:
    """Look for the wanted tags (family, id) fast: in a small picture, then in finer ones until all are found.

    Lists damaged tags too, and a tag that appears twice twice.
    """
    tags: list[FoundTag] = []
    for scale, level in reversed(_pyramid(grey)):
        if level.shape[1] > _FINEST_WIDTH_PX:
            break
        for family in sorted({family for family, _ in ids}):
            for tag_id, corners in _candidates(level, family, thorough=False):
                if (family, tag_id) not in ids:
                    continue
                tag = read_tag(grey, family, tag_id, scale * (corners + 0.5) - 0.5)
                if tag is not None:
                    _keep(tags, tag)
        if ids <= {(tag.family, tag.id) for tag in tags}:
            break
    return tags


def tags_within(
    grey: Grey, ids: Set[tuple[str, int]], corners_px: Array, margin: float
) -> list[FoundTag]:
    """Look for tags around a place (4, 2) px: within `margin` of its extent, at full resolution."""
    low, high = corners_px.min(0), corners_px.max(0)
    reach = margin * float((high - low).max()) + _REGION_RIM_PX
    x0, y0 = np.maximum(np.floor(low - reach), 0).astype(int).tolist()
    x1, y1 = np.minimum(np.ceil(high + reach), grey.shape[::-1]).astype(int).tolist()
    if x1 - x0 < _LEAST_REGION_PX or y1 - y0 < _LEAST_REGION_PX:
        return []
    origin = np.array([x0, y0], dtype=np.float64)
    tags = search_tags(np.ascontiguousarray(grey[y0:y1, x0:x1]), ids)
    return [replace(tag, corners_px=tag.corners_px + origin) for tag in tags]


def read_tag(grey: Grey, family: str, tag_id: int, corners_px: Array) -> FoundTag | None:
    """Read a tag whose corners (4, 2) are known; None where no black square on white is.

    Where cells are so small that the blur of a good lens mixes them, they are compared with a print that is
    blurred as much.
    """
    code = np.pad(marker_cells(family, tag_id), 1, constant_values=1.0)
    cells = read_cells(grey, corners_px, len(code) - 2)
    cell_px = float(np.sqrt(abs(cv2.contourArea(corners_px.astype(np.float32)))))
    cell_px /= len(code) - 2
    ring, rim = _frame_of(code.shape, 1), _frame_of(code.shape, 0)
    if cell_px < _MIXED_CELL_PX:
        expected, own = _mixed(code, cell_px)
        if own < _LEAST_OWN:
            return None
        contrast, black = np.polyfit(expected.ravel(), cells.ravel(), 1).tolist()
    else:
        expected, own = code, 1.0
        black = float(np.median(cells[ring]))
        bright = cells[(code > 0.5) & ~rim]
        white = float(np.median(bright)) if bright.size else float(np.median(cells[rim]))
        contrast = white - black
    if contrast < _LEAST_CONTRAST:
        return None
    off = np.where(code > 0.5, -1, 1) * (cells - black - contrast * expected)
    wrong = off > contrast * own / 2
    if np.mean(wrong[ring]) > _MOST_RING_WHITE or np.mean(wrong[rim]) > _MOST_RIM_BLACK:
        return None
    corners = np.asarray(corners_px, dtype=np.float64)
    return FoundTag(family, tag_id, corners, int(np.sum(wrong[~rim])), contrast)


def _frame_of(shape: tuple[int, ...], depth: int) -> NDArray[np.bool_]:
    """Mask of the cells that are `depth` cells away from the rim."""
    rows, columns = np.indices(shape)
    away = np.minimum.reduce([rows, columns, shape[0] - 1 - rows, shape[1] - 1 - columns])
    return np.asarray(away == depth)


def _mixed(code: Array, cell_px: float) -> tuple[Array, float]:
    """Levels, 0 to 1, that `read_cells` reads of a blurred code, and the share that a cell has in its own."""
    sigma = _BLUR_PX / cell_px * _CELL_PX
    lone = np.zeros((5, 5))
    lone[2, 2] = 1
    levels = []
    for drawing in (np.pad(code, 1, mode="edge"), lone):
        fine = np.kron(drawing, np.ones((_CELL_PX, _CELL_PX)))
        blurred = cv2.GaussianBlur(fine, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        levels.append(_means(np.asarray(blurred, np.float64))[1:-1, 1:-1])
    return levels[0], float(levels[1][1, 1])


def read_cells(grey: Grey, corners_px: Array, cells: int) -> Array:
    """Mean grey levels (cells + 2, cells + 2) of a square's cells and of one ring around it."""
    side = (cells + 2) * _CELL_PX
    low, high = _CELL_PX - 0.5, side - _CELL_PX - 0.5
    straight = np.array([[low, low], [high, low], [high, high], [low, high]], np.float32)
    flat_from_picture = cv2.getPerspectiveTransform(corners_px.astype(np.float32), straight)
    flat = cv2.warpPerspective(
        grey,
        flat_from_picture,
        (side, side),
        flags=cv2.INTER_AREA,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return _means(np.asarray(flat, np.float64))


def _means(flat: Array) -> Array:
    """Mean levels of the middles of cells that have _CELL_PX on a side."""
    rows, columns = flat.shape[0] // _CELL_PX, flat.shape[1] // _CELL_PX
    blocks = flat.reshape(rows, _CELL_PX, columns, _CELL_PX)
    return np.asarray(blocks[:, 1:-1, :, 1:-1].mean((1, 3)))


def _doubled(grey: Grey) -> list[tuple[float, Grey]]:
    """A small picture at twice its size: detectors want 3 px of a cell, and miss tags of 12 to 20 px."""
    if grey.shape[1] > _COARSE_WIDTH_PX:
        return []
    size = (2 * grey.shape[1], 2 * grey.shape[0])
    return [(0.5, np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC), np.uint8))]


def _pyramid(grey: Grey) -> list[tuple[float, Grey]]:
    """The picture and its halvings down to the coarse width, with their scales, finest first."""
    levels: list[tuple[float, Grey]] = [(1.0, grey)]
    scale = 1.0
    while grey.shape[1] > _COARSE_WIDTH_PX and grey.shape[0] >= 2 * _LEAST_PICTURE_PX:
        half = (grey.shape[1] // 2, grey.shape[0] // 2)
        even = grey[: 2 * half[1], : 2 * half[0]]
        grey = np.asarray(cv2.resize(even, half, interpolation=cv2.INTER_AREA), np.uint8)
        scale *= 2
        levels.append((scale, grey))
    return levels


def _candidates(level: Grey, family: str, *, thorough: bool) -> Iterable[tuple[int, Array]]:
    corners, ids, _ = _aruco(family, thorough).detectMarkers(level)
    for marker, quad in zip([] if ids is None else np.ravel(ids), corners, strict=True):
        square = np.asarray(quad, dtype=np.float64).reshape(4, 2)
        yield int(marker), square[[2, 3, 0, 1]] if family in APRILTAG_FAMILIES else square
    if thorough and family in _PUBLISHED_BY_LIBRARY and min(level.shape) >= _LEAST_PICTURE_PX:
        for tag in _apriltag(family).detect(level):
            # The library starts at (-,+) and counts pixels from their rim.
            yield tag.tag_id, np.asarray(tag.corners, dtype=np.float64)[[3, 2, 1, 0]] - 0.5


@cache
def _aruco(family: str, thorough: bool) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.markerBorderBits = border_cells(family)
    if thorough:
        parameters.adaptiveThreshWinSizeMax = _WIDEST_WINDOW_PX
        parameters.minMarkerPerimeterRate = _LEAST_PERIMETER
    else:
        parameters.adaptiveThreshWinSizeMin = _FAST_WINDOW_PX
        parameters.adaptiveThreshWinSizeMax = _FAST_WINDOW_PX
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(dictionary_of(family), parameters)


@cache
def _apriltag(family: str) -> pyapriltags.Detector:
    return pyapriltags.Detector(families=f"tag{family}", quad_decimate=1.0)


def _keep(tags: list[FoundTag], tag: FoundTag) -> None:
    """Add a tag; of two sightings of the same one keep the better read, and of equals the later."""
    if tag.side_px < _LEAST_SIDE_PX:
        return
    for i, other in enumerate(tags):
        distance = np.linalg.norm(tag.corners_px.mean(0) - other.corners_px.mean(0))
        if (tag.family, tag.id) == (other.family, other.id) and distance < other.side_px / 2:
            if tag.hamming <= other.hamming:
                tags[i] = tag
            return
    tags.append(tag)
