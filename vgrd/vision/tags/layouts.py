"""Whether the tags seen lie as their board's layout says, and on which other layout they lie.

A tag and its nearest ones in the layout show a plane: a homography fits them all, or the layout is wrong. Only
nearest ones are compared, so that neither a wide lens nor bent paper looks like another layout.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vgrd.geometry import Array
from vgrd.vision.print.codes import code_count
from vgrd.vision.print.targets import AprilGrid, TagGrid

_NEAREST = 5  # a tag and its four neighbours: fewer have few points to contradict each other
_MOST = 1 / 3  # of a tag's edge, rms: a pixel's noise, a lens and bent paper stay far below, a
# tag that lies elsewhere misses by a pitch, a turned one by its diagonal
_FOREIGN = 0.1  # share of the tags that may lie elsewhere: those of another board in the picture
_FEWEST = 3  # tags that tell another layout: two lie on many
_TURNED = (
    "every tag is turned by half, as OpenCV's generateImageMarker draws AprilTags: turn each tag on the "
    "sheet by 180 degrees, or print the board with vgrd target grid"
)


@dataclass(frozen=True, slots=True)
class _Other:
    """A layout to try, and the words that tell it."""

    board: TagGrid
    turned: bool
    told: str


def on_layout(board: TagGrid, corners_px: Mapping[int, Array]) -> list[int] | None:
    """Ids of the tags that lie as the board's layout says; None where the layout does not fit.

    corners_px: corners (4, 2) by id. One tag in ten may lie elsewhere and is left out.
    """
    return _fitting(board.corners(), corners_px)


def layout_cause(board: TagGrid, corners_px: Mapping[int, Array]) -> str | None:
    """The layout that fits the tags better, with the remedy; None where none does."""
    if len(corners_px) < _FEWEST:
        return None
    for other in _others(board, corners_px):
        places = other.board.corners()
        if not corners_px.keys() <= places.keys():
            continue
        if other.turned:
            places = {tag_id: np.roll(square, 2, axis=0) for tag_id, square in places.items()}
        if _fitting(places, corners_px) is not None:
            return other.told
    return None


def _fitting(places: Mapping[int, Array], corners_px: Mapping[int, Array]) -> list[int] | None:
    ids = sorted(corners_px)
    spare = int(len(ids) * _FOREIGN)
    misfits = _misfits(ids, places, corners_px)
    if np.median(misfits) > _MOST:  # a few tags of another board spoil fewer
        return None
    while misfits.max() > _MOST:
        if not spare:
            return None
        spare -= 1
        without = [[one for one in ids if one != gone] for gone in ids]
        tries = [_misfits(left, places, corners_px) for left in without]
        best = int(np.argmin([float((misfit > _MOST).sum()) for misfit in tries]))
        ids, misfits = without[best], tries[best]
    return ids


def _misfits(
    ids: list[int], places: Mapping[int, Array], corners_px: Mapping[int, Array]
) -> Array:
    """Of each tag: rms misfit of the homography through it and its nearest ones, in edges of a tag."""
    points = np.array([places[tag_id][:, :2] for tag_id in ids])
    pixels = np.array([corners_px[tag_id] for tag_id in ids])
    centres = points.mean(1)
    misfits = []
    for centre in centres:
        near = np.argsort(np.linalg.norm(centres - centre, axis=1), kind="stable")[:_NEAREST]
        source, seen = points[near].reshape(-1, 2), pixels[near].reshape(-1, 2)
        H, _ = cv2.findHomography(source, seen)
        if np.shape(H) != (3, 3):  # None where the points are no quadrangle
            misfits.append(np.inf)
            continue
        fitted = cv2.perspectiveTransform(source[None], H)[0]
        edges = np.linalg.norm(pixels[near] - np.roll(pixels[near], 1, axis=1), axis=2)
        rms = np.sqrt(((fitted - seen) ** 2).sum(1).mean())
        misfits.append(float(rms / edges.mean()))
    return np.array(misfits)


def _others(board: TagGrid, corners_px: Mapping[int, Array]) -> Iterator[_Other]:
    """Other layouts, the likeliest first."""
    yield _Other(board, True, _TURNED)
    for turned in (False, True):
        told = f"; {_TURNED}" if turned else ""
        size = f"columns = {board.rows}, rows = {board.columns}"
        for swapped in _sized(board, board.rows, board.columns, board.first_id):
            yield _Other(swapped, turned, f"columns and rows look swapped: write {size}{told}")
        yield _Other(*_of_other_kind(board, turned=turned, told=told))
    for turned in (False, True):
        yield from _by_columns(board, max(corners_px), turned=turned)


def _of_other_kind(board: TagGrid, *, turned: bool, told: str) -> tuple[TagGrid, bool, str]:
    is_kalibrs = isinstance(board, AprilGrid)
    kind, name, side = (
        (TagGrid, "tags", "top") if is_kalibrs else (AprilGrid, "aprilgrid", "bottom")
    )
    other = kind(
        board.dictionary, board.columns, board.rows, board.size_mm, board.gap_mm, board.first_id
    )
    return other, turned, f'its ids count from the {side} left: write type = "{name}"{told}'


def _by_columns(board: TagGrid, last: int, *, turned: bool) -> Iterator[_Other]:
    """Every number of columns, and every place of the first id in its row."""
    told = f"; {_TURNED}" if turned else ""
    for columns in sorted(range(1, last + 2), key=lambda n: (n != board.columns, n)):
        for first in range(min(columns, last + 1)):
            start = board.first_id if first == board.first_id % columns else first
            rows = max(1, -(-(last + 1 - start) // columns))
            words = f"as those of a board with columns = {columns}, first_id = {start}"
            for other in _sized(board, columns, rows, start):
                yield _Other(other, turned, f"they lie {words}, rows = {rows} or more{told}")


def _sized(board: TagGrid, columns: int, rows: int, first_id: int) -> Iterator[TagGrid]:
    """The board with other columns and rows, where its family has the ids."""
    if first_id + columns * rows <= code_count(board.dictionary):
        yield replace(board, columns=columns, rows=rows, first_id=first_id)
