"""The drivers there are and their settings, told without loading what they drive devices with.

`DRIVERS` is what `vgrd check` and `vgrd drivers` read; each driver takes its settings from here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from drivers.settings import OPEN_TIMEOUT_S, host_remark, keys_of, remarks_on
from vgrd.devices import SLOWEST_ROBOT_HZ, DriverCard, SettingRemark
from vgrd.errors import ConfigError, DeviceRefused

FASTEST_HZ = 500.0  # of RTDE: e-Series; CB3 sends 125
_LONGEST_MS = 2000.0  # as GRAB_TIMEOUT_S of the device's process: a picture takes no longer
_LARGEST_PACKET = 0xFFFF  # bytes: GigE Vision keeps the size of a packet in 16 bits
# Gray, and not packed: one or two bytes a pixel, as the drivers read a picture.
_PIXEL_FORMATS = ("Mono8", "Mono10", "Mono12", "Mono14", "Mono16")
_PARITIES = ("N", "E", "O")  # those of Modbus over serial lines
_OFFSET_NUMBERS = 6  # x y z and a rotation vector
_SLOWEST_BAUD = 50  # the slowest that serial ports know


@dataclass(frozen=True, slots=True)
class UrSettings:
    """Universal Robots: address of the controller, rate of both sessions, time limit of `open`."""

    host: Annotated[str, "address of the controller"]
    frequency_hz: Annotated[float, "readings a second; CB3 has 125, e-Series up to 500"] = (
        125.0  # what CB3 and e-Series both send
    )
    timeout_s: Annotated[float, "time limit of connecting"] = OPEN_TIMEOUT_S

    def remarks(self) -> Iterator[SettingRemark]:
        """As `drivers.settings`."""
        yield from host_remark("host", self.host)
        yield from _timeout_remark(self.timeout_s)
        if not SLOWEST_ROBOT_HZ <= self.frequency_hz <= FASTEST_HZ:
            limits = f"{SLOWEST_ROBOT_HZ:g} .. {FASTEST_HZ:g}"
            yield SettingRemark("frequency_hz", f"must be in {limits}, is {self.frequency_hz:g}")


@dataclass(frozen=True, slots=True)
class ModbusSettings:
    """Robots that show their pose by Modbus: on the network (host) or at a serial port (8 data bits, 1 stop bit)."""

    profile: Annotated[str, "a name in config/robots, or the path of a TOML file"]
    host: Annotated[str | None, "of a robot on the network (Modbus TCP)"] = None
    port: Annotated[int | None, "of Modbus TCP; the profile's if left out"] = None
    serial_port: Annotated[str | None, "path of the port of a robot with Modbus RTU"] = None
    baud: Annotated[int, "of the serial port"] = (
        115200  # what robots' serial ports are set to by default, where they have one
    )
    parity: Annotated[str, "of the serial port: N, E or O"] = "N"
    unit: Annotated[int | None, "Modbus unit id; the profile's if left out"] = None
    tcp_offset: Annotated[
        tuple[float, ...] | None,
        "x y z (mm) and rotation vector (rad) of the active TCP, for robots that do not show it",
    ] = None
    timeout_s: Annotated[float, "time limit of connecting"] = OPEN_TIMEOUT_S

    def remarks(self) -> Iterator[SettingRemark]:
        """As `drivers.settings`."""
        if (self.host is None) == (self.serial_port is None):
            key = "host" if self.host is None else "serial_port"
            words = "give host (Modbus TCP) or serial_port (Modbus RTU), one of them"
            yield SettingRemark(key, words)
        if self.serial_port is not None and self.port is not None:
            yield SettingRemark("port", "of Modbus TCP; a serial port is named by serial_port")
        yield from host_remark("host", self.host)
        yield from _port_remark(self.serial_port)
        if self.parity not in _PARITIES:
            yield SettingRemark("parity", f"{self.parity!r} is none of {', '.join(_PARITIES)}")
        yield from _baud_remark(self.baud)
        yield from _timeout_remark(self.timeout_s)
        yield from self._offset_remarks()
        yield from self._profile_remarks()

    def _offset_remarks(self) -> Iterator[SettingRemark]:
        values = self.tcp_offset
        if values is None:
            return
        if len(values) != _OFFSET_NUMBERS:
            words = (
                f"expected {_OFFSET_NUMBERS} numbers, got {len(values)}: x y z (mm) rx ry rz (rad)"
            )
            yield SettingRemark("tcp_offset", words)
        elif any(values[:3]) and max(map(abs, values[:3])) < 1.0:
            words = f"x y z are {list(values[:3])}, all below 1 mm: in metres? Write them in mm"
            yield SettingRemark("tcp_offset", words, is_fault=False)

    def _profile_remarks(self) -> Iterator[SettingRemark]:
        from drivers.robot_profile import load

        try:
            profile = load(self.profile)
        except ConfigError as error:
            yield SettingRemark("profile", f"{error.source}: {'; '.join(error.faults)}")
            return
        if self.profile.endswith(".toml") and not Path(self.profile).is_absolute():
            words = "a relative path counts from where the daemon is started: write the whole path"
            yield SettingRemark("profile", words, is_fault=False)
        if profile.frame == "tcp" and profile.tcp_block is None and self.tcp_offset is None:
            yield SettingRemark(
                "tcp_offset",
                f"{profile.name} shows the pose of its TCP and not the TCP's offset: give tcp_offset "
                "= [x, y, z, rx, ry, rz] (mm, rotation vector in rad) in the robot's settings",
            )


@dataclass(frozen=True, slots=True)
class AravisSettings:
    """A GenICam camera; None leaves what the camera has."""

    address: Annotated[
        str,
        "IP address (not a name: names need discovery) or the id of a USB camera",
    ]
    serial: Annotated[str | None, "what the camera must have: another one is not taken for it"] = (
        None
    )
    exposure_ms: Annotated[float | None, "exposure time"] = None
    gain_db: Annotated[float | None, "gain"] = None
    pixel_format: Annotated[str, "Mono8, or an unpacked Mono10, Mono12, Mono14, Mono16"] = "Mono8"
    packet_bytes: Annotated[int | None, "size of a GigE packet, up to the network's MTU"] = None

    def remarks(self) -> Iterator[SettingRemark]:
        """As `drivers.settings`."""
        yield from host_remark("address", self.address)
        yield from _camera_remarks(self)


@dataclass(frozen=True, slots=True)
class PylonSettings:
    """A Basler camera, by its serial number or its address; None leaves what the camera has."""

    serial: Annotated[str | None, "serial number of the camera"] = None
    address: Annotated[str | None, "IP address of a GigE camera"] = None
    exposure_ms: Annotated[float | None, "exposure time"] = None
    gain_db: Annotated[float | None, "gain"] = None
    pixel_format: Annotated[str, "Mono8, or an unpacked Mono10, Mono12, Mono14, Mono16"] = "Mono8"
    packet_bytes: Annotated[int | None, "size of a GigE packet, up to the network's MTU"] = None

    def remarks(self) -> Iterator[SettingRemark]:
        """As `drivers.settings`."""
        yield from host_remark("address", self.address)
        if self.serial is None and self.address is None:
            words = (
                "neither it nor address is given: the first Basler camera that is found is taken"
            )
            yield SettingRemark("serial", words, is_fault=False)
        yield from _camera_remarks(self)


@dataclass(frozen=True, slots=True)
class PedalSettings:
    """A pedal, foot switch or button on a serial port."""

    serial_port: Annotated[str, "path of the port"]
    baud: Annotated[int, "bits per second"] = 9600  # what such switches come with
    quiet_s: Annotated[float, "shortest time from one press to the next"] = (
        0.3  # chosen: contacts bounce for 20 ms, nobody treads twice so fast
    )

    def remarks(self) -> Iterator[SettingRemark]:
        """As `drivers.settings`."""
        yield from _port_remark(self.serial_port)
        yield from _baud_remark(self.baud)
        if not self.quiet_s >= 0:
            yield SettingRemark("quiet_s", "0 or more seconds are needed")


def _timeout_remark(timeout_s: float) -> Iterator[SettingRemark]:
    if not timeout_s > 0:
        yield SettingRemark("timeout_s", f"{timeout_s:g} s: give more than 0")


def _baud_remark(baud: int) -> Iterator[SettingRemark]:
    if baud < _SLOWEST_BAUD:
        yield SettingRemark("baud", f"{baud} bits per second: {_SLOWEST_BAUD} or more are needed")


def _port_remark(path: str | None) -> Iterator[SettingRemark]:
    if path is not None and not Path(path).exists():
        words = f"there is no {path} now: plug it in, or name the port under /dev/serial/by-id"
        yield SettingRemark("serial_port", words, is_fault=False)


def _camera_remarks(options: AravisSettings | PylonSettings) -> Iterator[SettingRemark]:
    exposure_ms = options.exposure_ms
    if exposure_ms is not None and not 0 < exposure_ms < _LONGEST_MS:
        yield SettingRemark(
            "exposure_ms",
            f"{exposure_ms:g} ms: a picture takes more than 0 and less than {_LONGEST_MS:g} ms; in "
            f"microseconds? Write {exposure_ms / 1000:g}",
        )
    if options.pixel_format not in _PIXEL_FORMATS:
        words = f"{options.pixel_format!r}: take one of {', '.join(_PIXEL_FORMATS)}"
        yield SettingRemark("pixel_format", words)
    packet = options.packet_bytes
    if packet is not None and not 0 < packet <= _LARGEST_PACKET:
        yield SettingRemark("packet_bytes", f"{packet}: a packet has 1 to {_LARGEST_PACKET} bytes")


def _no_module(library: str, extra: str) -> str:
    if find_spec(library) is not None:
        return ""
    return f"{library} is not installed: pip install {f'vgrd[{extra}]' if extra else library}"


def _no_aravis() -> str:
    from drivers import aravis_library

    try:
        aravis_library.load()
    except DeviceRefused as error:
        return str(error)
    return ""


def _card(
    kind: Literal["robot", "camera", "pedal"],
    meaning: str,
    settings: type,
    trouble: Callable[[], str],
    extra: str = "",
) -> DriverCard:
    return DriverCard(
        kind, meaning, extra, keys_of(settings), partial(remarks_on, settings), trouble
    )


DRIVERS = {
    "ur_rtde": _card(
        "robot",
        "Universal Robots, CB3 and e-Series, through RTDE",
        UrSettings,
        partial(_no_module, "rtde_receive", ""),
    ),
    "modbus_robot": _card(
        "robot",
        "robots that show their pose in registers of their own Modbus server, by a profile",
        ModbusSettings,
        partial(_no_module, "pymodbus", ""),
    ),
    "aravis": _card(
        "camera",
        "GenICam cameras (GigE Vision, USB3 Vision) through Aravis",
        AravisSettings,
        _no_aravis,
        "cameras",
    ),
    "pylon": _card(
        "camera",
        "Basler cameras through pylon",
        PylonSettings,
        partial(_no_module, "pypylon", "cameras"),
        "cameras",
    ),
    "serial_pedal": _card(
        "pedal",
        "a pedal, foot switch or button on a serial port",
        PedalSettings,
        partial(_no_module, "serial", ""),
    ),
}
