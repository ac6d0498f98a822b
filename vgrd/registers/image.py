"""From an answer to registers: the coordinate while it holds, sentinels for everything else.

The cell publishes a `RegisterImage`; `view` is what a client may read of it at one moment. Pure,
so that the safety rule can be tested: no pose leaves `view` unless the image is younger than the
deadline, nothing is pending, the status is OK, and the answer has not expired.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from vgrd.registers.answer import UNKNOWN16, Answer, RegisterImage, reply
from vgrd.registers.codes import Scale16, State, Status
from vgrd.registers.coordinates import coordinates, narrow_axis, sequence, wide_axis
from vgrd.registers.layout import MAP_VERSION, encode_response
from vgrd.registers.request import NOTHING_ASKED, Request

AGE_STEP_S: Final = 0.01  # AGE lags by less; for it polls encode at most 100 times a second

_CELL_BITS = ~(State.BUSY | State.VALID | State.ERROR | State.DEGRADED)
_NO_ERROR = (Status.IDLE, Status.OK, Status.OK_DEGRADED, Status.BUSY)


@dataclass(frozen=True, slots=True)
class View:
    """What a client may read until `good_until_s`: 136 bytes from 100 on, and from 300 on.

    answer: what they say, judged at that moment; it holds a coordinate where its status is OK.
    """

    response: bytes
    swapped: bytes
    answer: Answer
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
    scale: Scale16 = Scale16.MRAD,
) -> View:
    """Return the registers at `now_s`.

    image: the newest of the cell, None before its first. pending: the request not yet answered.
    answered: the last request, whose answer of the cell stands. refusal: what the gate itself
    answered in place of the cell; it never holds a coordinate. scale: units of the int16 block.
    """
    alive = image is not None and abs(now_s - image.published_s) < deadline_s
    answer = _shown(image if alive else None, image is not None, pending, answered, refusal)
    if answer.status.is_ok:
        answer = _judged(answer, now_s)
    valid = answer.status.is_ok
    state, beat = _live(image, alive=alive, status=answer.status)
    values = _values(answer, now_s, state, beat, scale)
    response, swapped = encode_response(values | coordinates(answer, scale))
    until = [math.inf]
    if image is not None and alive:
        until.append(image.published_s + deadline_s)
    if valid:
        until.append(answer.valid_until_s)
    if age_ms(answer, now_s) < UNKNOWN16:
        until.append(now_s + AGE_STEP_S)
    return View(response, swapped, answer, state, beat, min(until))


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
    if axis := wide_axis(answer):
        return replace(answer, status=Status.ENCODING_OVERFLOW, detail=axis)
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
    answer: Answer, now_s: float, state: State, beat: int, scale: Scale16
) -> dict[str, float]:
    """All registers but those of the three coordinates."""
    valid = answer.status.is_ok
    return {
        "MAPVER": MAP_VERSION,
        "HB": beat,
        "STATE": state,
        "ECHO": answer.echo,
        "STATUS": answer.status,
        "DETAIL": narrow_axis(answer, scale) if valid else answer.detail,
        "POINT": answer.point,
        "AGE": age_ms(answer, now_s),
        "U95P": min(answer.u95_um, UNKNOWN16) if valid else UNKNOWN16,
        "U95R": min(answer.u95_rot_10urad, UNKNOWN16) if valid else UNKNOWN16,
        "NTAG": answer.tags,
        "CALID": answer.calibration_id,
        "OBJECT": answer.object,
        "FMT": answer.rotation_format | answer.frame << 4 | scale << 8,
        "TCAP": answer.captured_unix_us,
        "SEQ": sequence(answer, valid=valid),
        "MOVED": 0 if valid else min(answer.moved_um, UNKNOWN16),
    }


def age_ms(answer: Answer, now_s: float) -> int:
    """AGE, ms: 65535 for more, or unknown."""
    if not math.isfinite(answer.captured_s):
        return UNKNOWN16
    age_ms = (now_s - answer.captured_s) * 1000
    return math.ceil(min(max(age_ms, 0), UNKNOWN16))
