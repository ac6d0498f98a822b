"""A strict Modbus TCP server: every request answered, every byte judged, nobody starved.

Every unit id is answered, and pipelined requests all are. A frame that is not Modbus closes its
connection: the next "frame" might be the tail of this one. There is no await between a request and
its answer, so a write is whole and in force before it is answered.
"""

import asyncio
import errno
import ipaddress
import socket
import struct
from collections import Counter
from dataclasses import dataclass
from typing import Final, cast

from vgrd.clock import Clock
from vgrd.errors import ServingError
from vgrd.gate.pdu import Data, GarbageError, respond

_HEADER = struct.Struct(">HHHB")
_BUFFER_BYTES: Final = 4096  # worked off before the other connections have their turn
_LONGEST: Final = 254  # unit id and PDU
_KEEPALIVE: Final = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 3),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
    (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 5000),
)


@dataclass(frozen=True, slots=True)
class Limits:
    """What peers may do.

    allow: addresses or networks. silent_s: so long silent, a connection gives way to a new one of
    the same peer when the peer has too many. partial_s: for the rest of a frame, and for taking
    answers.
    """

    allow: tuple[str, ...] = ("127.0.0.1",)
    connections: int = 64
    connections_per_peer: int = 8
    idle_s: float = 60.0
    partial_s: float = 1.0
    silent_s: float = 1.0


class ModbusServer:
    """Serves `data` at one address."""

    def __init__(self, data: Data, clock: Clock, limits: Limits) -> None:
        self.data, self.clock, self.limits = data, clock, limits
        self.counters: Counter[str] = Counter()
        self._allow = [ipaddress.ip_network(entry) for entry in limits.allow]
        self._links: set[_Link] = set()
        self._server: asyncio.Server | None = None

    async def listen(self, host: str, port: int) -> int:
        """Open the port and return its number (`port` 0: a free one). Raises ServingError."""
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(
                lambda: _Link(self), host, port, backlog=64, reuse_address=True
            )
        except OSError as error:
            raise ServingError(
                f"cannot serve Modbus on {host}:{port}: {_remedy(error)}"
            ) from error
        return int(self._server.sockets[0].getsockname()[1])

    def close(self) -> None:
        """Stop listening and drop all connections."""
        if self._server:
            self._server.close()
        for link in list(self._links):
            link.drop("closed")

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._links)

    def admit(self, link: "_Link") -> bool:
        """Take a new connection, at the cost of the same peer's longest silent one if need be."""
        address = ipaddress.ip_address(link.peer)
        if not any(address in network for network in self._allow):
            return False
        same = [other for other in self._links if other.peer == link.peer]
        if len(same) >= self.limits.connections_per_peer:
            oldest = min(same, key=lambda other: other.heard_s)
            if self.clock.monotonic() - oldest.heard_s < self.limits.silent_s:
                return False
            oldest.drop("evicted")
        elif len(self._links) >= self.limits.connections:
            return False
        self._links.add(link)
        return True

    def forget(self, link: "_Link") -> None:
        """Take a closed connection off the list."""
        self._links.discard(link)

    def sweep(self) -> None:
        """Drop the connections whose time is over; to be called a few times a second."""
        now = self.clock.monotonic()
        for link in list(self._links):
            if link.is_overdue(now):
                link.drop("timeouts")


class _Link(asyncio.BufferedProtocol):
    """One connection."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._buffer = memoryview(bytearray(_BUFFER_BYTES))
        self._filled = 0
        self._blocked = False
        self.heard_s = self._frame_s = server.clock.monotonic()
        self.peer = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self.peer = str(transport.get_extra_info("peername")[0])
        if not self._server.admit(self):
            self.drop("refused")
            return
        self._server.counters["accepted"] += 1
        link: socket.socket = transport.get_extra_info("socket")
        for level, option, value in _KEEPALIVE:
            link.setsockopt(level, option, value)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._server.forget(self)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002
        return self._buffer[self._filled :]

    def buffer_updated(self, nbytes: int) -> None:
        self._filled += nbytes
        self.heard_s = self._server.clock.monotonic()
        try:
            answers, used = self._work_off(bytes(self._buffer[: self._filled]))
        except GarbageError:
            self.drop("garbage")
            return
        if used:
            rest = self._filled - used
            self._buffer[:rest] = bytes(self._buffer[used : self._filled])
            self._filled, self._frame_s = rest, self.heard_s
            self._transport.write(answers)

    def eof_received(self) -> bool:
        return False

    def pause_writing(self) -> None:
        self._blocked, self._frame_s = True, self._server.clock.monotonic()
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        self._blocked = False
        self._transport.resume_reading()

    def is_overdue(self, now_s: float) -> bool:
        """Whether a frame stays cut, answers are not taken, or nothing was said for too long."""
        limits = self._server.limits
        if self._filled or self._blocked:
            return now_s - self._frame_s > limits.partial_s
        return now_s - self.heard_s > limits.idle_s

    def drop(self, reason: str) -> None:
        """Close without waiting, and count why."""
        self._server.counters[reason] += 1
        self._server.forget(self)
        self._transport.abort()

    def _work_off(self, received: bytes) -> tuple[bytes, int]:
        """Answers to all whole frames, and how many bytes these were. Raises GarbageError."""
        answers, at = [], 0
        counters = self._server.counters
        while len(received) - at >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(received, at)
            if protocol or not 2 <= length <= _LONGEST:
                raise GarbageError
            end = at + 6 + length
            if end > len(received):
                break
            answer = respond(self._server.data, received[at + _HEADER.size : end])
            counters["requests"] += 1
            counters["exceptions"] += answer[0] >= 0x80
            answers.append(_HEADER.pack(transaction, 0, 1 + len(answer), unit) + answer)
            at = end
        return b"".join(answers), at


def _remedy(error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return "the port is taken; stop the other server or change [serving] port"
    if error.errno == errno.EACCES:
        return "ports below 1024 need a privilege; change [serving] port (1502 is free for all)"
    if error.errno == errno.EADDRNOTAVAIL:
        return "this machine does not have that address; change [serving] host"
    return f"{error.strerror or error}; check [serving] host and port"
