"""What a device sends is doubted once: readings that cannot be, pictures that were there before."""

import math
import zlib

import numpy as np

from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading, Pixels
from vgrd.errors import BadReading, DeviceRefused
from vgrd.geometry import Pose

FASTEST_MM_S = 12_000.0  # the quickest parallel robots reach 10 m/s
FASTEST_RAD_S = 50.0  # their fourth axis; wrists of arms turn at 10
STAMP_S = 0.02  # how far two stamps may be off each other on a busy machine
AHEAD_S = 0.1  # a mapping of clocks is off by less
FARTHEST_MM = 20_000.0  # no arm reaches farther, on a rail neither
NEAREST_MM = (0.02, 5.0)  # no flange is as near to the base's origin: metres taken for mm
SAMPLED_ROWS = 8  # every eighth row of 12 megapixels is compared within 1.2 ms
GREY = (0.1, 0.95)  # of full scale: levels there carry noise of more than half a step
FEW_PIXELS = 200  # so many grey pixels are never all the same in two pictures of one scene


class FlangeCheck:
    """Refuses readings of a robot that cannot follow the ones before."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last_good: FlangeReading | None = None
        self._last_stamp_s = -math.inf

    def accept(self, reading: FlangeReading) -> FlangeReading:
        """The reading itself.

        Raises BadReading: its time does not advance or lies ahead, the flange is out of reach or
        jumped. Raises DeviceRefused when the first reading is in a wrong unit.
        """
        previous_s, self._last_stamp_s = self._last_stamp_s, reading.stamp_s
        self._check_time(previous_s, reading.stamp_s)
        if self._last_good is None:
            _check_unit(reading.base_from_wrist)
        elif not np.abs(reading.base_from_wrist.translation).max() < FARTHEST_MM:
            raise BadReading(f"the flange is said to be at {_words(reading.base_from_wrist)}")
        else:
            self._check_jump(
                self._last_good.base_from_wrist, reading, reading.stamp_s - previous_s
            )
        self._last_good = reading
        return reading

    def _check_time(self, previous_s: float, stamp_s: float) -> None:
        if not stamp_s > previous_s:
            raise BadReading(f"the robot's time does not advance: {stamp_s - previous_s:.3f} s")
        ahead_s = stamp_s - self._clock.monotonic()
        if not ahead_s < AHEAD_S:
            raise BadReading(f"a flange reading is stamped {ahead_s:.3f} s ahead of now")

    def _check_jump(self, old: Pose, reading: FlangeReading, step_s: float) -> None:
        """The angle is that between the matrices: a rotation vector that wraps at pi is no jump."""
        mm, rad = old.distance(reading.base_from_wrist)
        time_s = step_s + STAMP_S
        if mm > FASTEST_MM_S * time_s + reading.step_mm or rad > FASTEST_RAD_S * time_s:
            raise BadReading(
                f"the flange jumped by {mm:.0f} mm, {rad:.2f} rad in {1e3 * step_s:.0f} ms, "
                f"to {_words(reading.base_from_wrist)}"
            )


class FrameCheck:
    """Refuses frozen pictures: number, stamp and pixels must all change; and unusable ones.

    picture_bytes: what a picture of the cell file's size and depth takes; None: any.
    """

    def __init__(self, picture_bytes: int | None = None) -> None:
        self.frame = -1
        self.stamp_s = -math.inf
        self._picture_bytes = picture_bytes
        self._last_pixels: tuple[tuple[int, ...], int] = ((), 0)

    def accept(self, image: CameraImage) -> CameraImage:
        """The image itself; BadReading when it is not newer than the last one, or no picture."""
        self._check_picture(image.pixels)
        if not (image.frame > self.frame and image.stamp_s > self.stamp_s):
            raise BadReading(
                f"the camera repeats itself: frame {image.frame} after {self.frame}, "
                f"{image.stamp_s - self.stamp_s:.3f} s later"
            )
        self.frame, self.stamp_s = image.frame, image.stamp_s
        rows = np.ascontiguousarray(image.pixels[::SAMPLED_ROWS])
        previous, self._last_pixels = (
            self._last_pixels,
            (image.pixels.shape, zlib.crc32(rows.data)),
        )
        if self._last_pixels == previous and _carries_noise(image.pixels[::SAMPLED_ROWS]):
            raise BadReading(
                f"the camera repeats itself: frame {image.frame} has the pixels of the one before; "
                "power it off and on (a simulated camera needs noise)"
            )
        return image

    def _check_picture(self, pixels: Pixels) -> None:
        if pixels.ndim != 2 or not pixels.size or pixels.dtype not in (np.uint8, np.uint16):
            raise BadReading(f"not a grey picture: {pixels.dtype} {pixels.shape}")
        if self._picture_bytes is not None and pixels.nbytes > self._picture_bytes:
            raise BadReading(
                f"a picture of {pixels.shape[1]} x {pixels.shape[0]} px, {8 * pixels.itemsize} bits, is "
                "larger than the cell file says: correct [camera] size_px or bits"
            )


def _check_unit(base_from_wrist: Pose) -> None:
    """DeviceRefused when a pose is out of reach, or as near to the origin as one in metres."""
    far_mm = float(np.linalg.norm(base_from_wrist.translation))
    if NEAREST_MM[0] < far_mm < NEAREST_MM[1] or not far_mm < FARTHEST_MM:
        raise DeviceRefused(
            f"the flange is said to be at {_words(base_from_wrist)}: are the units of the driver or "
            "its profile right (mm_per_count)? An arm that really is there has to be moved away first"
        )


def _carries_noise(pixels: Pixels) -> bool:
    """Whether enough pixels are neither black nor white: those of two pictures always differ."""
    full = np.iinfo(pixels.dtype).max
    grey = (pixels > GREY[0] * full) & (pixels < GREY[1] * full)
    return int(np.count_nonzero(grey)) >= FEW_PIXELS


def _words(pose: Pose) -> str:
    x, y, z = pose.translation
    return f"({x:.3f}, {y:.3f}, {z:.3f}) mm"
