"""What one connection of the line server says: a line, its answer, at once, and nothing unasked.

A TRIG other than the last one of this connection starts a request; the same one asks for its answer, which is
that of this connection's own request or none.
"""

from collections import Counter
from typing import Final, Protocol

from vgrd.clock import Clock
from vgrd.gate.connection import NOT_WHOLE, GarbageError
from vgrd.gate.server import Language
from vgrd.lines import (
    BLANKS,
    LONGEST_DOCUMENT,
    Asked,
    Piece,
    RefusedError,
    UnreadableError,
    answer_text,
    cut,
    read,
)
from vgrd.registers import Answer, Status

_LINES_PER_TURN: Final = 8  # polls, or one ask: some 0.1 ms, as long as a read of registers waits
_BUFFER_BYTES: Final = 2 * LONGEST_DOCUMENT  # a whole request and most of the next


class Desk(Protocol):
    """Where requests are taken, see `RegisterBank`."""

    @property
    def beat(self) -> int:
        """HB."""
        ...

    def ask(self, registers: bytes) -> int:
        """Take a request; returns its nonce."""
        ...

    def drop(self, nonce: int) -> None:
        """Drop that request."""
        ...

    def answer_to(self, nonce: int) -> Answer:
        """What became of it."""
        ...


class LineTalk:
    """The requests of one connection, and which of them is its last."""

    def __init__(self, data: Desk, counters: Counter[str], clock: Clock) -> None:
        self.data, self.requests = data, 0
        self._counters, self._clock = counters, clock
        self._last = Asked(0)
        self._nonce = 0
        self._half_end = False  # a CR ended the last line, and LF may follow

    def is_quick(self, received: bytes) -> bool:  # noqa: ARG002
        """Never: registers are read before lines are answered."""
        return False

    def answer(self, received: bytes) -> tuple[bytes, int, bool]:
        """The answer to the first request, if that is whole. Raises GarbageError."""
        if self._half_end and received[:1] == b"\n":
            self._half_end = False
            return b"\n", 1, False
        if blanks := len(received) - len(received.lstrip(BLANKS)):
            self._half_end = False
            return b"", blanks, False
        try:
            piece = cut(received)
        except UnreadableError as error:
            raise GarbageError from error
        if piece is None:
            return NOT_WHOLE
        self._half_end = piece.end == "\r"
        self.requests += 1
        self._counters["requests"] += 1
        nonce = self._nonce
        reply = self._reply(piece) + piece.end
        return reply.encode("ascii"), piece.length, self._nonce != nonce

    def _reply(self, piece: Piece) -> str:
        try:
            asked = read(piece)
            answer, trig = self._answer_to(asked), asked.trig
        except RefusedError as refused:
            self._counters["exceptions"] += 1
            answer, trig = Answer(refused.status), refused.trig
        return answer_text(piece.frame, trig, answer, self.data.beat, self._clock.monotonic())

    def _answer_to(self, asked: Asked) -> Answer:
        """Start what is asked, or look what became of it. Raises RefusedError."""
        if asked.is_clear:
            self.data.drop(self._nonce)
            self._last, self._nonce = Asked(0), 0
            return Answer()
        if asked.trig != self._last.trig:
            self._nonce = self.data.ask(asked.registers())
            self._last = asked
        elif asked != self._last:
            raise RefusedError(Status.BAD_PARAMETER, asked.trig)
        return self.data.answer_to(self._nonce)


LINES: Final = Language[Desk]("lines", "line_port", LineTalk, _BUFFER_BYTES, _LINES_PER_TURN)
