"""From an answer to registers: the coordinate while it holds, sentinels for everything else.

The cell publishes a `RegisterImage`; `view` is what a client may read of it at one moment. Pure,
so that the safety rule can be tested: no pose leaves `view` unless the image is younger than the
deadline, nothing is pending, the status is OK, and the answer has not expired.
"""

import math
import struct
from dataclasses import dataclass, replace
from typing import Final, Self

from vgrd.errors import IpcError
from vgrd.registers.codes import Frame, RotationFormat, Scale16, State, Status
from vgrd.registers.layout import MAP_VERSION, encode_response
from vgrd.registers.request import NOTHING_ASKED, Request

REGISTER_RING: Final = "registers.ring"
REGISTER_KIND: Final = "registers"
AGE_STEP_S: Final = 0.01
UNKNOWN16: Final = 0xFFFF

_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
_I16, _I32 = 0x7FFF, 0x7FFFFFFF
_PACKED = struct.Struct("<8H2I3Bx3iIHxx6d2Q")
_CELL_BITS = ~(State.BUSY | State.VALID | State.ERROR | State.DEGRADED)
_NO_ERROR = (Status.IDLE, Status.OK, Status.OK_DEGRADED, Status.BUSY)
_UNITS16: Final = {  # um per step, steps per rad
    Scale16.MRAD: (100.0, 1e3),
    Scale16.CENTIDEGREE: (100.0, 100.0 * 180.0 / math.pi),
    Scale16.FINE: (50.0, 1e4),
}


@dataclass(frozen=True, slots=True)
class Answer:
    """What the cell found out, for one request or for the continuous point (nonce and echo 0).

    nonce, echo, point, object: of the request, by `reply`. captured_s, valid_until_s: cell clock
    (monotonic). rotation: in `rotation_format`, rad for a rotation vector, degrees otherwise. seq
    counts the answers of this run of the cell.
    """

    status: Status = Status.IDLE
    echo: int = 0
    seq: int = 0
    nonce: int = 0
    detail: int = 0
    point: int = 0
    object: int = 0
    captured_s: float = math.nan
    captured_unix_us: int = 0
    valid_until_s: float = 0.0
    position_um: tuple[int, int, int] = (0, 0, 0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    u95_um: int = _I32
    u95_rot_10urad: int = UNKNOWN16
    tags: int = 0
    calibration_id: int = 0
    rotation_format: RotationFormat = RotationFormat.ROTVEC
    frame: Frame = Frame.FLANGE
    scale: Scale16 = Scale16.MRAD


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
                *(a.rotation_format, a.frame, a.scale),
                *(*a.position_um, min(a.u95_um, _I32), min(a.u95_rot_10urad, UNKNOWN16)),
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
                rotation_format=RotationFormat(v[10]),
                frame=Frame(v[11]),
                scale=Scale16(v[12]),
                position_um=(v[13], v[14], v[15]),
                u95_um=v[16],
                u95_rot_10urad=v[17],
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


@dataclass(frozen=True, slots=True)
class View:
    """What a client may read until `good_until_s`: 136 bytes from 100 on, and from 300 on."""

    response: bytes
    swapped: bytes
    state: State
    beat: int
    good_until_s: float

    @property
    def valid(self) -> bool:
        """True when the registers hold a coordinate."""
        return bool(self.state & State.VALID)


def view(
    image: RegisterImage | None,
    now_s: float,
    pending: Request | None = None,
    *,
    deadline_s: float,
    answered: Request | None = None,
    refusal: Answer | None = None,
) -> View:
    """Return the registers at `now_s`.

    image: the newest of the cell, None before its first. pending: the request not yet answered.
    answered: the last request, whose answer of the cell stands. refusal: what the gate itself
    answered in place of the cell; it never holds a coordinate.
    """
    alive = image is not None and abs(now_s - image.published_s) < deadline_s
    answer = _shown(image if alive else None, image is not None, pending, answered, refusal)
    if answer.status.is_ok:
        answer = _judged(answer, now_s)
    valid = answer.status.is_ok
    state, beat = _live(image, alive=alive, status=answer.status)
    response, swapped = encode_response(_values(answer, now_s, state, beat, valid=valid))
    until = [math.inf]
    if image is not None and alive:
        until.append(image.published_s + deadline_s)
    if valid:
        until.append(answer.valid_until_s)
    if _age_ms(answer, now_s) < UNKNOWN16:
        until.append(now_s + AGE_STEP_S)
    return View(response, swapped, state, beat, min(until))


def _shown(
    image: RegisterImage | None,
    lived: bool,
    pending: Request | None,
    answered: Request | None,
    refusal: Answer | None,
) -> Answer:
    """Choose the answer to show; `image` is None when the cell does not live."""
    if refusal is not None and (image is not None or refusal.status is not Status.IDLE):
        status = Status.INTERNAL_ERROR if refusal.status.is_ok else refusal.status
        return replace(refusal, status=status)
    asked = pending or NOTHING_ASKED
    if image is None:
        status = Status.INTERNAL_ERROR if lived else Status.STARTING
        echo = refusal.echo if refusal else asked.trig
        return Answer(status, echo=echo, point=asked.point, object=asked.object)
    if pending is not None:
        return replace(reply(pending, Status.BUSY), echo=0, seq=image.answer.seq)
    return _matched(image.answer, answered)


def _matched(answer: Answer, answered: Request | None) -> Answer:
    """`answer` if it is to the request `answered` or to nobody's, else one that says nothing.

    The nonce decides: TRIG comes back every 65,535 requests at the latest, and with another POINT.
    """
    if not answer.nonce and not answer.echo:
        return answer
    if answered is None or not answer.nonce or answer.nonce != answered.nonce:
        return Answer(seq=answer.seq)
    asked = reply(answered, Status.INTERNAL_ERROR)
    if (answer.echo, answer.point, answer.object) != (asked.echo, asked.point, asked.object):
        return replace(asked, seq=answer.seq)
    return answer


def _judged(answer: Answer, now_s: float) -> Answer:
    """Turn an OK answer that may not be served into the refusal that says why."""
    if not all(map(math.isfinite, (answer.captured_s, answer.valid_until_s, *answer.rotation))):
        return replace(answer, status=Status.INTERNAL_ERROR)
    if not now_s < answer.valid_until_s:
        return replace(answer, status=Status.IMAGE_TOO_OLD)
    for axis, value in enumerate(_steps16(answer), start=1):
        if abs(value) > _I16:
            return replace(answer, status=Status.ENCODING_OVERFLOW, detail=axis)
    if any(abs(value) > _I32 for value in _steps32(answer)):
        return replace(answer, status=Status.ENCODING_OVERFLOW)
    return answer


def _live(image: RegisterImage | None, *, alive: bool, status: Status) -> tuple[State, int]:
    """STATE and HB: a lost cell leaves its last beat and only the simulation bit."""
    state, beat = (image.state, image.beat) if image else (State(0), 0)
    state &= _CELL_BITS if alive else State.SIMULATION
    if status.is_ok:
        state |= State.VALID
    if status == Status.OK_DEGRADED:
        state |= State.DEGRADED
    if status == Status.BUSY:
        state |= State.BUSY
    if status not in _NO_ERROR:
        state |= State.ERROR
    return state, beat & UNKNOWN16


def _values(
    answer: Answer, now_s: float, state: State, beat: int, *, valid: bool
) -> dict[str, float]:
    seq = (2 * answer.seq + (not valid)) & UNKNOWN16
    values: dict[str, float] = {
        "MAPVER": MAP_VERSION,
        "HB": beat,
        "STATE": state,
        "ECHO": answer.echo,
        "STATUS": answer.status,
        "DETAIL": answer.detail,
        "POINT": answer.point,
        "AGE": _age_ms(answer, now_s),
        "U95P": min(answer.u95_um, UNKNOWN16) if valid else UNKNOWN16,
        "U95R": min(answer.u95_rot_10urad, UNKNOWN16) if valid else UNKNOWN16,
        "NTAG": answer.tags,
        "CALID": answer.calibration_id,
        "OBJECT": answer.object,
        "FMT": answer.rotation_format | answer.frame << 4 | answer.scale << 8,
        "TCAP": answer.captured_unix_us,
        "SEQ": seq,
        "EC32_U95": min(answer.u95_um, _I32) if valid else -_I32 - 1,
        "ECF_U95": answer.u95_um / 1000 if valid else math.nan,
    }
    for block in ("EC16", "EC32", "ECF"):
        values |= {f"{block}_ECHO": answer.echo, f"{block}_STATUS": answer.status}
        values[f"{block}_SEQ"] = seq
    floats = (*(um / 1000 for um in answer.position_um), *answer.rotation)
    coordinate = (
        zip(_AXES, _steps16(answer), _steps32(answer), floats, strict=True)
        if valid
        else ((axis, -_I16 - 1, -_I32 - 1, math.nan) for axis in _AXES)
    )
    for axis, step16, step32, number in coordinate:
        values[f"EC16_{axis}"], values[f"EC32_{axis}"] = step16, step32
        values[f"ECF_{axis}"] = number
    return values


def _steps16(answer: Answer) -> list[int]:
    um, per_rad = _UNITS16[answer.scale]
    rotvec = answer.rotation_format == RotationFormat.ROTVEC
    angles = answer.rotation if rotvec else tuple(map(math.radians, answer.rotation))
    return [round(p / um) for p in answer.position_um] + [round(a * per_rad) for a in angles]


def _steps32(answer: Answer) -> list[int]:
    unit = 1e6 if answer.rotation_format == RotationFormat.ROTVEC else 1e4
    return [*answer.position_um, *(round(a * unit) for a in answer.rotation)]


def _age_ms(answer: Answer, now_s: float) -> int:
    if not math.isfinite(answer.captured_s):
        return UNKNOWN16
    age_ms = (now_s - answer.captured_s) * 1000
    return math.ceil(min(max(age_ms, 0), UNKNOWN16))
