"""Pictures from files: grey, as the sensor saw them."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vgrd.devices import Grey, Pixels, full_scale, guessed_bits
from vgrd.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")
_AS_STORED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_ORIENTATION_TAG = 0x0112  # TIFF 6.0, Orientation
_PNG = b"\x89PNG\r\n\x1a\n"  # signature, PNG specification
_UPRIGHT = 1  # idem: row 0 at the top, column 0 at the left


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """pixels: (h, w) uint8, or uint16 at full scale, rows as stored; is_turned: its EXIF asks viewers to turn it."""

    pixels: Pixels
    is_turned: bool


def read_picture(path: Path) -> Picture:
    """Read a picture, colours as their grey value; InputError naming the file and why it cannot be read.

    An EXIF orientation is not applied: intrinsics belong to the sensor's rows and columns. Files
    do not tell the depth of a camera of more than 8 bits: it is guessed from the brightest pixel.
    """
    check_whole(path)
    pixels, kinds, blocks = _decoded(path)
    if pixels is None or pixels.size == 0:
        raise InputError(f"{path}: cannot be read as a picture; save it anew as PNG")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path}: pixels are {pixels.dtype}, 8 or 16 bit whole numbers are needed"
        )
    exif = [
        np.asarray(block, np.uint8).tobytes()
        for kind, block in zip(np.ravel(kinds), blocks, strict=True)
        if kind == cv2.IMAGE_METADATA_EXIF
    ]
    if pixels.dtype == np.uint16:
        deep = np.asarray(pixels, dtype=np.uint16)
        pixels = full_scale(deep, guessed_bits(deep))
    return Picture(pixels, any(_orientation(block) != _UPRIGHT for block in exif))


def check_whole(path: Path) -> None:
    """Raise InputError for no file, and a PNG whose end is missing: libpng complains on stderr by itself."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with path.open("rb") as file:
        is_png = file.read(len(_PNG)) == _PNG
        if is_png and b"IEND" not in file.read():
            raise InputError(f"{path}: the picture is cut off, its end is missing: copy it anew")


def _decoded(path: Path) -> tuple[Pixels | None, Sequence[int], Sequence[Pixels]]:
    """Pixels, kinds and bytes of the metadata; OpenCV's own complaints are not shown."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.imreadWithMetadata(str(path), flags=_AS_STORED)  # type: ignore[return-value] # None if unreadable
    finally:
        cv2.utils.logging.setLogLevel(level)


def as_8_bit(pixels: Pixels) -> Grey:
    """Grey levels as 8 bits; uint16 as `CameraImage` has it, 65535 becomes 255."""
    if pixels.dtype == np.uint8:
        return np.asarray(pixels, dtype=np.uint8)
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / 65535), dtype=np.uint8)


def _orientation(exif: bytes) -> int:
    """Orientation of the first directory of an EXIF block (TIFF 6.0); 1, upright, when it says none."""
    block = exif.removeprefix(b"Exif\0\0")
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None or len(block) < 8:
        return _UPRIGHT
    (start,) = struct.unpack_from(order + "I", block, 4)
    if start + 2 > len(block):
        return _UPRIGHT
    (count,) = struct.unpack_from(order + "H", block, start)
    for entry in range(start + 2, min(start + 2 + 12 * count, len(block) - 11), 12):
        tag, _, _, value = struct.unpack_from(order + "HHIH", block, entry)
        if tag == _ORIENTATION_TAG:
            return int(value)
    return _UPRIGHT
