"""A camera for machines without Aravis: pylon's emulator, fed with one drawn picture per grab.

The emulator reads an image file once and locks its name while grabbing, so every grab writes a
file under a new name and arms the camera again; its frames are then all number 0, and this wrapper
counts them itself. Named in a cell file as `driver = "fakes.camera.pylon_camera"`.
"""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from drivers import pylon
from drivers import settings as driver_settings
from drivers.catalogue import PylonSettings
from fakes.camera.scene import Draw, pictures
from fakes.world.cells import DEFAULT, cell_called
from vgrd.clock import Clock
from vgrd.devices import Camera, CameraImage, Region, Settings
from vgrd.errors import DeviceUnavailable, RingUnavailable

_EMULATOR = "0815-0000"  # serial of the first camera that PYLON_CAMEMU makes


@dataclass(frozen=True, slots=True)
class EmulatorSettings:
    """`snapshots`: ring of the world; without it a world of its own in which nothing moves.

    cell: whose layout is seen.
    """

    snapshots: str | None = None
    cell: str = DEFAULT


def open(settings: Settings, clock: Clock) -> Camera:  # noqa: A001 - the name of every driver's entry
    """Open the emulator; DeviceUnavailable while the world is not there."""
    options = driver_settings.parse(
        EmulatorSettings, settings, "settings of driver fakes.camera.pylon_camera"
    )
    try:
        layout = cell_called(options.cell).layout()
        draw = pictures(Path(options.snapshots) if options.snapshots else None, layout)
    except RingUnavailable as error:
        raise DeviceUnavailable(str(error)) from error
    return EmulatedCamera(draw, clock)


class EmulatedCamera:
    """Pylon's emulator showing what `draw` returns."""

    def __init__(self, draw: Draw, clock: Clock) -> None:
        os.environ["PYLON_CAMEMU"] = "1"
        self._draw = draw
        self._clock = clock
        self._frame = 0
        self._folder = tempfile.TemporaryDirectory(prefix="vgrd-pylon-", dir=_memory_folder())
        self._camera: Any = pylon.connect(PylonSettings(serial=_EMULATOR))
        pylon.configure(self._camera, PylonSettings())
        self._camera.TestImageSelector.Value = "Off"
        self._camera.ImageFileMode.Value = "On"

    def grab(self, timeout_s: float, region: Region | None = None) -> CameraImage:  # noqa: ARG002
        """Draw a picture and grab it, whole; as `vgrd.devices.Camera.grab`."""
        try:
            picture = self._draw(None)
        except TimeoutError as error:
            raise DeviceUnavailable(str(error)) from error
        self._frame += 1
        path = Path(self._folder.name) / f"{self._frame}.bmp"
        cv2.imwrite(str(path), picture)
        camera = self._camera
        camera.Height.Value, camera.Width.Value = picture.shape
        camera.ImageFilename.Value = str(path)
        camera.StartGrabbing(1)
        try:
            pixels, stamp_s, _ = pylon.take(camera, timeout_s, self._clock)
        finally:
            camera.StopGrabbing()
            path.unlink()
        return CameraImage(pixels, stamp_s, self._frame)

    def close(self) -> None:
        """Release the emulator and its files; may be called more than once."""
        self._camera.Close()
        self._folder.cleanup()


def _memory_folder() -> str | None:
    """Return a folder in memory where there is one."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108
