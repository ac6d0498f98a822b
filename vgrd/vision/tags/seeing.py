"""Targets of datasets and of intrinsics in a picture: boards of tags too, and the cause where none is found."""

from collections import Counter

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


def see_target(grey: Grey, target: TargetSpec | TagGrid) -> BoardObservation:
    """Find the target in a grey 8-bit picture (h, w); TagNotSeen says why it cannot be used."""
    try:
        if isinstance(target, TagGrid):
            return _see_tags(grey, target)
        return detect_board(grey, target)
    except TagNotSeen as error:
        cause = cause_for_target(grey, target)
        if cause is None:
            raise
        raise TagNotSeen(f"{error}; {cause}") from error


def _see_tags(grey: Grey, board: TagGrid) -> BoardObservation:
    places = board.corners()
    tags = [tag for tag in find_tags(grey, [board.dictionary]) if tag.id in places]
    counts = Counter(tag.id for tag in tags)
    points, pixels = [], []
    for tag in tags:
        corners = _exact_corners(grey, tag, board) if counts[tag.id] == 1 else None
        if corners is not None and not tag.mirrored:
            points.append(places[tag.id])
            pixels.append(corners)
    if not points:
        raise TagNotSeen(f"none of the board's {len(places)} tags can be measured in the picture")
    total = 4 * len(places)  # corners
    return BoardObservation(np.concatenate(points), np.concatenate(pixels), total)


def _exact_corners(grey: Grey, tag: FoundTag, board: TagGrid) -> Array | None:
    """Corners (4, 2) as all pixels of the tag tell them; a tag is small enough to see no distortion."""
    raster = tag_raster(tag.family, tag.id, board.size_mm)
    refined = refine(grey, raster, tag.corners_px, lens_vector(None))
    return None if refined is None else refined.corners_px
