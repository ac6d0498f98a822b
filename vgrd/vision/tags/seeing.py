"""Targets of datasets and of intrinsics in a picture: boards of tags too, and the cause where none is found."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from vgrd.devices import Grey
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array
from vgrd.vision.alignment.refinement import refine
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.boards import BoardObservation, TargetSpec, detect_board
from vgrd.vision.print.raster import tag_raster
from vgrd.vision.print.targets import TagGrid
from vgrd.vision.tags.causes import cause_for_target
from vgrd.vision.tags.detection import FoundTag, find_tags
from vgrd.vision.tags.layouts import layout_cause, on_layout


def see_target(grey: Grey, target: TargetSpec | TagGrid) -> BoardObservation:
    """Find the target in a grey 8-bit picture (h, w); TagNotSeen says why it cannot be used."""
    try:
        if not isinstance(target, TagGrid):
            return detect_board(grey, target)
        tags = _see_tags(grey, target)
    except TagNotSeen as error:
        cause = cause_for_target(grey, target)
        if cause is None:
            raise
        raise TagNotSeen(f"{error}; {cause}") from error
    return _placed(target, tags)


def _see_tags(grey: Grey, board: TagGrid) -> dict[int, Array]:
    """Corners (4, 2) of the board's tags by id."""
    ids = board.corners().keys()
    tags = [tag for tag in find_tags(grey, [board.dictionary]) if tag.id in ids]
    counts = Counter(tag.id for tag in tags)
    found = {}
    for tag in tags:
        corners = _exact_corners(grey, tag, board) if counts[tag.id] == 1 else None
        if corners is not None and not tag.mirrored:
            found[tag.id] = corners
    if not found:
        raise TagNotSeen(f"none of the board's {len(ids)} tags can be measured in the picture")
    return found


def _placed(board: TagGrid, tags: Mapping[int, Array]) -> BoardObservation:
    """The points of the tags that lie as the layout says; TagNotSeen where the layout is another."""
    ids = on_layout(board, tags)
    if ids is None:
        cause = (
            layout_cause(board, tags) or "correct columns, rows, first_id and type of the target"
        )
        raise TagNotSeen(
            f"the {len(tags)} tags seen lie on no board of {board.columns} x {board.rows} tags from id "
            f"{board.first_id} on: {cause}"
        )
    places = board.corners()
    total = 4 * len(places)  # corners
    points = np.concatenate([places[tag_id] for tag_id in ids])
    return BoardObservation(points, np.concatenate([tags[tag_id] for tag_id in ids]), total)


def _exact_corners(grey: Grey, tag: FoundTag, board: TagGrid) -> Array | None:
    """Corners (4, 2) as all pixels of the tag tell them; a tag is small enough to see no distortion."""
    raster = tag_raster(tag.family, tag.id, board.size_mm)
    refined = refine(grey, raster, tag.corners_px, lens_vector(None))
    return None if refined is None else refined.corners_px
