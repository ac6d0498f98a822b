"""The newest whole picture that a running daemon has, out of its ring."""

from pathlib import Path

from vgrd.clock import Clock
from vgrd.devices import CameraImage, wire
from vgrd.errors import DeviceUnavailable, RingUnavailable
from vgrd.ipc.ring import RingReader

_WAIT_S = (
    5.0  # a whole picture comes each half second; a slow camera takes 2 s, a busy machine more
)


def newest_picture(runtime_dir: Path, clock: Clock) -> CameraImage:
    """Wait for a whole picture, since those of regions show tag B only. Raises DeviceUnavailable."""
    end_s = clock.monotonic() + _WAIT_S
    try:
        with RingReader.open(runtime_dir / wire.IMAGE_RING, wire.IMAGE_KIND, clock) as ring:
            index = max(0, ring.index - 1)  # the newest one there is will do
            while (left_s := end_s - clock.monotonic()) > 0:
                message = ring.wait_newer(index, left_s, clock)
                if message is None:
                    break
                image, index = wire.unpack_image(message.payload), message.index
                if image.region is None:
                    return image
    except RingUnavailable as err:
        raise DeviceUnavailable(f"the camera has sent no picture yet: {err}") from err
    raise DeviceUnavailable(
        f"no whole picture came within {_WAIT_S:g} s: `vgrd status` tells how the camera is"
    )
