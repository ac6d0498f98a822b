"""What the cell hands to the gate: one immutable image of its answer and its live state."""

import math
import struct
from dataclasses import dataclass
from typing import Final, Self

from vgrd.errors import IpcError
from vgrd.registers.codes import Frame, RotationCode, State, Status
from vgrd.registers.request import Request

REGISTER_RING: Final = "registers.ring"
REGISTER_KIND: Final = "registers"
UNKNOWN16: Final = 0xFFFF  # the largest u16: more, or unknown
LARGEST32: Final = 0x7FFFFFFF  # the largest i32; the smallest is the sentinel

_PACKED = struct.Struct("<8H2I2Bxx3qI2H6d2Q")


@dataclass(frozen=True, slots=True)
class Answer:
    """What the cell found out, for one request or for the continuous point (nonce and echo 0).

    nonce, echo, point, object: of the request, by `reply`. captured_s, valid_until_s: cell clock
    (monotonic). moved_um: how far the link that moved is off, 0 where none is. rotation: in
    `rotation_format`, rad for a rotation vector, degrees otherwise. seq counts the answers of this run
    of the cell, from a random start.
    """

    status: Status = Status.IDLE
    echo: int = 0
    seq: int = 0
    nonce: int = 0
    detail: int = 0
    moved_um: int = 0
    point: int = 0
    object: int = 0
    captured_s: float = math.nan
    captured_unix_us: int = 0
    valid_until_s: float = 0.0
    position_um: tuple[int, int, int] = (0, 0, 0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    u95_um: int = LARGEST32
    u95_rot_10urad: int = UNKNOWN16
    tags: int = 0
    calibration_id: int = 0
    rotation_format: RotationCode = RotationCode.ROTVEC
    frame: Frame = Frame.FLANGE


def reply(request: Request, status: Status, detail: int = 0) -> Answer:
    """Return the answer to `request` that holds no coordinate; every other is made of it."""
    return Answer(
        status,
        echo=request.trig,
        nonce=request.nonce,
        detail=detail,
        point=request.point,
        object=request.object,
    )


@dataclass(frozen=True, slots=True)
class RegisterImage:
    """Answer and live state of the cell, published by it at least every 50 ms.

    beat: counts 100 ms steps of the measuring loop. state: all bits but BUSY, VALID, ERROR and
    DEGRADED, which `view` sets.
    """

    answer: Answer
    state: State
    beat: int
    published_s: float

    def pack(self) -> bytes:
        """Bytes for the ring, of constant length. Raises IpcError for a number out of range."""
        a = self.answer
        try:
            return _PACKED.pack(
                *(a.status, a.echo, a.seq & UNKNOWN16, a.detail, a.point, a.object, a.tags),
                *(self.beat & UNKNOWN16, self.state, a.calibration_id),
                *(a.rotation_format, a.frame),
                *(*a.position_um, min(a.u95_um, LARGEST32), min(a.u95_rot_10urad, UNKNOWN16)),
                min(a.moved_um, UNKNOWN16),
                *(self.published_s, a.captured_s, a.valid_until_s, *a.rotation),
                *(a.captured_unix_us, a.nonce),
            )
        except struct.error as error:
            raise IpcError(f"register image cannot be sent: {error}: {self}") from error

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Inverse of `pack`. Raises IpcError when it is no register image."""
        try:
            v = _PACKED.unpack(payload)
            answer = Answer(
                status=Status(v[0]),
                echo=v[1],
                seq=v[2],
                detail=v[3],
                point=v[4],
                object=v[5],
                tags=v[6],
                calibration_id=v[9],
                rotation_format=RotationCode(v[10]),
                frame=Frame(v[11]),
                position_um=(v[12], v[13], v[14]),
                u95_um=v[15],
                u95_rot_10urad=v[16],
                moved_um=v[17],
                captured_s=v[19],
                valid_until_s=v[20],
                rotation=(v[21], v[22], v[23]),
                captured_unix_us=v[24],
                nonce=v[25],
            )
        except (struct.error, ValueError) as error:
            raise IpcError(f"not a register image: {error}") from error
        return cls(answer=answer, beat=v[7], state=State(v[8]), published_s=v[18])


PACKED_BYTES: Final = _PACKED.size
