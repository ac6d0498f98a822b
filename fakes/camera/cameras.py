"""Which camera stack the fake cell can use on this machine."""

from importlib.util import find_spec
from typing import NamedTuple

from drivers import aravis_library
from vgrd.errors import DeviceRefused


class Choice(NamedTuple):
    """Driver as a cell file names it, and why."""

    driver: str
    reason: str


def choose() -> Choice:
    """Prefer Aravis (a real network camera); DeviceRefused where neither stack is installed."""
    try:
        aravis_library.load()
    except DeviceRefused as error:
        if find_spec("pypylon") is None:
            raise
        return Choice("fakes.camera.pylon_camera", f"pylon's emulator, because {error}")
    return Choice("aravis", "Aravis: GigE Vision over loopback")
