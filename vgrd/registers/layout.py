"""Every register of map v1, declared once: encoding, decoding and the documentation follow.

Words are big-endian on the wire. Values of two or four registers are high word first at 100-167
(ABCD) and low word first in the copy at 300-367 (CDAB).
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

Kind = Literal["u16", "i16", "u32", "i32", "f32", "u64"]

MAP_VERSION: Final = 0x0100  # 1.0, for programs to compare
SWAPPED_FROM: Final = 300  # clear of 100-167, which it copies; robots' programs hold it

_CODES: Final[dict[Kind, str]] = {
    "u16": "H",
    "i16": "h",
    "u32": "I",
    "i32": "i",
    "f32": "f",
    "u64": "Q",
}


@dataclass(frozen=True, slots=True)
class Field:
    """One value in the map: `address` is the 0-based address in the protocol."""

    name: str
    address: int
    kind: Kind
    meaning: str

    @property
    def count(self) -> int:
        """Number of registers."""
        return struct.calcsize(">" + _CODES[self.kind]) // 2


class Block:
    """Fields in the registers from `start` to before `end`; registers between fields are 0.

    reserved: addresses of the registers without a field.
    """

    def __init__(self, start: int, end: int, fields: Sequence[Field]) -> None:
        self.start, self.end, self.fields = start, end, tuple(fields)
        used = {at for field in fields for at in range(field.address, field.address + field.count)}
        self.reserved = tuple(at for at in range(start, end) if at not in used)
        self._struct = struct.Struct(self._format())
        self._words = struct.Struct(f">{end - start}H")
        self._swap = tuple(self._swapped_order())

    def registers(self, prefix: str) -> range:
        """Addresses of the fields whose names begin so; they follow each other."""
        fields = [field for field in self.fields if field.name.startswith(prefix)]
        return range(fields[0].address, fields[-1].address + fields[-1].count)

    def _format(self) -> str:
        codes, at = ">", self.start
        for field in self.fields:
            if field.address < at:
                raise ValueError(f"register {field.address}: {field.name} overlaps its neighbour")
            codes += "xx" * (field.address - at) + _CODES[field.kind]
            at = field.address + field.count
        return codes + "xx" * (self.end - at)

    def _swapped_order(self) -> list[int]:
        order = list(range(self.end - self.start))
        for field in self.fields:
            first = field.address - self.start
            order[first : first + field.count] = reversed(range(first, first + field.count))
        return order

    def encode(self, values: Mapping[str, float]) -> bytes:
        """Pack one value per field, 2 bytes a register. Raises struct.error out of range."""
        return self._struct.pack(*(values[field.name] for field in self.fields))

    def decode(self, registers: bytes) -> dict[str, float]:
        """Inverse of `encode`; integers stay integers."""
        names = (field.name for field in self.fields)
        return dict(zip(names, self._struct.unpack(registers), strict=True))

    def swapped(self, registers: bytes) -> bytes:
        """Turn high word first into low word first, or back."""
        words = self._words.unpack(registers)
        return self._words.pack(*(words[i] for i in self._swap))


def _axes(prefix: str, start: int, kind: Kind, position: str, rotation: str) -> list[Field]:
    step = 1 if kind == "i16" else 2
    names = [("X", position), ("Y", position), ("Z", position)]
    names += [("RX", rotation), ("RY", rotation), ("RZ", rotation)]
    return [
        Field(f"{prefix}_{axis}", start + step * i, kind, f"{axis} {unit}")
        for i, (axis, unit) in enumerate(names)
    ]


def _proof(prefix: str, start: int) -> list[Field]:
    return [
        Field(f"{prefix}_ECHO", start, "u16", "ECHO once more"),
        Field(f"{prefix}_STATUS", start + 1, "u16", "STATUS of this block"),
        Field(f"{prefix}_SEQ", start + 2, "u16", "SEQ of this block: even while it is valid"),
    ]


# CLHB is a field, so a value in it is never refused: it asks for nothing that anybody could miss,
# and programs that were written for the first map count there. Whatever else is written into a
# reserved register is a wish that nobody would fulfil; `Request.reserved_register` finds it.
REQUEST: Final = Block(  # addresses that robots' programs hold: part of map v1
    0,
    32,
    [
        Field("TRIG", 0, "u16", "a change to a non-zero value starts the request; 0 clears"),
        Field("CMD", 1, "u16", "command, see below"),
        Field("POINT", 2, "u16", "target point, 1-65535"),
        Field(
            "OPT",
            3,
            "u16",
            "b0 refuse if the robot moves, b1 return the TCP instead of the flange, b4-7 rotation "
            "format, b8-9 policy; any other bit: status 103 with DETAIL 3",
        ),
        Field("ROBOT", 4, "u16", "robot, 0 = default"),
        Field("OBJECT", 5, "u16", "object, 0 = default"),
        Field("TOOL", 6, "u16", "tool, 0 = default"),
        Field("MAXAGE", 7, "u16", "greatest age of the picture, ms, 0 = default"),
        Field("MAXU95", 8, "u16", "greatest uncertainty, um, 0 = default; beyond: status 504"),
        Field("TMO", 9, "u16", "ms until status 106, 0 = default"),
        Field("CLHB", 22, "u16", "reserved, write 0; not read, and nothing is refused for it"),
        Field("ORI_RX", 23, "i32", "policy 3: how the wrist will stand, urad or 0.0001 deg"),
        Field("ORI_RY", 25, "i32", "idem; all six registers 23-28 are written anew for each TRIG"),
        Field("ORI_RZ", 27, "i32", "idem"),
    ],
)

RESPONSE: Final = Block(  # idem
    100,
    168,
    [
        Field("MAPVER", 100, "u16", "version of this map, 0x0100"),
        Field("HB", 101, "u16", "+1 every 100 ms while the measuring loop lives"),
        Field("STATE", 102, "u16", "bits, see below"),
        Field("ECHO", 103, "u16", "the TRIG that was answered; 0 while BUSY"),
        Field("STATUS", 104, "u16", "code, see below"),
        Field("DETAIL", 105, "u16", "what STATUS is about, see below"),
        Field("POINT", 106, "u16", "the point that was asked for"),
        Field("AGE", 107, "u16", "ms from mid-exposure to now, runs on; 65535 = more or unknown"),
        Field("U95P", 108, "u16", "95 % uncertainty of the position, um; 65535 = more or unknown"),
        Field("U95R", 109, "u16", "95 % uncertainty of the rotation, 10 urad; 65535 idem"),
        Field("NTAG", 110, "u16", "tags used"),
        Field("CALID", 111, "u32", "calibration: first 4 bytes of its SHA-256"),
        Field("OBJECT", 113, "u16", "the object that was asked for"),
        Field("FMT", 114, "u16", "b0-3 rotation format, b4 frame, b8-15 units of the int16 block"),
        Field("TCAP", 115, "u64", "unix time of mid-exposure, us"),
        Field("SEQ", 119, "u16", "changes with every answer; even while it is valid"),
        *_axes("EC16", 120, "i16", "in the units of FMT", "in the units of FMT"),
        *_proof("EC16", 126),
        Field(
            "MOVED",
            129,
            "u16",
            "with STATUS 503: how far it moved, um, as DETAIL names it; else 0",
        ),
        *_axes("EC32", 130, "i32", "in um", "in urad (rotvec) or 0.0001 deg"),
        Field("EC32_U95", 142, "i32", "95 % uncertainty of the position, um"),
        *_proof("EC32", 144),
        Field("EC32_CRC", 147, "u32", "CRC-32 (zlib) over the bytes of 130-146 as read"),
        *_axes("ECF", 150, "f32", "in mm", "in rad (rotvec) or deg"),
        Field("ECF_U95", 162, "f32", "95 % uncertainty of the position, mm"),
        *_proof("ECF", 164),
    ],
)

_CRC_OVER: Final = slice(2 * (130 - RESPONSE.start), 2 * (147 - RESPONSE.start))
_CRC_AT: Final = slice(_CRC_OVER.stop, _CRC_OVER.stop + 4)


def encode_response(values: Mapping[str, float]) -> tuple[bytes, bytes]:
    """Both word orders of the response block, each with the CRC of its own int32 block."""
    block = RESPONSE.encode({**values, "EC32_CRC": 0})
    swapped = RESPONSE.swapped(block)
    crc = struct.pack(">I", crc_of(block))
    crc_swapped = struct.pack(">I", crc_of(swapped))
    return (
        block[: _CRC_AT.start] + crc + block[_CRC_AT.stop :],
        swapped[: _CRC_AT.start] + crc_swapped[2:] + crc_swapped[:2] + swapped[_CRC_AT.stop :],
    )


def crc_of(block: bytes) -> int:
    """CRC-32 that EC32_CRC of a response block, as read in either word order, must hold."""
    return zlib.crc32(block[_CRC_OVER])
