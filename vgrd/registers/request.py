"""What the robot asks for, read from registers 0-31, and how the gate hands it to the cell."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

from vgrd.errors import IpcError
from vgrd.registers.codes import PolicyCode, RotationCode
from vgrd.registers.layout import REQUEST

_OPTIONS: Final = 0b0011_1111_0011  # policy, rotation format, TCP, refuse if moving


@dataclass(frozen=True, slots=True)
class Request:
    """A request as written; the numbers are not judged, except that they have a type.

    nonce: the gate's number of this very request, which its answer carries back; 0 means that no
    gate gave it. request_orientation: ORI_RX to ORI_RZ, how the wrist will stand, in the format of
    OPT: rad or deg. orientation_written: whether that was written since the TRIG before.
    """

    registers: bytes
    nonce: int
    trig: int
    command: int
    point: int
    options: int
    robot: int
    object: int
    tool: int
    max_age_s: float
    max_u95_um: int
    timeout_s: float
    request_orientation: tuple[float, float, float]
    orientation_written: bool

    @classmethod
    def parse(cls, registers: bytes, nonce: int = 0, *, orientation_written: bool = False) -> Self:
        """Read the 64 bytes of registers 0-31."""
        v = REQUEST.decode(registers)
        options = int(v["OPT"])
        unit = 1e-6 if (options >> 4) & 15 == RotationCode.ROTVEC else 1e-4
        return cls(
            registers=registers,
            nonce=nonce,
            trig=int(v["TRIG"]),
            command=int(v["CMD"]),
            point=int(v["POINT"]),
            options=options,
            robot=int(v["ROBOT"]),
            object=int(v["OBJECT"]),
            tool=int(v["TOOL"]),
            max_age_s=v["MAXAGE"] / 1000,
            max_u95_um=int(v["MAXU95"]),
            timeout_s=v["TMO"] / 1000,
            request_orientation=(v["ORI_RX"] * unit, v["ORI_RY"] * unit, v["ORI_RZ"] * unit),
            orientation_written=orientation_written,
        )

    @property
    def refuse_if_moving(self) -> bool:
        """OPT b0."""
        return bool(self.options & 1)

    @property
    def wants_tcp(self) -> bool:
        """OPT b1: the TCP pose instead of the flange."""
        return bool(self.options & 2)

    @property
    def unknown_options(self) -> int:
        """Bits of OPT that have no meaning."""
        return self.options & ~_OPTIONS

    @property
    def reserved_register(self) -> int | None:
        """Address of the first reserved register that is not 0, None when all are 0."""
        words = struct.unpack(f">{len(self.registers) // 2}H", self.registers)
        return next((address for address in REQUEST.reserved if words[address]), None)

    @property
    def rotation_format(self) -> RotationCode | None:
        """OPT b4-7, None when unknown."""
        code = (self.options >> 4) & 15
        return RotationCode(code) if code in list(RotationCode) else None

    @property
    def policy(self) -> PolicyCode:
        """OPT b8-9."""
        return PolicyCode((self.options >> 8) & 3)


def request_message(request: Request) -> dict[str, object]:
    """What goes over the link from the gate to the cell."""
    return {
        "op": "request",
        "nonce": request.nonce,
        "orientation_written": request.orientation_written,
        "registers": request.registers.hex(),
    }


def parse_message(message: Mapping[str, object]) -> Request:
    """Inverse of `request_message`. Raises IpcError when it is no request."""
    nonce, registers = message.get("nonce"), message.get("registers")
    written = message.get("orientation_written")
    try:
        block = bytes.fromhex(registers) if isinstance(registers, str) else b""
    except ValueError:
        block = b""
    whole = len(block) == 2 * REQUEST.end
    if not (whole and isinstance(nonce, int) and isinstance(written, bool)):
        raise IpcError(f"not a request of the gate: {dict(message)}")
    return Request.parse(block, nonce, orientation_written=written)


NOTHING_ASKED = Request.parse(bytes(64))  # 32 registers of two bytes
