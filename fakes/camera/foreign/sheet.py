"""A tag as it comes out of a printer: a fine bitmap of how much light every point throws back."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array

_RIM_CELLS = 2  # of white paper around the code
_SMEAR_PX = (
    7  # of the bitmap, over which an edge is smeared before it is cut anew: room for 3.5 px
)
Plane = NDArray[np.float32]
_INK, _PAPER = 0.06, 0.85  # reflectances: laser toner, office paper


@dataclass(frozen=True, slots=True)
class Printer:
    """What a printer does to a drawing. Lengths in mm of the paper.

    ink_mm: how far black spreads over the edges that run along y (x) and along x (y); below 0 it
    recedes. ragged_mm: standard deviation of that, from place to place, with the correlation length
    `ragged_length_mm`. stretch: by how much the print is too large in x and y (0.001: 0.1 %).
    grain: standard deviation of the paper's and the ink's reflectance, as a share of it, with the
    correlation length `grain_mm`. screen: share of white pinholes in the black, one every `screen_mm`.
    dot_mm: lines lie on whole dots of this size.
    """

    ink_mm: tuple[float, float] = (0.0, 0.0)
    ragged_mm: float = 0.0
    ragged_length_mm: float = 0.1
    stretch: tuple[float, float] = (0.0, 0.0)
    grain: float = 0.0
    grain_mm: float = 0.08
    screen: float = 0.0
    screen_mm: float = 0.17
    dot_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A printed tag. reflectance (h, w) float32; sheet_from_tag (3, 3): mm of the tag to its pixels."""

    reflectance: Plane
    sheet_from_tag: Array


def printed(
    dictionary: int,
    tag_id: int,
    size_mm: float,
    printer: Printer,
    rng: np.random.Generator,
    cell_px: int = 48,
) -> Sheet:
    """Print a tag of one of OpenCV's dictionaries, upright as OpenCV draws it.

    size_mm: of the black square, as it was meant; cell_px: pixels of the bitmap in one of its cells.
    """
    book = cv2.aruco.getPredefinedDictionary(dictionary)
    cells = book.markerSize + 2
    code = book.generateImageMarker(tag_id, cells, borderBits=1).astype(np.float32) / 255
    code = np.pad(code, _RIM_CELLS, constant_values=1.0)
    pixel_mm = size_mm / cells / cell_px
    white = _drawn(np.asarray(code, np.float32), cell_px, printer.dot_mm / pixel_mm)
    ragged = np.zeros(white.shape, np.float32)
    if printer.ragged_mm:
        ragged = printer.ragged_mm * _blotches(
            white.shape, printer.ragged_length_mm / pixel_mm, rng
        )
    spread = [
        _spread(white, axis, (ink + ragged) / pixel_mm) for axis, ink in enumerate(printer.ink_mm)
    ]
    white = np.asarray(
        np.clip(sum(spread) - white, 0, 1), np.float32
    )  # near an edge, one of them has moved it
    light = np.full(white.shape, _INK, np.float32)
    if printer.screen:
        light += (_PAPER - _INK) * _pinholes(
            white.shape, printer.screen, printer.screen_mm / pixel_mm, rng
        )
    light += (_PAPER - light) * white
    if printer.grain:
        light *= 1 + printer.grain * _blotches(white.shape, printer.grain_mm / pixel_mm, rng)
    middle = white.shape[0] / 2 - 0.5
    scale_x, scale_y = (1 / (pixel_mm * (1 + stretch)) for stretch in printer.stretch)
    return Sheet(light, np.array([[scale_x, 0, middle], [0, scale_y, middle], [0, 0, 1.0]]))


def _drawn(code: Plane, cell_px: int, dot_px: float) -> Plane:
    """The drawing, its lines on whole dots but for the outer ones of the square, which are measured."""
    n = len(code)
    lines = np.arange(n + 1) * cell_px
    if dot_px:
        inner = slice(_RIM_CELLS + 1, n - _RIM_CELLS)
        lines[inner] = np.rint(np.rint(lines[inner] / dot_px) * dot_px).astype(int)
    widths = np.diff(lines)
    return np.asarray(np.repeat(np.repeat(code, widths, 0), widths, 1), np.float32)


def _spread(white: Plane, axis: int, spread_px: Plane) -> Plane:
    """Move all edges across an axis (0: x) into the white, by so many pixels of the bitmap.

    A smeared edge rises by one part in _SMEAR_PX for each pixel; cut again at another level, it
    lies elsewhere, and one pixel wide.
    """
    kernel = (_SMEAR_PX, 1) if axis == 0 else (1, _SMEAR_PX)
    smeared = cv2.blur(white, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(np.clip(0.5 + (smeared - 0.5) * _SMEAR_PX - spread_px, 0, 1), np.float32)


def _blotches(shape: tuple[int, ...], length_px: float, rng: np.random.Generator) -> Plane:
    """A random field with mean 0, standard deviation 1, and about this correlation length."""
    step = max(length_px, 1.0)
    coarse = [int(np.ceil(side / step)) + 3 for side in shape]
    knots = rng.normal(size=coarse).astype(np.float32)
    start = rng.uniform(0, 1, 2)
    matrix = np.array([[1 / step, 0, 1 + start[0]], [0, 1 / step, 1 + start[1]]])
    field = cv2.warpAffine(
        knots, matrix, shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    )
    return np.asarray((field - field.mean()) / field.std(), np.float32)


def _pinholes(
    shape: tuple[int, ...], share: float, period_px: float, rng: np.random.Generator
) -> Plane:
    """White (0 to 1) of a screen of round holes in rows at 45 degrees, which starts anywhere."""
    y, x = np.mgrid[: shape[0], : shape[1]] + rng.uniform(0, 2 * period_px, (2, 1, 1))
    turn = np.float32(np.sqrt(2) * np.pi / period_px)
    wave = np.cos(turn * (x + y)) + np.cos(turn * (x - y))
    level = np.quantile(wave[:64, :64] if period_px < 32 else wave, 1 - share)
    return np.asarray(np.clip((wave - level) * period_px / 4 + 0.5, 0, 1), np.float32)
