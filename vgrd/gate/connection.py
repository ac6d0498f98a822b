"""One connection: bytes in, answers out, on the event loop and without a task of its own.

There is no await between a request and its answer, so a write is whole and in force before it is
answered.
"""

import asyncio
import socket
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final, Protocol, TypeVar

from vgrd.clock import Clock

_ONCE: Final = 1  # who asked once may never ask again; who asked twice polls
# A connection whose cable was pulled ends after about 6 s (3 + 3 x 1); without these options it was
# still there after 20 s (tried with a veth pair).
_OPTIONS: Final = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),  # an answer is one small packet: sent at once
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 3),  # s of silence before the first probe
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1),  # s between probes
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),  # probes without an answer
    (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 5000),  # ms for an answer that was sent
)


class GarbageError(Exception):
    """Bytes that are no request, and after which nobody knows where one begins."""


NOT_WHOLE: Final = (b"", 0, False)  # what `Talk.answer` returns until the rest has come
D = TypeVar("D")


class Talk(Protocol[D]):
    """What is said on one connection, about `data`. requests: so many were answered."""

    data: D
    requests: int

    def is_quick(self, received: bytes) -> bool:
        """Whether the first request costs so little that it is answered as soon as it is read."""
        ...

    def answer(self, received: bytes) -> tuple[bytes, int, bool]:
        """Answer to the first request, how many bytes that was, and whether it started something. Raises GarbageError.

        What starts something uses up the turn: it costs about as much as eight requests that only look.
        """
        ...


class Times(Protocol):
    """How long a connection may be silent, see `server.ConnectionLimits`."""

    @property
    def idle_s(self) -> float: ...  # noqa: D102
    @property
    def partial_s(self) -> float: ...  # noqa: D102
    @property
    def silent_s(self) -> float: ...  # noqa: D102


class Turns:
    """Bounds what all connections of a server do in one turn of the loop, so that another is not delayed.

    Who has requests waits in a queue. In a turn `per_turn` requests are answered, one of each in the queue
    and then again, but none after one that started something; then others may read.
    """

    def __init__(self, per_turn: int) -> None:
        self._per_turn = per_turn
        self._queue: deque[Callable[[], bool]] = deque()
        self._is_called = False

    def enter(self, work: Callable[[], bool]) -> None:
        """Have `work` called once, in its turn: it answers one request, and tells whether that started something."""
        self._queue.append(work)
        self._call()

    def _call(self) -> None:
        if not self._is_called:
            self._is_called = True
            asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        self._is_called = False
        for _ in range(self._per_turn):
            if not self._queue or self._queue.popleft()():
                break
        if self._queue:
            self._call()


class Connection:
    """Talks with one peer. `counters` are the server's; `forget` takes it off its list.

    turns: in which its requests are answered, but for a quick one that finds none before it.
    buffer_bytes: read before they are answered.
    """

    def __init__(
        self,
        link: socket.socket,
        peer: str,
        talk: Talk[Any],
        clock: Clock,
        counters: Counter[str],
        forget: Callable[["Connection"], None],
        turns: Turns,
        buffer_bytes: int,
    ) -> None:
        self.peer, self.talk = peer, talk
        self.last_read_s = self._frame_s = clock.monotonic()
        self._socket, self._clock = link, clock
        self._counters, self._forget, self._turns = counters, forget, turns
        self._buffer_bytes = buffer_bytes
        self._received = b""
        self._unsent = b""
        self._waits = False  # for its turn
        link.setblocking(False)
        for level, option, value in _OPTIONS:
            link.setsockopt(level, option, value)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(link, self._read)
        self._reads = True

    @property
    def priority(self) -> tuple[int, float]:
        """The least is closed first: who never asked, then who asked once, then the longest silent."""
        return min(self.talk.requests, _ONCE + 1), self.last_read_s

    def is_polling(self, now_s: float, times: Times) -> bool:
        """Whether a program uses it: it asks again and again, and did just now."""
        return self.talk.requests > _ONCE and now_s - self.last_read_s < times.silent_s

    def is_overdue(self, now_s: float, times: Times) -> bool:
        """Whether a frame stays cut, answers are not taken, or nothing was said for too long."""
        if self._received or self._unsent:
            return now_s - self._frame_s > times.partial_s
        return now_s - self.last_read_s > times.idle_s

    def drop(self, reason: str) -> None:
        """Close without waiting, and count why."""
        self._counters[reason] += 1
        self._close()

    def _close(self) -> None:
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
            self._socket.close()
        self._received = b""
        self._forget(self)

    def _read(self) -> None:
        """Every read of a register comes here: few calls, and no copy unless a request came in pieces."""
        try:
            received = self._socket.recv(self._buffer_bytes - len(self._received))
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            self._close()
            return
        self.last_read_s = self._clock.monotonic()
        if self._received:
            received = self._received + received
        else:
            self._frame_s = self.last_read_s
        self._received = received
        if self._waits or not self.talk.is_quick(received):
            self._settle()
        else:
            self._work()

    def _work(self) -> bool:
        """Answer the first request, if it is whole; whether that started something."""
        self._waits = False
        received = self._received
        if not received or self._unsent:
            return False
        try:
            answer, length, starts = self.talk.answer(received)
        except GarbageError:
            self.drop("garbage")
            return False
        self._received = received[length:]
        if answer:
            self._send(answer)
        if not (self._received or self._unsent) and self._reads:
            return starts  # as nearly always: one request, and nothing to settle
        if length:
            self._frame_s = self._clock.monotonic()
        self._settle(may_be_more=length > 0)
        return starts

    def _settle(self, *, may_be_more: bool = True) -> None:
        """Wait for a turn if there is something to answer, and be told what comes if there is room for it."""
        if may_be_more and self._received and not (self._waits or self._unsent):
            self._waits = True
            self._turns.enter(self._work)
        wanted = not self._unsent and len(self._received) < self._buffer_bytes
        if wanted is self._reads or self._socket.fileno() < 0:
            return
        self._reads = wanted
        if wanted:
            self._loop.add_reader(self._socket, self._read)
        else:
            self._loop.remove_reader(self._socket)

    def _send(self, answers: bytes) -> None:
        """Send what the peer takes; while it does not take all, nothing more is read."""
        try:
            sent = self._socket.send(answers)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._close()
            return
        if sent < len(answers) and not self._unsent:
            self._frame_s = self._clock.monotonic()
            self._loop.add_writer(self._socket, self._send_rest)
        self._unsent = answers[sent:]

    def _send_rest(self) -> None:
        self._send(self._unsent)
        if not self._unsent and self._socket.fileno() >= 0:
            self._loop.remove_writer(self._socket)
            self._settle()
