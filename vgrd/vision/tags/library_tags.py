"""Tags whose black square is not their outer edge, such as standard41h12: at the corners that pyapriltags finds.

Their corners are good to some tenths of a pixel; the fits to all pixels know square families only.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pyapriltags

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.print.codes import LIBRARY_FAMILIES
from vgrd.vision.tags.detection import FoundTag

CELLS_ACROSS = {  # width_at_border of the library's families
    "circle21h7": 5,
    "circle49h12": 5,
    "standard41h12": 5,
    "standard52h13": 6,
}
_LEAST_PICTURE_PX = 8  # on less than 3 px pyapriltags crashes
_DARK, _BRIGHT = 10, 90  # per cent of the tag's pixels: ink and paper, whatever its code


def find_library_tags(grey: Grey, families: Sequence[str]) -> list[FoundTag]:
    """All tags of families out of LIBRARY_FAMILIES in a grey 8-bit picture (h, w), by family and id."""
    if min(grey.shape) < _LEAST_PICTURE_PX:
        return []
    picture = np.ascontiguousarray(grey)
    tags = []
    for family in sorted(families):
        for tag in _detector(family).detect(picture):
            if tag.hamming == 0:
                # The library starts at (-,+) and counts pixels from their rim.
                corners = np.asarray(tag.corners, dtype=np.float64)[[3, 2, 1, 0]] - 0.5
                tags.append(FoundTag(family, tag.tag_id, corners, 0, _contrast(grey, corners)))
    return sorted(tags, key=lambda tag: (tag.family, tag.id))


@cache
def _detector(family: str) -> pyapriltags.Detector:
    return pyapriltags.Detector(families=LIBRARY_FAMILIES[family], quad_decimate=1.0)


def _contrast(grey: Grey, corners_px: Array) -> float:
    low = np.maximum(np.floor(corners_px.min(0)).astype(int), 0)
    high = np.ceil(corners_px.max(0)).astype(int) + 1
    dark, bright = np.percentile(grey[low[1] : high[1], low[0] : high[0]], (_DARK, _BRIGHT))
    return float(bright - dark)
