"""How flange readings, pictures and presses lie in the rings: fixed binary layouts, little-endian."""

import struct

import numpy as np

from vgrd.devices import CameraImage, FlangeReading, Region
from vgrd.errors import BadReading, InputError
from vgrd.geometry import Pose

FLANGE_RING = "robot.ring"
IMAGE_RING = "camera.ring"
TRIGGER_RING = "camera.trigger.ring"
PEDAL_RING = "pedal.ring"
FLANGE_KIND = "flange"
IMAGE_KIND = "image"
TRIGGER_KIND = "trigger"
PEDAL_KIND = "pedal"
FLANGE_SLOTS = 256  # chosen: the cell may be held up for half a second of a robot of 500 Hz
PEDAL_SLOTS = 4  # a press that nobody took in time is none
PEDAL_BYTES = 8  # a press is its stamp; a slot needs some room
IMAGE_SLOTS = 4  # the writer overwrites a picture three pictures later, see `vgrd.ipc.ring`

_FLANGE = struct.Struct("<dd12d?12dQ?dd")
_IMAGE = struct.Struct("<dQIIB?II")  # stamp, frame, height, width, depth, is it a region, x, y
_TRIGGER = struct.Struct("<?4I")  # is it a region, x, y, width, height
_DTYPES: tuple[type[np.uint8 | np.uint16], ...] = (np.uint8, np.uint16)

FLANGE_BYTES = _FLANGE.size
IMAGE_HEADER_BYTES = _IMAGE.size
TRIGGER_BYTES = _TRIGGER.size


def pack_flange(reading: FlangeReading) -> bytes:
    """One flange reading as bytes."""
    tcp = reading.wrist_from_tcp
    return _FLANGE.pack(
        reading.stamp_s,
        reading.controller_s,
        *_numbers(reading.base_from_wrist),
        tcp is not None,
        *_numbers(tcp or Pose.identity()),
        reading.digital_inputs,
        reading.running,
        reading.step_mm,
        reading.step_rad,
    )


def unpack_flange(payload: bytes) -> FlangeReading:
    """The inverse of `pack_flange`; BadReading on anything that is not a rigid motion."""
    stamp, controller, *values = _FLANGE.unpack(payload)
    try:
        return FlangeReading(
            base_from_wrist=_pose(values[:12]),
            wrist_from_tcp=_pose(values[13:25]) if values[12] else None,
            stamp_s=stamp,
            controller_s=controller,
            digital_inputs=values[25],
            running=values[26],
            step_mm=values[27],
            step_rad=values[28],
        )
    except InputError as err:
        raise BadReading(f"flange reading in {FLANGE_RING}: {err}") from err


def pack_image_header(image: CameraImage) -> bytes:
    """What goes before the pixels of a picture."""
    height, width = image.pixels.shape
    code = _DTYPES.index(image.pixels.dtype.type)
    region = image.region
    x, y = (0, 0) if region is None else (region.x, region.y)
    return _IMAGE.pack(image.stamp_s, image.frame, height, width, code, region is not None, x, y)


def unpack_image(payload: bytes | bytearray | memoryview) -> CameraImage:
    """A picture from header and pixels; the pixels are a view of `payload`."""
    stamp, frame, height, width, code, is_region, x, y = _IMAGE.unpack_from(payload)
    pixels = np.frombuffer(
        payload, dtype=_DTYPES[code], count=height * width, offset=_IMAGE.size
    ).reshape(height, width)
    return CameraImage(pixels, stamp, frame, Region(x, y, width, height) if is_region else None)


def pack_trigger(region: Region | None) -> bytes:
    """The wish for a picture: of a region, or whole."""
    part = region or Region(0, 0, 0, 0)
    return _TRIGGER.pack(region is not None, part.x, part.y, part.width, part.height)


def unpack_trigger(payload: bytes) -> Region | None:
    """The inverse of `pack_trigger`."""
    is_region, *numbers = _TRIGGER.unpack(payload)
    return Region(*numbers) if is_region else None


def _numbers(pose: Pose) -> list[float]:
    return [*pose.rotation.ravel(), *pose.translation]


def _pose(values: list[float]) -> Pose:
    return Pose(np.reshape(values[:9], (3, 3)), np.array(values[9:]))
