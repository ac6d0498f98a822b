"""Basler cameras through pypylon: one picture per software trigger."""

import contextlib
from typing import Any

import numpy as np
from pypylon import genicam, pylon

from drivers import settings as driver_settings
from drivers.catalogue import PylonSettings
from drivers.frame_counter import FrameCounter
from drivers.pixel_formats import MONO_BITS, WORDS, levels
from drivers.region_grid import RegionGrid
from vgrd.clock import Clock
from vgrd.devices import Camera, CameraImage, Pixels, Region, Settings
from vgrd.errors import BadReading, DeviceRefused, DeviceUnavailable

_LAST_FRAME_ID = 0xFFFF  # GigE Vision 1.x counts frames in 16 bits


def open(settings: Settings, clock: Clock) -> Camera:  # noqa: A001 - the name of every driver's entry
    """Connect, set to software trigger and start; settings as in `PylonSettings`.

    Raises ConfigError, DeviceUnavailable (no such camera, or another program holds it),
    DeviceRefused (the camera refuses a setting).
    """
    options = driver_settings.parse(PylonSettings, settings, "settings of driver pylon")
    camera = connect(options)
    try:
        configure(camera, options)
        grid = _whole_region(camera)
        camera.StartGrabbing(pylon.GrabStrategy_OneByOne)
    except DeviceRefused:
        camera.Close()
        raise
    return PylonCamera(camera, grid, clock)


def connect(options: PylonSettings) -> Any:  # noqa: ANN401 - pypylon has no types
    """Open the camera that the options name."""
    description = pylon.DeviceInfo()
    if options.serial is not None:
        description.SetSerialNumber(options.serial)
    if options.address is not None:
        description.SetIpAddress(options.address)
    name = options.serial or options.address or "any"
    try:
        camera = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateFirstDevice(description))
        camera.Open()
    except genicam.GenericException as error:
        raise DeviceUnavailable(f"cannot open pylon camera {name}: {error}") from error
    return camera


def configure(camera: Any, options: PylonSettings) -> None:  # noqa: ANN401 - pypylon has no types
    """Set format, exposure, gain and software trigger."""
    nodes = camera.GetNodeMap()
    try:
        camera.PixelFormat.Value = options.pixel_format
        camera.TriggerSelector.Value = "FrameStart"
        camera.TriggerMode.Value = "On"
        camera.TriggerSource.Value = "Software"
        if options.exposure_ms is not None:
            _first(nodes, "ExposureTime", "ExposureTimeAbs").SetValue(1e3 * options.exposure_ms)
        if options.gain_db is not None:
            _first(nodes, "Gain").SetValue(options.gain_db)
        if options.packet_bytes is not None:
            _first(nodes, "GevSCPSPacketSize").SetValue(options.packet_bytes)
    except genicam.GenericException as error:
        raise DeviceRefused(f"the camera refuses its settings: {error}") from error


def _first(nodes: Any, *names: str) -> Any:  # noqa: ANN401 - pypylon has no types
    """Return the first of the features that the camera has; models differ in their names."""
    for name in names:
        node = nodes.GetNode(name)
        if node is not None:
            return node
    raise DeviceRefused(f"the camera has no feature {' or '.join(names)}")


def take(camera: Any, timeout_s: float, clock: Clock) -> tuple[Pixels, float, int]:  # noqa: ANN401
    """Trigger a grabbing camera: pixels (height, width), mid-exposure time, the camera's number.

    The time is the middle of the trigger command (sent .. acknowledged) plus half of the exposure.
    """
    deadline_s = clock.monotonic() + timeout_s
    try:
        if not camera.WaitForFrameTriggerReady(int(1e3 * timeout_s), pylon.TimeoutHandling_Return):
            raise DeviceUnavailable(f"no trigger accepted within {timeout_s:.2f} s")
        sent_s = clock.monotonic()
        camera.ExecuteSoftwareTrigger()
        acknowledged_s = clock.monotonic()
        left_ms = max(1, int(1e3 * (deadline_s - acknowledged_s)))
        result = camera.RetrieveResult(left_ms, pylon.TimeoutHandling_Return)
        exposure = _first(camera.GetNodeMap(), "ExposureTime", "ExposureTimeAbs")
        half_exposure_s = 0.5e-6 * float(exposure.GetValue())
    except genicam.GenericException as error:
        raise DeviceUnavailable(f"the camera is lost: {error}") from error
    if not result.IsValid():
        raise DeviceUnavailable(f"no picture within {timeout_s:.2f} s")
    try:
        if not result.GrabSucceeded():
            raise BadReading(f"incomplete picture: {result.GetErrorDescription()}")
        pixels = np.array(result.Array)
        pixel_format = int(result.GetPixelType())
        number = int(result.BlockID)
    finally:
        result.Release()
    shape = (camera.Height.Value, camera.Width.Value)
    if pixels.shape != shape or pixels.dtype not in (np.uint8, np.uint16):
        raise BadReading(f"expected a grey picture of {shape}, got {pixels.dtype} {pixels.shape}")
    if pixel_format not in MONO_BITS:
        raise BadReading(f"the camera sends pixel format {pixel_format:#010x}: {WORDS}")
    return levels(pixels, pixel_format), 0.5 * (sent_s + acknowledged_s) + half_exposure_s, number


class PylonCamera:
    """A grabbing camera that waits for triggers; see `open`."""

    def __init__(self, camera: Any, grid: RegionGrid | None, clock: Clock) -> None:  # noqa: ANN401 - as `connect`
        self._camera = camera
        self._clock = clock
        self._frames = FrameCounter(_LAST_FRAME_ID)
        self._grid = grid
        self._region: Region | None = None

    def grab(self, timeout_s: float, region: Region | None = None) -> CameraImage:
        """Take a picture; as `vgrd.devices.Camera.grab`."""
        self._aim(region)
        pixels, stamp_s, number = take(self._camera, timeout_s, self._clock)
        return CameraImage(pixels, stamp_s, self._frames.advance(number), self._region)

    def _aim(self, region: Region | None) -> None:
        """Let the camera send a region, or the whole picture; it changes only while it stands still."""
        part = None if self._grid is None or region is None else self._grid.around(region)
        if self._grid is None or part == self._region:
            return
        area, camera = part or self._grid.whole, self._camera
        try:
            camera.StopGrabbing()
            camera.OffsetX.Value = camera.OffsetY.Value = (
                0  # else offset + size may pass the sensor
            )
            camera.Width.Value, camera.Height.Value = area.width, area.height
            camera.OffsetX.Value, camera.OffsetY.Value = area.x, area.y
            camera.StartGrabbing(pylon.GrabStrategy_OneByOne)
        except genicam.GenericException as error:
            raise DeviceUnavailable(f"the camera does not take region {area}: {error}") from error
        self._region = part
        self._frames.restart()

    def close(self) -> None:
        """Stop and release the camera; may be called more than once."""
        with contextlib.suppress(genicam.GenericException):  # a lost camera cannot be stopped
            self._camera.StopGrabbing()
            self._camera.Close()


def _whole_region(camera: Any) -> RegionGrid | None:  # noqa: ANN401 - pypylon has no types
    """Let the camera send all that it has, and say what regions it can send; None: it has no such mode.

    A driver that was killed may have left it with a region.
    """
    try:
        camera.OffsetX.Value = camera.OffsetY.Value = 0
        camera.Width.Value, camera.Height.Value = camera.Width.Max, camera.Height.Max
        axes = (camera.OffsetX, camera.OffsetY, camera.Width, camera.Height)
        whole = Region(*(int(axis.Value) for axis in axes))
        return RegionGrid(whole, *(int(axis.Inc) for axis in axes))
    except genicam.GenericException:
        return None
