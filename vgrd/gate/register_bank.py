"""Where the robot's requests and the cell's answers meet: the data behind the Modbus server."""

import math
import secrets
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from vgrd.clock import Clock
from vgrd.gate.image_feed import ImageFeed
from vgrd.ipc.time_limits import REQUEST_TIMEOUT_S
from vgrd.registers import (
    REQUEST,
    RESPONSE,
    SWAPPED_FROM,
    Answer,
    Command,
    PolicyCode,
    Request,
    Scale16,
    Status,
    reply,
    view,
)

Forward = Callable[[Request], bool]

_ALIVE_INPUT: Final = 16  # the discrete input behind the 16 bits of STATE
_TRIG_COIL: Final = 0
_CLEAR_COIL: Final = 1
_NONCE_BITS: Final = 63  # half of what the u64 of a register image holds: never wraps
_LAST_TRIG: Final = 0xFFFF  # of a 16-bit register; after it comes 1, since 0 clears
_TRIG, _CMD, _OPT, _TIMEOUT = (
    REQUEST.registers(name)[0] for name in ("TRIG", "CMD", "OPT", "TMO")
)
_ORIENTATION = REQUEST.registers("ORI_")
_TRIG_BYTES: Final = slice(2 * _TRIG, 2 * _TRIG + 2)
_BEATS_PER_TOGGLE: Final = 5  # of HB, one each 100 ms: a PLC sees a toggle of 1 Hz
_BLOCKS = (
    (REQUEST.start, REQUEST.end),
    (RESPONSE.start, RESPONSE.end),
    (SWAPPED_FROM, SWAPPED_FROM + RESPONSE.end - RESPONSE.start),
)


class RegisterBank:
    """Registers, coils and inputs, and the one request that may be pending.

    `forward` passes a request to the cell and returns whether that was possible. `abort` tells the
    cell that nobody waits any more. The nonces of the requests begin at a random number: an answer
    to an earlier gate is never taken for an answer to this one.
    """

    def __init__(
        self,
        feed: ImageFeed,
        clock: Clock,
        *,
        deadline_s: float,
        forward: Forward,
        abort: Callable[[], None],
        timeout_s: float = REQUEST_TIMEOUT_S,
        scale: Scale16 = Scale16.MRAD,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.reads = 0  # of registers, by whoever asks; a plain number, as reads are many
        self._feed, self._clock = feed, clock
        self._deadline_s, self._timeout_s = deadline_s, timeout_s
        self._forward, self._abort = forward, abort
        self._scale = scale
        self._request = bytes(2 * REQUEST.end)
        self._coils = [False, False]
        self._nonce = secrets.randbits(_NONCE_BITS)
        self._written_registers: set[int] = set()  # addresses, since TRIG changed
        self._trig_parameters = b""  # parameters, when TRIG changed
        self._pending: Request | None = None
        self._answered_request: Request | None = None
        self._overdue_s = math.inf
        self._refusal: Answer | None = None
        self._seq: int | None = None  # of the answer that stood there when the request came
        self._final_status: Status | None = None
        self._refresh(clock.monotonic())

    @property
    def pending(self) -> Request | None:
        """The request that the cell works on."""
        return self._pending

    def read_registers(self, address: int, count: int) -> bytes | None:
        """Read registers of one block, None outside."""
        self.refresh()
        self.reads += 1
        for start, end in _BLOCKS:
            if start <= address and address + count <= end:
                return self._space[2 * address : 2 * (address + count)]
        return None

    def write_registers(self, address: int, data: bytes) -> bool:
        """Write into the request block, then look at TRIG."""
        end = address + len(data) // 2
        if end > REQUEST.end:
            return False
        old_trig = self._request[_TRIG_BYTES]
        self._request = self._request[: 2 * address] + data + self._request[2 * end :]
        self._written_registers.update(range(address, end))
        if self._request[_TRIG_BYTES] != old_trig:
            self._triggered()
        elif (
            address == _TRIG
            and old_trig != bytes(2)
            and self._parameters() != self._trig_parameters
        ):
            self._refuse_reuse()
        self._refresh(self._clock.monotonic())
        return True

    def read_coils(self, address: int, count: int) -> Sequence[bool] | None:
        """TRIG and CLEAR as they were written."""
        return (
            self._coils[address : address + count] if address + count <= len(self._coils) else None
        )

    def write_coils(self, address: int, values: Sequence[bool]) -> bool:
        """Rising edges: of coil 0 a request with TRIG + 1, of coil 1 clears.

        The parameters may have been written at any time before. So policy 3 is refused: an
        orientation belongs to one request.
        """
        if address + len(values) > len(self._coils):
            return False
        old_coils = list(self._coils)
        self._coils[address : address + len(values)] = values
        if self._coils[_CLEAR_COIL] and not old_coils[_CLEAR_COIL]:
            self._clear(echo=0)
        if self._coils[_TRIG_COIL] and not old_coils[_TRIG_COIL]:
            request = bytearray(self._request)
            request[_TRIG_BYTES] = struct.pack(">H", self._trig() % _LAST_TRIG + 1)
            self._request = bytes(request)
            self._triggered(from_coil=True)
        self._refresh(self._clock.monotonic())
        return True

    def read_inputs(self, address: int, count: int) -> Sequence[bool] | None:
        """STATE bit by bit, and the toggle that shows that HB counts."""
        if address + count > _ALIVE_INPUT + 1:
            return None
        self.refresh()
        toggle = self._view.beat // _BEATS_PER_TOGGLE % 2
        bits = int(self._view.state) | toggle << _ALIVE_INPUT
        return [bool(bits >> i & 1) for i in range(address, address + count)]

    def ask(self, registers: bytes) -> int:
        """Take a request that was not written into registers 0-31, which stay; returns its nonce.

        registers: the same as if it were, with TRIG 0, so that in the registers its answer is nobody's.
        """
        self._nonce += 1
        if self._final_status is None:
            self._start(Request.parse(registers, self._nonce))
        self._refresh(self._clock.monotonic())
        return self._nonce

    def drop(self, nonce: int) -> None:
        """Drop that request and its answer, unless another one took its place."""
        if nonce == self._nonce and self._final_status is None:
            self._clear(echo=0)
            self._refresh(self._clock.monotonic())

    def answer_to(self, nonce: int) -> Answer:
        """What the registers say now, if it is the answer to that request; else an answer that says why not."""
        self.refresh()
        answer = self._view.answer
        if answer.nonce == nonce or self._final_status is not None:
            return answer
        if nonce != self._nonce:
            return Answer(Status.SUPERSEDED)
        return Answer() if answer.status.is_ok else answer

    @property
    def response(self) -> bytes:
        """The response block as it is read now."""
        self.refresh()
        return self._view.response

    @property
    def beat(self) -> int:
        """HB of the registers."""
        return self._view.beat

    def cell_lost(self) -> None:
        """Invalidate, and answer what is pending, now: the cell's process is dead."""
        self._feed.lose()
        self._refresh(self._clock.monotonic())

    def close(self, status: Status) -> None:
        """Answer everything with `status` from now on."""
        self._final_status = status
        self._pending, self._overdue_s = None, math.inf
        self._refresh(self._clock.monotonic())

    def refresh(self) -> None:
        """Bring the registers up to date, if anything may have changed."""
        now = self._clock.monotonic()
        if self._feed.poll() or now >= self._view.good_until_s or now >= self._overdue_s:
            self._refresh(now)

    def _refresh(self, now_s: float) -> None:
        image = self._feed.image
        if self._pending and image is not None and self._is_answer(image.answer):
            self._answered_request, self._pending, self._overdue_s = self._pending, None, math.inf
        elif self._pending and not self._is_alive(now_s):
            self._refuse(Status.INTERNAL_ERROR if image else Status.STARTING)
        elif self._pending and now_s >= self._overdue_s:
            self._abort()
            self._refuse(Status.TIMEOUT)
        if self._refusal and image is not None and self._is_continuous(image.answer):
            self._refusal = None
        refusal = self._refusal
        if self._final_status is not None:
            refusal = Answer(self._final_status, echo=self._trig())
        self._view = view(
            image,
            now_s,
            self._pending,
            deadline_s=self._deadline_s,
            answered=self._answered_request,
            refusal=refusal,
            scale=self._scale,
        )
        gap = bytes(2 * (RESPONSE.start - REQUEST.end))
        gap_between = bytes(2 * (SWAPPED_FROM - RESPONSE.end))
        self._space = b"".join(
            (self._request, gap, self._view.response, gap_between, self._view.swapped)
        )

    def _is_alive(self, now_s: float) -> bool:
        """Whether the cell has published within the deadline."""
        image = self._feed.image
        return image is not None and abs(now_s - image.published_s) < self._deadline_s

    def _is_answer(self, answer: Answer) -> bool:
        """Whether it is to the pending request, not to an earlier one with the same TRIG."""
        return self._pending is not None and answer.nonce == self._pending.nonce

    def _is_continuous(self, answer: Answer) -> bool:
        """Whether the cell publishes something newer that nobody asked for: it may be shown."""
        if answer.nonce or answer.echo or answer.seq == self._seq:
            return False
        return answer.status.is_ok or (
            self._refusal is not None and not (self._refusal.echo or self._refusal.nonce)
        )

    def _trig(self) -> int:
        """The TRIG that was written last."""
        return int.from_bytes(self._request[_TRIG_BYTES], "big")

    def _parameters(self) -> bytes:
        """What a request consists of besides TRIG."""
        return self._request[2 * _CMD : 2 * _TIMEOUT + 2] + self._request[2 * _ORIENTATION[0] :]

    def _refuse_reuse(self) -> None:
        """A used TRIG, written again with other parameters, would show the old answer as theirs."""
        if self._final_status is None:
            self._nonce += 1
            self._abort()
            self._trig_parameters = self._parameters()
            self._pending, self._answered_request = Request.parse(self._request, self._nonce), None
            self._remember_answer()
            self._refuse(Status.BAD_PARAMETER, _TRIG)

    def _triggered(self, *, from_coil: bool = False) -> None:
        written, self._written_registers = self._written_registers, set()
        self._trig_parameters = self._parameters()
        if self._final_status is not None:
            return
        self._nonce += 1
        request = Request.parse(
            self._request, self._nonce, orientation_written=written.issuperset(_ORIENTATION)
        )
        if request.trig == 0 or request.command == Command.CLEAR:
            self._clear(echo=request.trig)
            return
        self._start(request, from_coil=from_coil)

    def _start(self, request: Request, *, from_coil: bool = False) -> None:
        """Have the cell work on a request, in place of any other."""
        self._feed.poll()
        now = self._clock.monotonic()
        self.counters["triggers"] += 1
        self.counters["superseded"] += self._pending is not None
        self._pending, self._answered_request, self._refusal = request, None, None
        self._remember_answer()
        self._overdue_s = now + (request.timeout_s or self._timeout_s)
        if from_coil and request.policy is PolicyCode.REQUESTED:
            self._abort()
            self._refuse(Status.BAD_PARAMETER, _OPT)
            return
        # A cell that does not read yet must not find its link full of requests long refused.
        if not (self._is_alive(now) and self._forward(request)):
            self._refuse(Status.INTERNAL_ERROR if self._feed.image else Status.STARTING)

    def _clear(self, *, echo: int) -> None:
        self._feed.poll()
        self._nonce += 1  # whoever waits for an answer waits for none
        self._pending, self._answered_request, self._overdue_s = None, None, math.inf
        self._written_registers = set()
        self._remember_answer()
        self._refusal = Answer(Status.IDLE, echo=echo, seq=self._seq or 0)
        self._abort()

    def _refuse(self, status: Status, detail: int = 0) -> None:
        """Answer the pending request in place of the cell; a late answer will not be shown."""
        if self._pending:
            self._refusal = replace(reply(self._pending, status, detail), seq=self._seq or 0)
            self.counters[status.name.lower()] += 1
        self._pending, self._overdue_s = None, math.inf

    def _remember_answer(self) -> None:
        image = self._feed.image
        self._seq = image.answer.seq if image else None
