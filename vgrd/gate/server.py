"""A TCP server of a language that robots speak, Modbus or lines: listed peers only, and nobody starved.

Connections are accepted by our own loop: a host that is not listed costs one `accept` and one `close`,
however often it comes, and the queue before it is as long as the system allows, so that a listed robot
does not wait behind it.
"""

import asyncio
import errno
import ipaddress
import socket
import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Generic, NamedTuple, TypeVar

import structlog

from vgrd.clock import Clock
from vgrd.errors import ServingError
from vgrd.gate.connection import Connection, Talk, Turns

ACCEPTS_PER_TURN: Final = 64  # under 1 ms of refusals, then the connections have their turn
_BACKLOG: Final = 4096  # Linux's own limit (net.core.somaxconn) since 5.4
_PEERS: Final = 1024  # whose admission is remembered; chosen: more than a cell network has
_RESET = struct.pack("ii", 1, 0)  # SO_LINGER: close by reset, leaves no TIME_WAIT behind
_SHORTAGE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

log = structlog.get_logger()


D = TypeVar("D")


class Language(NamedTuple, Generic[D]):
    """What a server speaks. key: of the port in [serving]. buffer_bytes: of a connection.

    talk: begins a conversation about data. per_turn: so many requests of all connections in a turn of the
    loop, see `Turns`.
    """

    name: str
    key: str
    talk: Callable[[D, Counter[str], Clock], Talk[D]]
    buffer_bytes: int
    per_turn: int


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """What peers may do.

    allow: addresses or networks. partial_s: for the rest of a frame, and for taking answers.
    silent_s: a connection that polled, and was silent for so long, may be closed for a new one of
    the same peer when the peer has too many.
    """

    allow: tuple[str, ...] = ("127.0.0.1",)
    connections: int = 64  # chosen: far below the 1,024 descriptors that a flood took elsewhere
    connections_per_peer: int = 8  # chosen: eight such peers fill `connections`
    idle_s: float = 60.0  # chosen: who asks nothing for so long has forgotten its connection
    partial_s: float = 1.0  # garbage, slow bytes and cut frames end within a second
    silent_s: float = 1.0  # as the second in which a robot program must see HB move


class Server(Generic[D]):
    """Serves `data` at one address. `sweep` is to be called a few times a second."""

    def __init__(
        self, language: Language[D], data: D, clock: Clock, limits: ConnectionLimits
    ) -> None:
        self._language = language
        self.data, self.clock, self.limits = data, clock, limits
        self._turns = Turns(language.per_turn)
        self.counters: Counter[str] = Counter()
        self._allow = [ipaddress.ip_network(entry) for entry in limits.allow]
        self._is_allowed = lru_cache(_PEERS)(self._is_listed)
        self._links: set[Connection] = set()
        self._listeners: list[socket.socket] = []
        self._paused: list[socket.socket] = []  # listeners, until there are descriptors again

    async def listen(self, host: str, port: int, inherited: socket.socket | None = None) -> int:
        """Open the port and return its number (`port` 0: a free one). Raises ServingError.

        inherited: a socket that listens already, at that very address.
        """
        try:
            self._listeners = _listeners(host, port) if inherited is None else [inherited]
            if inherited is not None:
                _check_address(inherited, host, port)
            for listener in self._listeners:
                listener.setblocking(False)
                listener.listen(_BACKLOG)
        except OSError as error:
            self.close()
            name, key = self._language.name, self._language.key
            raise ServingError(
                f"cannot serve {name} on {host}:{port}: {_remedy(error, key)}"
            ) from error
        for listener in self._listeners:
            self._wait_for_peers(listener)
        return int(self._listeners[0].getsockname()[1])

    def serve_from_now_on(self, data: D, allow: tuple[str, ...]) -> None:
        """Serve other data, and drop who is not allowed any more."""
        self.data, self.limits = data, replace(self.limits, allow=allow)
        self._allow = [ipaddress.ip_network(entry) for entry in allow]
        self._is_allowed.cache_clear()
        for link in list(self._links):
            link.talk.data = data
            if not self._is_allowed(link.peer):
                link.drop("refused")

    def close(self) -> None:
        """Stop listening and drop all connections."""
        loop = asyncio.get_running_loop()
        for listener in self._listeners:
            loop.remove_reader(listener)
            listener.close()
        self._listeners, self._paused = [], []
        for link in list(self._links):
            link.drop("closed")

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._links)

    def sweep(self) -> None:
        """Drop the connections whose time is over; accept again after a shortage."""
        now = self.clock.monotonic()
        for link in list(self._links):
            if link.is_overdue(now, self.limits):
                link.drop("timeouts")
        for listener in self._paused:
            self._wait_for_peers(listener)
        self._paused = []

    def _wait_for_peers(self, listener: socket.socket) -> None:
        asyncio.get_running_loop().add_reader(listener, self._accept, listener)

    def _accept(self, listener: socket.socket) -> None:
        """Take or refuse those who knock, a bounded number of them."""
        for _ in range(ACCEPTS_PER_TURN):
            try:
                link, address = listener.accept()
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno in _SHORTAGE:
                    self._pause(listener, error)
                    return
                continue  # that peer is gone again
            self._admit(link, str(address[0]))

    def _pause(self, listener: socket.socket, error: OSError) -> None:
        log.error("connections_not_accepted", reason=error.strerror)
        asyncio.get_running_loop().remove_reader(listener)
        self._paused.append(listener)

    def _admit(self, link: socket.socket, peer: str) -> None:
        if not self._is_allowed(peer) or not self._make_room(peer):
            self.counters["refused"] += 1
            link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            link.close()
            return
        self.counters["accepted"] += 1
        try:
            connection = Connection(
                link,
                peer,
                self._talk(),
                self.clock,
                self.counters,
                self._links.discard,
                self._turns,
                self._language.buffer_bytes,
            )
        except OSError:
            link.close()  # it went while it was let in
        else:
            self._links.add(connection)

    def _talk(self) -> Talk[D]:
        return self._language.talk(self.data, self.counters, self.clock)

    def _is_listed(self, peer: str) -> bool:
        address = ipaddress.ip_address(peer)
        return any(address in network for network in self._allow)

    def _make_room(self, peer: str) -> bool:
        """Close the connection of the least priority, if need be; never one that polls.

        It is one of the same peer when that has too many, else one of the peer that has most.
        """
        crowded_peer = peer
        counts = Counter(link.peer for link in self._links)
        if counts[peer] < self.limits.connections_per_peer:
            if len(self._links) < self.limits.connections:
                return True
            crowded_peer = counts.most_common(1)[0][0]
        candidates = (link for link in self._links if link.peer == crowded_peer)
        least = min(candidates, key=lambda link: link.priority)
        if least.is_polling(self.clock.monotonic(), self.limits):
            return False
        least.drop("evicted")
        return True


def _listeners(host: str, port: int) -> list[socket.socket]:
    """One bound socket per address of `host`. Raises OSError."""
    addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    listeners: list[socket.socket] = []
    try:
        for family, kind, protocol, _, address in dict.fromkeys(addresses):
            listener = socket.socket(family, kind, protocol)
            listeners.append(listener)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listener.bind(address)
    except OSError:
        for listener in listeners:
            listener.close()
        raise
    return listeners


def _check_address(inherited: socket.socket, host: str, port: int) -> None:
    """Raises ServingError unless the socket handed over listens where the cell file says."""
    address = inherited.getsockname()[:2]
    configured = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    if address not in [entry[4][:2] for entry in configured]:
        raise ServingError(
            f"the socket unit listens at {address[0]}:{address[1]}, the cell file says"
            f" {host}:{port}: make ListenStream= and [serving] host, port agree"
        )


def _remedy(error: OSError, key: str) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"the port is taken; stop the other server or change [serving] {key}"
    if error.errno == errno.EACCES:
        return (
            "ports below 1024 need a privilege; have the port opened by config/vgrd.socket"
            f" or change [serving] {key} (1502 is free for all)"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return "this machine does not have that address; change [serving] host"
    return f"{error.strerror or error}; check [serving] host and {key}"
