"""GenICam pixel formats (PFNC values) that are one grey number per pixel, and how many bits of it count."""

import numpy as np

from vgrd.devices import Pixels, full_scale

MONO_BITS = {
    0x01080001: 8,  # Mono8
    0x01100003: 10,  # Mono10
    0x01100005: 12,  # Mono12
    0x01100025: 14,  # Mono14
    0x01100007: 16,  # Mono16
}
WORDS = "choose pixel_format Mono8, or an unpacked Mono10, Mono12, Mono14, Mono16"


def levels(pixels: Pixels, pixel_format: int) -> Pixels:
    """Pixels as `CameraImage` has them, of pixels as the camera sent them in a format of `MONO_BITS`."""
    if pixels.dtype == np.uint8:
        return pixels
    return full_scale(pixels.view(np.uint16), MONO_BITS[pixel_format])
