"""The Aravis library (GenICam cameras) through ctypes, without PyGObject.

The wheel `aravis-python` brings the library but not what it links to: glib, libxml2 and ICU must
be on the system, libusb too, or as the wheel `libusb-package`.
"""

import contextlib
import ctypes
from ctypes import (
    POINTER,
    byref,
    c_char_p,
    c_double,
    c_int,
    c_size_t,
    c_uint,
    c_uint32,
    c_uint64,
    c_void_p,
)
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from vgrd.errors import DeviceRefused

PAYLOAD_COMPLETE = 0  # ARV_BUFFER_STATUS_SUCCESS
_BOOL = c_int


class AravisError(Exception):
    """A GError: what Aravis says went wrong."""


class _GError(ctypes.Structure):
    _fields_ = (("domain", c_uint32), ("code", c_int), ("message", c_char_p))


_Signatures = dict[str, tuple[Any, ...]]  # name: (result, arguments ...)
# Functions that can fail: their last argument in C is a GError**, which `call` adds.
_FALLIBLE: _Signatures = {
    "arv_camera_new": (c_void_p, c_char_p),
    "arv_camera_set_trigger": (None, c_void_p, c_char_p),
    "arv_camera_set_string": (None, c_void_p, c_char_p, c_char_p),
    "arv_camera_set_pixel_format_from_string": (None, c_void_p, c_char_p),
    "arv_camera_set_exposure_time": (None, c_void_p, c_double),
    "arv_camera_get_exposure_time": (c_double, c_void_p),
    "arv_camera_set_gain": (None, c_void_p, c_double),
    "arv_camera_gv_set_packet_size": (None, c_void_p, c_int),
    "arv_camera_set_region": (None, c_void_p, c_int, c_int, c_int, c_int),
    "arv_camera_get_width_bounds": (None, c_void_p, POINTER(c_int), POINTER(c_int)),
    "arv_camera_get_height_bounds": (None, c_void_p, POINTER(c_int), POINTER(c_int)),
    "arv_camera_get_x_offset_increment": (c_int, c_void_p),
    "arv_camera_get_y_offset_increment": (c_int, c_void_p),
    "arv_camera_get_width_increment": (c_int, c_void_p),
    "arv_camera_get_height_increment": (c_int, c_void_p),
    "arv_camera_is_region_offset_available": (_BOOL, c_void_p),
    "arv_camera_get_device_serial_number": (c_char_p, c_void_p),
    "arv_camera_get_payload": (c_uint, c_void_p),
    "arv_camera_create_stream": (c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "arv_camera_start_acquisition": (None, c_void_p),
    "arv_camera_stop_acquisition": (None, c_void_p),
    "arv_camera_software_trigger": (None, c_void_p),
    "arv_camera_is_feature_available": (_BOOL, c_void_p, c_char_p),
}
_INFALLIBLE: _Signatures = {
    "arv_camera_is_gv_device": (_BOOL, c_void_p),
    "arv_camera_gv_set_packet_size_adjustment": (None, c_void_p, c_int),
    "arv_camera_gv_set_stream_options": (None, c_void_p, c_int),
    "arv_buffer_new_allocate": (c_void_p, c_size_t),
    "arv_buffer_get_status": (c_int, c_void_p),
    "arv_buffer_get_frame_id": (c_uint64, c_void_p),
    "arv_buffer_get_data": (c_void_p, c_void_p, POINTER(c_size_t)),
    "arv_buffer_get_image_width": (c_int, c_void_p),
    "arv_buffer_get_image_height": (c_int, c_void_p),
    "arv_buffer_get_image_pixel_format": (c_uint32, c_void_p),
    "arv_stream_push_buffer": (None, c_void_p, c_void_p),
    "arv_stream_try_pop_buffer": (c_void_p, c_void_p),
    "arv_stream_timeout_pop_buffer": (c_void_p, c_void_p, c_uint64),
    "g_object_set": (None, c_void_p, c_char_p, c_int, c_void_p),
    "g_object_unref": (None, c_void_p),
}


class Library:
    """Typed functions of libaravis, by name."""

    def __init__(self, handle: ctypes.CDLL) -> None:
        self.handle = handle
        for name, (result, *arguments) in _FALLIBLE.items():
            self.declare(name, result, *arguments, c_void_p)
        for name, (result, *arguments) in _INFALLIBLE.items():
            self.declare(name, result, *arguments)
        self.declare("g_error_free", None, c_void_p)

    def declare(self, name: str, result: object, *arguments: object) -> None:
        """Tell ctypes the signature of one more function."""
        function = getattr(self.handle, name)
        function.restype = result
        function.argtypes = arguments

    def call(self, name: str, *arguments: object) -> Any:  # noqa: ANN401 - as the C function has it
        """Call a function; AravisError with its message when it sets a GError."""
        if name not in _FALLIBLE:
            return getattr(self.handle, name)(*arguments)
        error = POINTER(_GError)()
        result = getattr(self.handle, name)(*arguments, byref(error))
        if error:
            message = (error.contents.message or b"").decode(errors="replace")
            self.handle.g_error_free(error)
            raise AravisError(message)
        return result


def load() -> Library:
    """Load Aravis from its wheel, else from the system; DeviceRefused tells what is missing."""
    _load_libusb()
    failures = []
    for path in (_in_package("aravis", "lib/libaravis-0.8.so.0"), "libaravis-0.8.so.0"):
        if path:
            try:
                return Library(ctypes.CDLL(path))
            except OSError as error:
                failures.append(str(error))
    raise DeviceRefused(
        f"Aravis cannot be loaded ({'; '.join(failures)}): install the extra `cameras` and the "
        "system's glib, libxml2 and ICU"
    )


def _load_libusb() -> None:
    """Make libusb's symbols known before Aravis asks for them by the system's file name."""
    for path in ("libusb-1.0.so.0", _in_package("libusb_package", "libusb-1.0.so")):
        with contextlib.suppress(OSError):
            if path:
                ctypes.CDLL(path, ctypes.RTLD_GLOBAL)
                return


def _in_package(package: str, name: str) -> str | None:
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (Path(folder) / name).exists():
            return str(Path(folder) / name)
    return None
