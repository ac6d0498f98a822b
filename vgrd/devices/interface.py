"""What the daemon asks of devices. A driver module has `open(settings, clock)`, and a `DriverCard`.

A driver object is opened connected or its `open` raises; it is thrown away when it fails. It has no
connect, reconnect or is_connected. Vendor errors become `vgrd.errors.DeviceError` inside the driver.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Pose

Settings = Mapping[str, object]
Grey = NDArray[np.uint8]
Pixels = Grey | NDArray[np.uint16]

DEPTHS = (10, 12, 14, 16)  # bits of a grey level, of cameras that give more than 8
SLOWEST_ROBOT_HZ = 5.0  # between rarer readings an arm can move and come back unseen


@dataclass(frozen=True, slots=True, eq=False)
class FlangeReading:
    """One sample of the robot.

    base_from_wrist: the flange, whatever TCP is active on the pendant.
    wrist_from_tcp: the active TCP in the controller, None where the robot does not tell.
    stamp_s: cell clock (monotonic) at which the pose was true; controller_s: the controller's own time.
    digital_inputs: bit field. running: the controller is powered, in normal mode, not stopped by safety.
    step_mm, step_rad: in which steps the robot tells the flange, per axis; 0 where they do not matter.
    """

    base_from_wrist: Pose
    wrist_from_tcp: Pose | None
    stamp_s: float
    controller_s: float
    digital_inputs: int = 0
    running: bool = True
    step_mm: float = 0.0
    step_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle of a camera's whole picture, px; (x, y) is its first pixel."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """One picture: grey `pixels` (height, width), mid-exposure time on the cell clock, advancing frame number.

    region: where the pixels lie in the whole picture, None for the whole picture.
    uint16 levels fill the 16 bits, whatever the camera's depth: see `full_scale`.
    """

    pixels: Pixels
    stamp_s: float
    frame: int
    region: Region | None = None


def full_scale(levels: NDArray[np.uint16], bits: int) -> NDArray[np.uint16]:
    """Levels of a camera of so many bits in the upper bits of 16: the scale is the same for all cameras.

    Nothing is lost, and no pixel decides about the others.
    """
    return np.left_shift(levels, 16 - bits)


def guessed_bits(levels: NDArray[np.uint16]) -> int:
    """Depth of levels whose camera is not known: the smallest of `DEPTHS` that holds them all."""
    brightest = int(levels.max(initial=0))
    return next(bits for bits in DEPTHS if brightest < 1 << bits)


class Robot(Protocol):
    """A robot that tells where its flange is."""

    def read_flange(self, timeout_s: float) -> FlangeReading:
        """Block for a sample newer than the last one.

        Raises DeviceUnavailable after `timeout_s` or on a lost link, BadReading for one bad sample.
        """
        ...

    def close(self) -> None:
        """Release the link; may be called more than once."""
        ...


class Camera(Protocol):
    """A camera that takes one picture per trigger."""

    def grab(self, timeout_s: float, region: Region | None = None) -> CameraImage:
        """Trigger, and return a picture exposed after the call.

        region: what is wanted of it, at least; a camera without such a mode returns the whole picture.

        Raises DeviceUnavailable after `timeout_s` or on a lost link, BadReading for an incomplete picture.
        """
        ...

    def close(self) -> None:
        """Release the camera; may be called more than once."""
        ...


class Pedal(Protocol):
    """Something that an operator presses while both hands are at the robot."""

    def wait_press(self, timeout_s: float) -> float | None:
        """Block for a press; the time of it (cell clock), None when there was none within `timeout_s`.

        Raises DeviceUnavailable on a lost link.
        """
        ...

    def close(self) -> None:
        """Release the pedal; may be called more than once."""
        ...


@dataclass(frozen=True, slots=True)
class Setting:
    """A key of a driver's settings, as people write it; type: "float", "list of float" and so on."""

    key: str
    type: str
    is_required: bool
    default: object
    meaning: str


@dataclass(frozen=True, slots=True)
class SettingRemark:
    """What is wrong with a setting, or only odd, with the remedy."""

    key: str
    message: str
    is_fault: bool = True


@dataclass(frozen=True, slots=True)
class DriverCard:
    """What a driver is, told without loading what it drives devices with.

    extra: of vgrd that brings its library, "" where vgrd itself does. remarks: on a table of settings, no device
    is opened. trouble: why its library cannot be used on this machine, "" where it can.
    """

    kind: Literal["robot", "camera", "pedal"]
    meaning: str
    extra: str
    settings: tuple[Setting, ...]
    remarks: Callable[[Settings], list[SettingRemark]]
    trouble: Callable[[], str]
