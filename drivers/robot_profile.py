"""How a robot's own Modbus server shows its pose: a TOML file in `config/robots`, one per brand."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
from pymodbus.client.mixin import ModbusClientMixin

from drivers import settings as driver_settings
from vgrd.devices import SLOWEST_ROBOT_HZ
from vgrd.errors import BadReading, ConfigError, InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.rotation_formats import RotationFormat, rotation_from, rotation_to, value_count

FOLDER = Path(__file__).resolve().parent.parent / "config" / "robots"
_DATA = ModbusClientMixin.DATATYPE


class _Layout(NamedTuple):
    """How one number stands in registers; sign_bit: of sign and magnitude, None of two's complement and IEEE 754."""

    kind: ModbusClientMixin.DATATYPE
    words: int
    sign_bit: int | None = None

    @property
    def is_float(self) -> bool:
        """Whether numbers have no step."""
        return self.kind in (_DATA.FLOAT32, _DATA.FLOAT64)


_LAYOUTS = {
    "int16": _Layout(_DATA.INT16, 1),
    "uint16": _Layout(_DATA.UINT16, 1),
    "int32": _Layout(_DATA.INT32, 2),
    "float32": _Layout(_DATA.FLOAT32, 2),
    "float64": _Layout(_DATA.FLOAT64, 4),
    "sign_magnitude16": _Layout(_DATA.UINT16, 1, sign_bit=15),
    "sign_magnitude32": _Layout(_DATA.UINT32, 2, sign_bit=31),
}
_TURN_DEG = (
    360.0  # no pose has a larger angle: what is beyond it was read in another layout or unit
)
_FARTHEST_MM = 20_000.0  # no arm reaches farther, on a rail neither
_MOST_REGISTERS = 125  # of one request: Modbus Application Protocol V1.1b3, 6.3
_STEP_PER_SIGMA = math.sqrt(12.0)  # rounding: uniform over one step
_POSE_NUMBERS = 6  # x y z and three numbers of the rotation


@dataclass(frozen=True, slots=True)
class RegisterRange:
    """Registers that follow each other: `address` .. `address + count - 1`."""

    address: int
    count: int

    @property
    def end(self) -> int:
        """First address behind it."""
        return self.address + self.count


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotProfile:
    """One brand's registers.

    function: 3 or 4. layout: int16, uint16, int32, float32, float64, or sign_magnitude16 and 32 (the highest
    bit is the sign, the others the magnitude); word_order: "big" is high word first.
    mm_per_count, rotation_per_count: value of one count, the latter in the unit of the `rotation`
    format. frame: "tcp" or "flange". The rotation follows the position unless rotation_address
    says otherwise. What tells the TCP: tcp_offset_address (a pose in the flange, perhaps with a
    format of its own) or tcp_pose_address (the TCP in the base, beside a flange). one_read: the
    registers in between are documented too. update_period_s: how often the robot refreshes them.
    """

    name: str
    port: int
    unit: int
    function: int
    layout: str
    mm_per_count: float
    rotation: str
    rotation_per_count: float
    frame: str
    pose_address: int
    word_order: str = "big"
    rotation_address: int | None = None
    tcp_offset_address: int | None = None
    tcp_offset_rotation: str | None = None
    tcp_pose_address: int | None = None
    one_read: bool = False
    update_period_s: float = 0.0

    def flange_steps(self, wrist_from_tcp: Pose | None) -> tuple[float, float]:
        """Steps in which the robot tells the flange (mm per axis, rad per angle); 0 for floats.

        Where the TCP is shown, a step of a rotation moves the flange by the length of the tool.
        """
        sigma_mm, sigma_rad = self.position_sigma_mm, self.rotation_sigma_rad
        tool = wrist_from_tcp if self.frame == "tcp" else None
        lever_mm = 0.0 if tool is None else float(np.linalg.norm(tool.translation))
        step_mm, step_rad = _STEP_PER_SIGMA * sigma_mm, _STEP_PER_SIGMA * sigma_rad
        return step_mm + lever_mm * step_rad, step_rad

    @property
    def position_sigma_mm(self) -> float:
        """Standard deviation per axis of the rounding to counts, mm; 0 for floats."""
        return 0.0 if _LAYOUTS[self.layout].is_float else self.mm_per_count / _STEP_PER_SIGMA

    @property
    def rotation_sigma_rad(self) -> float:
        """Standard deviation per axis of the rounding to counts, rad; 0 for floats."""
        if _LAYOUTS[self.layout].is_float:
            return 0.0
        degrees = self.rotation.endswith("-deg")
        step = math.radians(self.rotation_per_count) if degrees else self.rotation_per_count
        return step / _STEP_PER_SIGMA

    @property
    def pose_block(self) -> RegisterRange:
        """Registers of position and rotation."""
        position, rotation = self._pose_parts()
        first = min(position.address, rotation.address)
        return RegisterRange(first, max(position.end, rotation.end) - first)

    @property
    def tcp_block(self) -> RegisterRange | None:
        """Registers that tell the TCP, None where the robot does not tell."""
        for address in (self.tcp_offset_address, self.tcp_pose_address):
            if address is not None:
                return RegisterRange(address, self._words(_POSE_NUMBERS))
        return None

    @property
    def blocks(self) -> tuple[RegisterRange, ...]:
        """What has to be read, as few requests as the map allows."""
        pose, tcp = self.pose_block, self.tcp_block
        if tcp is None:
            return (pose,)
        first, end = min(pose.address, tcp.address), max(pose.end, tcp.end)
        touching = end - first == pose.count + tcp.count
        if (touching or self.one_read) and end - first <= _MOST_REGISTERS:
            return (RegisterRange(first, end - first),)
        return (pose, tcp)

    def decode(self, registers: dict[int, int]) -> tuple[Pose, Pose | None]:
        """Pose in the profile's frame and wrist_from_tcp (None where not told), mm.

        Raises BadReading when the registers hold no pose.
        """
        position, rotation = self._pose_parts()
        pose = self._pose(registers, position, rotation, RotationFormat(self.rotation))
        tcp = self.tcp_block
        if tcp is None:
            return pose, None
        parts = (
            RegisterRange(tcp.address, self._words(3)),
            RegisterRange(tcp.end - self._words(3), self._words(3)),
        )
        tcp_pose = self._pose(registers, *parts, self._tcp_format())
        is_offset = self.tcp_offset_address is not None
        return pose, tcp_pose if is_offset else pose.inverse() @ tcp_pose

    def encode(self, base_from_wrist: Pose, wrist_from_tcp: Pose) -> dict[int, int]:
        """Registers that a robot shows in this state; the inverse of `decode` up to rounding."""
        base_from_tcp = base_from_wrist @ wrist_from_tcp
        position, rotation = self._pose_parts()
        shown = base_from_tcp if self.frame == "tcp" else base_from_wrist
        registers = self._numbers(shown, position, rotation, RotationFormat(self.rotation))
        tcp = self.tcp_block
        if tcp is not None:
            tcp_pose = wrist_from_tcp if self.tcp_offset_address is not None else base_from_tcp
            half = self._words(3)
            parts = RegisterRange(tcp.address, half), RegisterRange(tcp.address + half, half)
            registers |= self._numbers(tcp_pose, *parts, self._tcp_format())
        return registers

    def _words(self, values: int) -> int:
        return _LAYOUTS[self.layout].words * values

    def _tcp_format(self) -> RotationFormat:
        return RotationFormat(self.tcp_offset_rotation or self.rotation)

    def _pose_parts(self) -> tuple[RegisterRange, RegisterRange]:
        position = RegisterRange(self.pose_address, self._words(3))
        address = self.rotation_address if self.rotation_address is not None else position.end
        return position, RegisterRange(address, self._words(3))

    def _pose(
        self,
        registers: dict[int, int],
        position: RegisterRange,
        rotation: RegisterRange,
        fmt: RotationFormat,
    ) -> Pose:
        mm = self.mm_per_count * self._values(registers, position)
        angles = self.rotation_per_count * self._values(registers, rotation)
        if not np.abs(mm).max() < _FARTHEST_MM:
            raise BadReading(
                f"{self.name}: position {mm.tolist()} mm; word order and units of the profile?"
            )
        largest = float(np.abs(angles).max())
        turn = _TURN_DEG if fmt.endswith("-deg") else math.radians(_TURN_DEG)
        if not largest <= turn + abs(self.rotation_per_count):
            raise BadReading(
                f"{self.name}: angles {angles.tolist()} beyond a turn; layout and rotation_per_count of the "
                "profile?"
            )
        try:
            return Pose(rotation_from(angles, fmt), mm)
        except InputError as error:
            raise BadReading(f"{self.name}: {error}") from error

    def _values(self, registers: dict[int, int], block: RegisterRange) -> Array:
        words = [registers[address] for address in range(block.address, block.end)]
        order = cast("Literal['big', 'little']", self.word_order)
        layout = _LAYOUTS[self.layout]
        values = ModbusClientMixin.convert_from_registers(words, layout.kind, order)
        if layout.sign_bit is None:
            return np.asarray(values, dtype=np.float64)
        raw = np.asarray(values, dtype=np.int64)
        sign = 1 << layout.sign_bit
        return np.asarray(np.where(raw & sign, -1.0, 1.0) * (raw & (sign - 1)))

    def _numbers(
        self, pose: Pose, position: RegisterRange, rotation: RegisterRange, fmt: RotationFormat
    ) -> dict[int, int]:
        angles = rotation_to(pose.rotation, fmt) / self.rotation_per_count
        return self._registers(position, pose.translation / self.mm_per_count) | self._registers(
            rotation, angles
        )

    def _registers(self, block: RegisterRange, values: Sequence[float] | Array) -> dict[int, int]:
        order = cast("Literal['big', 'little']", self.word_order)
        layout = _LAYOUTS[self.layout]
        words: list[int] = []
        for value in values:
            number = float(value) if layout.is_float else round(float(value))
            if layout.sign_bit is not None and number < 0:
                number = -int(number) | 1 << layout.sign_bit
            words += ModbusClientMixin.convert_to_registers(number, layout.kind, order)
        return dict(zip(range(block.address, block.end), words, strict=True))


def load(name: str) -> RobotProfile:
    """Read a profile: a name in `config/robots`, or the path of a TOML file.

    Raises ConfigError with all faults of the file.
    """
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        known = ", ".join(sorted(file.stem for file in FOLDER.glob("*.toml")))
        raise ConfigError(str(path), [f"no such robot profile; known: {known}"]) from error
    except (OSError, ValueError) as error:
        raise ConfigError(str(path), [f"cannot be read: {error}"]) from error
    profile = driver_settings.parse(RobotProfile, table, str(path))
    faults = _faults(profile)
    if faults:
        raise ConfigError(str(path), faults)
    return profile


def _faults(profile: RobotProfile) -> list[str]:
    choices = {
        "layout": tuple(_LAYOUTS),
        "word_order": ("big", "little"),
        "frame": ("tcp", "flange"),
        "function": (3, 4),
    }
    faults = [
        f"{key}: {getattr(profile, key)!r} is none of {', '.join(map(str, allowed))}"
        for key, allowed in choices.items()
        if getattr(profile, key) not in allowed
    ]
    formats = tuple(f.value for f in RotationFormat if value_count(f) == 3)
    for key in ("rotation", "tcp_offset_rotation"):
        if getattr(profile, key) not in (*formats, *((None,) if key != "rotation" else ())):
            faults.append(f"{key}: {getattr(profile, key)!r} is none of {', '.join(formats)}")
    if not 0.0 <= profile.update_period_s <= 1.0 / SLOWEST_ROBOT_HZ:
        longest_s = 1.0 / SLOWEST_ROBOT_HZ
        faults.append(f"update_period_s: 0 to {longest_s:g} s, slower robots hide moves")
    if profile.tcp_pose_address is not None and profile.frame != "flange":
        faults.append("tcp_pose_address: only beside a pose of the flange")
    return faults
