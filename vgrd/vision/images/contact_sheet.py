"""Many small pictures with captions as one."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap

import cv2
import numpy as np

from vgrd.vision.images.drawing import Colour

_TILE_PX = 700  # a hole drawn by `draw_hole` fills it
_SCALE = 0.65  # of OpenCV's letters, which are 22 px high at 1
_LINE_PX = 26  # a line of such letters
_LETTER_PX = 12  # the mean width of one
_GAP_PX = 8  # of white between two tiles; a guess: tells them apart and takes a hundredth


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """A picture (h, w, 3) and what is written below it."""

    picture: Colour
    caption: str


def contact_sheet(tiles: Sequence[Tile]) -> Colour:
    """All tiles, at least one, side by side on white, row by row, large ones made smaller."""
    columns = int(np.ceil(np.sqrt(len(tiles))))
    captions = [wrap(tile.caption, _TILE_PX // _LETTER_PX) for tile in tiles]
    height = _TILE_PX + _LINE_PX * max(len(lines) for lines in captions) + _GAP_PX
    cells = [_cell(tile, lines, height) for tile, lines in zip(tiles, captions, strict=True)]
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % columns)
    rows = [np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)]
    return np.vstack(rows)


def _cell(tile: Tile, lines: Sequence[str], height: int) -> Colour:
    """The picture, made smaller where it must be, above its caption."""
    cell = np.full((height, _TILE_PX + _GAP_PX, 3), 255, np.uint8)
    h, w = tile.picture.shape[:2]
    scale = min(1.0, _TILE_PX / max(h, w))
    size = (max(round(w * scale), 1), max(round(h * scale), 1))
    cell[: size[1], : size[0]] = cv2.resize(tile.picture, size, interpolation=cv2.INTER_AREA)
    for k, line in enumerate(lines, 1):
        place = (2, size[1] + k * _LINE_PX - 6)
        cv2.putText(cell, line, place, cv2.FONT_HERSHEY_SIMPLEX, _SCALE, (0, 0, 0), 1, cv2.LINE_AA)
    return cell
