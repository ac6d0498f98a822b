"""One Modbus connection: bytes in, answers out, on the event loop and without a task of its own.

There is no await between a request and its answer, so a write is whole and in force before it is
answered.
"""

import asyncio
import socket
import struct
from collections import Counter
from collections.abc import Callable
from typing import Final, Protocol

from vgrd.clock import Clock
from vgrd.gate.pdu import EXCEPTION_BIT, Data, GarbageError, respond

_HEADER = struct.Struct(">HHHB")  # transaction, protocol, length, unit id
_BEFORE_LENGTH: Final = 6  # bytes that the length does not count: transaction, protocol, length
_BUFFER_BYTES: Final = 4096  # worked off before the other connections have their turn
_LONGEST: Final = 254  # unit id and the longest PDU: 253 bytes (Modbus protocol V1.1b3, 4.1)
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


class Times(Protocol):
    """How long a connection may be silent, see `modbus.ConnectionLimits`."""

    @property
    def idle_s(self) -> float: ...  # noqa: D102
    @property
    def partial_s(self) -> float: ...  # noqa: D102
    @property
    def silent_s(self) -> float: ...  # noqa: D102


class Connection:
    """Serves `data` to one peer. `counters` are the server's; `forget` takes it off its list."""

    def __init__(
        self,
        link: socket.socket,
        peer: str,
        data: Data,
        clock: Clock,
        counters: Counter[str],
        forget: Callable[["Connection"], None],
    ) -> None:
        self.peer = peer
        self.requests = 0
        self.last_read_s = self._frame_s = clock.monotonic()
        self._socket, self.data, self._clock = link, data, clock
        self._counters, self._forget = counters, forget
        self._buffer = memoryview(bytearray(_BUFFER_BYTES))
        self._filled = 0
        self._unsent = b""
        link.setblocking(False)
        for level, option, value in _OPTIONS:
            link.setsockopt(level, option, value)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(link, self._read)

    @property
    def priority(self) -> tuple[int, float]:
        """The least is closed first: who never asked, then who asked once, then the longest silent."""
        return min(self.requests, _ONCE + 1), self.last_read_s

    def is_polling(self, now_s: float, times: Times) -> bool:
        """Whether a program uses it: it asks again and again, and did just now."""
        return self.requests > _ONCE and now_s - self.last_read_s < times.silent_s

    def is_overdue(self, now_s: float, times: Times) -> bool:
        """Whether a frame stays cut, answers are not taken, or nothing was said for too long."""
        if self._filled or self._unsent:
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
        self._forget(self)

    def _read(self) -> None:
        try:
            received = self._socket.recv_into(self._buffer[self._filled :])
        except BlockingIOError:
            return
        except OSError:
            received = 0
        if not received:
            self._close()
            return
        self._filled += received
        self.last_read_s = self._clock.monotonic()
        try:
            answers, length = self._answer_frames(bytes(self._buffer[: self._filled]))
        except GarbageError:
            self.drop("garbage")
            return
        if length:
            rest = self._filled - length
            self._buffer[:rest] = bytes(self._buffer[length : self._filled])
            self._filled, self._frame_s = rest, self.last_read_s
            self._send(answers)

    def _send(self, answers: bytes) -> None:
        """Send what the peer takes; while it does not take all, nothing more is read."""
        try:
            sent = self._socket.send(answers)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._close()
            return
        if self._unsent and sent == len(answers):
            self._loop.remove_writer(self._socket)
            self._loop.add_reader(self._socket, self._read)
        elif not self._unsent and sent < len(answers):
            self._frame_s = self._clock.monotonic()
            self._loop.remove_reader(self._socket)
            self._loop.add_writer(self._socket, self._send_rest)
        self._unsent = answers[sent:]

    def _send_rest(self) -> None:
        self._send(self._unsent)

    def _answer_frames(self, received: bytes) -> tuple[bytes, int]:
        """Answers to all whole frames, and how many bytes these were. Raises GarbageError."""
        answers, start = [], 0
        counters = self._counters
        while len(received) - start >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(received, start)
            if protocol or not 2 <= length <= _LONGEST:
                raise GarbageError
            end = start + _BEFORE_LENGTH + length
            if end > len(received):
                break
            answer = respond(self.data, received[start + _HEADER.size : end])
            self.requests += 1
            counters["requests"] += 1
            counters["exceptions"] += answer[0] >= EXCEPTION_BIT
            answers.append(_HEADER.pack(transaction, 0, 1 + len(answer), unit) + answer)
            start = end
        return b"".join(answers), start
