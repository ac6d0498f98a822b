"""GenICam cameras (GigE Vision, USB3 Vision) through Aravis: one picture per software trigger."""

import contextlib
import ctypes
import queue
import threading

import numpy as np

from drivers import settings as driver_settings
from drivers.aravis_library import PAYLOAD_COMPLETE, AravisError, Library, load
from drivers.catalogue import AravisSettings
from drivers.frame_counter import FrameCounter
from drivers.pixel_formats import MONO_BITS, WORDS, levels
from drivers.region_grid import RegionGrid
from vgrd.clock import Clock
from vgrd.devices import Camera, CameraImage, Pixels, Region, Settings
from vgrd.errors import BadReading, DeviceRefused, DeviceUnavailable

_BUFFERS = 3  # chosen: one is filled, one is read, one is spare
_LAST_FRAME_ID = 0xFFFF  # GigE Vision 1.x counts frames in 16 bits
_PACKET_SIZE_AS_SET = 0  # ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER
_SOCKET_BUFFER_OF_ONE_PICTURE = 1  # ARV_GV_STREAM_SOCKET_BUFFER_AUTO
_UNCHANGED = -1  # width or height of a region, as Aravis takes it


def open(settings: Settings, clock: Clock) -> Camera:  # noqa: A001 - the name of every driver's entry
    """Connect, set to software trigger and start; settings as in `AravisSettings`.

    Raises ConfigError, DeviceUnavailable (no camera there, or another program holds it),
    DeviceRefused (no Aravis on this machine, or the camera refuses a setting).
    """
    options = driver_settings.parse(AravisSettings, settings, "settings of driver aravis")
    library = load()
    try:
        camera = library.call("arv_camera_new", options.address.encode())
    except AravisError as error:
        raise DeviceUnavailable(f"no camera at {options.address}: {error}") from error
    if not camera:
        raise DeviceUnavailable(f"no camera at {options.address}; is it on, the address right?")
    try:
        exposure_s = _configure(library, camera, options)
        return AravisCamera(library, camera, exposure_s, options.address, clock)
    except AravisError as error:
        library.call("g_object_unref", camera)
        raise DeviceRefused(f"the camera at {options.address} refuses: {error}") from error


def _configure(library: Library, camera: object, options: AravisSettings) -> float:
    """Apply the settings, return the exposure time in s (0 where the camera does not tell)."""
    if options.serial is not None:
        serial = (library.call("arv_camera_get_device_serial_number", camera) or b"").decode()
        if serial != options.serial:
            raise AravisError(
                f"it is the camera with serial {serial}, the settings say {options.serial}: "
                "put the right one there, or teach anew with this one"
            )
    library.call("arv_camera_set_pixel_format_from_string", camera, options.pixel_format.encode())
    library.call("arv_camera_set_string", camera, b"AcquisitionMode", b"Continuous")
    library.call("arv_camera_set_trigger", camera, b"Software")
    if options.exposure_ms is not None:
        library.call("arv_camera_set_exposure_time", camera, 1e3 * options.exposure_ms)
    if options.gain_db is not None:
        library.call("arv_camera_set_gain", camera, options.gain_db)
    if options.packet_bytes is not None and library.call("arv_camera_is_gv_device", camera):
        library.call("arv_camera_gv_set_packet_size_adjustment", camera, _PACKET_SIZE_AS_SET)
        library.call("arv_camera_gv_set_packet_size", camera, options.packet_bytes)
    try:
        return 1e-6 * float(library.call("arv_camera_get_exposure_time", camera))
    except AravisError:
        return 0.0


class AravisCamera:
    """A camera that waits for triggers; see `open`.

    The picture is stamped with the middle of the trigger command (sent .. acknowledged, half of it
    is the uncertainty) plus half of the exposure time.
    """

    def __init__(
        self, library: Library, camera: object, exposure_s: float, address: str, clock: Clock
    ) -> None:
        self._library = library
        self._camera = camera
        self._address = address
        self._clock = clock
        self._is_lost = False
        self._half_exposure_s = 0.5 * exposure_s
        self._frames = FrameCounter(wrap_at=_LAST_FRAME_ID)
        self._grid = _whole_region(library, camera)
        self._region: Region | None = None
        payload = library.call("arv_camera_get_payload", camera)
        self._stream = library.call("arv_camera_create_stream", camera, None, None, None)
        if library.call("arv_camera_is_gv_device", camera):
            library.call(
                "g_object_set", self._stream, b"socket-buffer", _SOCKET_BUFFER_OF_ONE_PICTURE, None
            )
        for _ in range(_BUFFERS):
            buffer = library.call("arv_buffer_new_allocate", payload)
            library.call("arv_stream_push_buffer", self._stream, buffer)
        library.call("arv_camera_start_acquisition", camera)

    def grab(self, timeout_s: float, region: Region | None = None) -> CameraImage:
        """Take a picture; as `vgrd.devices.Camera.grab`."""
        if self._camera is None:
            raise DeviceUnavailable("the driver was closed")
        self._aim(region)
        self._drop_leftovers()
        sent_s, acknowledged_s = self._trigger(timeout_s)
        wait_us = max(0, int(1e6 * (timeout_s - (acknowledged_s - sent_s))))
        buffer = self._library.call("arv_stream_timeout_pop_buffer", self._stream, wait_us)
        if not buffer:
            raise DeviceUnavailable(
                f"the camera at {self._address} sent no picture within {timeout_s:.2f} s"
            )
        try:
            stamp_s = 0.5 * (sent_s + acknowledged_s) + self._half_exposure_s
            pixels = self._pixels(buffer)
            return CameraImage(pixels, stamp_s, self._number(buffer), self._region)
        finally:
            self._library.call("arv_stream_push_buffer", self._stream, buffer)

    def _aim(self, region: Region | None) -> None:
        """Let the camera send a region, or the whole picture; it changes only while it stands still."""
        part = None if self._grid is None or region is None else self._grid.around(region)
        if self._grid is None or part == self._region:
            return
        area = part or self._grid.whole
        call, camera = self._library.call, self._camera
        try:
            call("arv_camera_stop_acquisition", camera)
            call("arv_camera_set_region", camera, area.x, area.y, area.width, area.height)
            call("arv_camera_start_acquisition", camera)
        except AravisError as error:
            self._is_lost = True
            raise DeviceUnavailable(
                f"the camera at {self._address} does not take region {area}: {error}"
            ) from error
        self._region = part
        self._frames.restart()

    def _trigger(self, timeout_s: float) -> tuple[float, float]:
        """Send the trigger command; when it was sent and acknowledged (cell clock).

        Aravis tries a silent camera for 2.5 s and cannot be told otherwise, hence the thread.
        """
        outcome: queue.SimpleQueue[tuple[float, float] | AravisError] = queue.SimpleQueue()
        camera = self._camera

        def send() -> None:
            sent_s = self._clock.monotonic()
            try:
                self._library.call("arv_camera_software_trigger", camera)
                outcome.put((sent_s, self._clock.monotonic()))
            except AravisError as error:
                outcome.put(error)

        threading.Thread(target=send, name="trigger", daemon=True).start()
        try:
            times = outcome.get(timeout=timeout_s)
        except queue.Empty:
            times = AravisError(f"no answer within {timeout_s:.2f} s")
        if isinstance(times, AravisError):
            self._is_lost = True
            raise DeviceUnavailable(f"the camera at {self._address} is lost: {times}")
        return times

    def _drop_leftovers(self) -> None:
        while buffer := self._library.call("arv_stream_try_pop_buffer", self._stream):
            self._library.call("arv_stream_push_buffer", self._stream, buffer)

    def _number(self, buffer: object) -> int:
        return self._frames.advance(self._library.call("arv_buffer_get_frame_id", buffer))

    def _pixels(self, buffer: object) -> Pixels:
        """Copy the picture (height, width) out of the buffer."""
        call = self._library.call
        status = call("arv_buffer_get_status", buffer)
        if status != PAYLOAD_COMPLETE:
            raise BadReading(f"incomplete picture from {self._address} (Aravis status {status})")
        pixel_format = call("arv_buffer_get_image_pixel_format", buffer)
        if pixel_format not in MONO_BITS:
            raise BadReading(f"{self._address} sends pixel format {pixel_format:#010x}: {WORDS}")
        height = call("arv_buffer_get_image_height", buffer)
        width = call("arv_buffer_get_image_width", buffer)
        if self._region and (width, height) != (self._region.width, self._region.height):
            raise BadReading(f"{width} x {height} px from {self._address}, asked: {self._region}")
        shape, is_deep = (height, width), MONO_BITS[pixel_format] > 8
        pixels: Pixels = np.empty(shape, np.uint16) if is_deep else np.empty(shape, np.uint8)
        size = ctypes.c_size_t()
        data = call("arv_buffer_get_data", buffer, ctypes.byref(size))
        if size.value < pixels.nbytes:
            raise BadReading(f"{size.value} bytes are too few for {width} x {height} pixels")
        ctypes.memmove(pixels.ctypes.data, ctypes.c_void_p(data), pixels.nbytes)
        return levels(pixels, pixel_format)

    def close(self) -> None:
        """Stop and release the camera; may be called more than once.

        A lost camera is left to the end of the process: every word to it would take 2.5 s.
        """
        camera, self._camera = self._camera, None
        if camera is None or self._is_lost:
            return
        with contextlib.suppress(AravisError):
            self._library.call("arv_camera_stop_acquisition", camera)
        self._library.call("g_object_unref", self._stream)
        self._library.call("g_object_unref", camera)


def _whole_region(library: Library, camera: object) -> RegionGrid | None:
    """Let the camera send all that it has, and say what regions it can send; None: it has no such mode.

    A driver that was killed may have left it with a region.
    """
    try:
        if not library.call("arv_camera_is_region_offset_available", camera):
            return None
        library.call("arv_camera_set_region", camera, 0, 0, _UNCHANGED, _UNCHANGED)
        size = []
        for axis in ("width", "height"):
            low, high = ctypes.c_int(), ctypes.c_int()
            bounds = ctypes.byref(low), ctypes.byref(high)
            library.call(f"arv_camera_get_{axis}_bounds", camera, *bounds)
            size.append(high.value)
        library.call("arv_camera_set_region", camera, 0, 0, *size)
        steps = [
            library.call(f"arv_camera_get_{name}_increment", camera)
            for name in ("x_offset", "y_offset", "width", "height")
        ]
    except AravisError:
        return None
    return RegionGrid(Region(0, 0, *size), *steps)
