"""Pictures as they are stored: a small header and lossless JPEG-XL.

Layout of a message on topic `/image` (little endian): magic "VGI1", frame number int64,
mid-exposure time on the cell clock float64 s; then one JPEG-XL code stream (grey, 8 or 16 bits,
lossless). With magic "VGI2" (more than 8 bits) a byte comes before the stream: by how many bits its
levels are shifted up to fill 16; empty bits would cost half of the picture's size again. Older
recordings have "VGI1" for those too and do not tell.
"""

import struct
from dataclasses import dataclass
from typing import cast

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from vgrd.devices import CameraImage, Pixels, full_scale, guessed_bits
from vgrd.errors import Corrupt, InputError

_MAGIC, _DEEP_MAGIC = b"VGI1", b"VGI2"
_HEADER = struct.Struct("<4sqd")


@dataclass(frozen=True, slots=True)
class EncodedImage:
    """A picture ready to be stored; `data` is the whole message."""

    stamp_s: float
    frame: int
    data: bytes


def encode_image(image: CameraImage) -> EncodedImage:
    """Compress without loss, the GIL released (about 40 ms for 12 megapixels): for an executor."""
    if image.pixels.dtype not in (np.uint8, np.uint16) or image.pixels.ndim != 2:
        raise InputError(
            "a picture is grey (height, width) uint8 or uint16, "
            f"got {image.pixels.shape} {image.pixels.dtype}"
        )
    pixels = np.ascontiguousarray(image.pixels)
    header = _HEADER.pack(_MAGIC, image.frame, image.stamp_s)
    if pixels.dtype == np.uint16:
        empty = _empty_bits(cast(NDArray[np.uint16], pixels))
        header = _HEADER.pack(_DEEP_MAGIC, image.frame, image.stamp_s) + bytes([empty])
        pixels = np.right_shift(pixels, empty)
    stream = imagecodecs.jpegxl_encode(pixels, lossless=True, effort=1, numthreads=1)
    return EncodedImage(image.stamp_s, image.frame, header + stream)


def stamp_of(data: bytes) -> float:
    """Time of a stored picture on the cell clock, s, without decoding it; raises Corrupt."""
    return _header(data)[1]


def decode_image(data: bytes) -> CameraImage:
    """Picture that `encode_image` stored, bit for bit; raises Corrupt."""
    frame, stamp_s = _header(data)
    start = _HEADER.size + (data[:4] == _DEEP_MAGIC)
    try:
        pixels = imagecodecs.jpegxl_decode(data[start:], numthreads=1)
    except imagecodecs.JpegxlError as error:
        raise Corrupt(f"picture {frame} cannot be decoded: {error}") from error
    if pixels.dtype == np.uint16:
        has_depth = data[:4] == _DEEP_MAGIC
        bits = 16 - data[start - 1] if has_depth else guessed_bits(pixels)
        pixels = full_scale(pixels, bits)
    return CameraImage(cast(Pixels, pixels), stamp_s, frame)


def _empty_bits(levels: NDArray[np.uint16]) -> int:
    """How many of the lowest bits no pixel uses."""
    used_bits = int(np.bitwise_or.reduce(levels, axis=None))
    return (used_bits & -used_bits).bit_length() - 1 if used_bits else 0


def _header(data: bytes) -> tuple[int, float]:
    """Frame number and stamp."""
    if len(data) < _HEADER.size or data[:4] not in (_MAGIC, _DEEP_MAGIC):
        raise Corrupt("not a stored picture: its header is wrong")
    _, frame, stamp_s = _HEADER.unpack_from(data)
    return frame, stamp_s
