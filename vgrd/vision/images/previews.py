"""Small pictures for people to look at."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Pixels
from vgrd.vision.images.pictures import as_8_bit

_QUALITY = 80  # chosen: tags and print stay clear, 1024 px take some 150 kB


def preview(pixels: Pixels, width_px: int) -> tuple[bytes, tuple[int, int]]:
    """JPEG of a picture (h, w), no wider than so many pixels, and its (width, height)."""
    height, width = pixels.shape
    shrink = min(1.0, width_px / width)
    size = (max(1, round(shrink * width)), max(1, round(shrink * height)))
    small: NDArray[np.uint8] = as_8_bit(pixels)
    if size != (width, height):
        small = np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return jpeg.tobytes(), size
