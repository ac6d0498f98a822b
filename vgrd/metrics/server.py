"""Answers GET /metrics and nothing else; however many knock, it takes a fixed number of them a second."""

import asyncio
import re
import socket
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from vgrd.errors import ServingError
from vgrd.metrics.exposition import CONTENT_TYPE

_REQUEST: Final = re.compile(rb"GET /metrics(\?[^ \r\n]*)? HTTP/1\.[01]\r\n")
CACHED_S: Final = 1.0  # Prometheus asks each 15 s, a person who reloads a page twice a second
_QUEUED: Final = 8  # connections that the kernel holds; more are not taken


@dataclass(frozen=True, slots=True)
class ScrapeLimits:
    """What clients may do. pause_s: between two connections, so that a flood costs the cell nothing."""

    clients: int = 8  # at a time; Prometheus needs one, two of them and a person three
    pause_s: float = 0.05  # twenty a second; Prometheus asks each 15 s
    request_bytes: int = 4096  # Prometheus sends some 300
    request_s: float = 2.0  # for the whole of it, and for taking the answer


class Scrapes:
    """Serves what `text` makes, to whom asks for it rightly; counts the others by reason."""

    def __init__(
        self, text: Callable[["Scrapes"], bytes], limits: ScrapeLimits | None = None
    ) -> None:
        self.answered = 0
        self.dropped: Counter[str] = Counter()
        self._text = text
        self._limits = limits or ScrapeLimits()
        self._clients = 0
        self._cached = (0.0, b"")
        self._making = asyncio.Lock()

    async def serve(self, listening: socket.socket) -> None:
        """Serve at a listening socket until cancelled."""
        loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as clients:
            while True:
                try:
                    link, _ = await loop.sock_accept(listening)
                except OSError:  # it has gone, or there is no descriptor for it now
                    self.dropped["lost"] += 1
                else:
                    self._receive(link, clients)
                await asyncio.sleep(self._limits.pause_s)

    def _receive(self, link: socket.socket, clients: asyncio.TaskGroup) -> None:
        if self._clients >= self._limits.clients:
            self.dropped["busy"] += 1
            link.close()
            return
        self._clients += 1
        link.setblocking(False)
        clients.create_task(self._client(link))

    async def _client(self, link: socket.socket) -> None:
        """One connection, from its request to its end, whoever ends it."""
        try:
            async with asyncio.timeout(self._limits.request_s):
                if await self._is_right(link):
                    await asyncio.get_running_loop().sock_sendall(link, await self._answer())
                    self.answered += 1
                else:
                    self.dropped["garbage"] += 1
        except TimeoutError:
            self.dropped["timeouts"] += 1
        except OSError:
            self.dropped["lost"] += 1
        finally:
            link.close()
            self._clients -= 1

    async def _is_right(self, link: socket.socket) -> bool:
        """Read a request; whether it is the one that is answered."""
        received = b""
        while b"\r\n\r\n" not in received:
            if len(received) >= self._limits.request_bytes:
                return False
            chunk = await asyncio.get_running_loop().sock_recv(link, self._limits.request_bytes)
            if not chunk:
                return False
            received += chunk
        return _REQUEST.match(received) is not None

    async def _answer(self) -> bytes:
        """Made once for all who ask within the second: the cell is not asked more often."""
        loop = asyncio.get_running_loop()
        async with self._making:
            made_s, body = self._cached
            if loop.time() - made_s > CACHED_S or not body:
                body = await asyncio.to_thread(self._text, self)
                self._cached = (loop.time(), body)
        head = (
            "HTTP/1.1 200 OK",
            f"Content-Type: {CONTENT_TYPE}",
            f"Content-Length: {len(body)}",
            "Connection: close",
        )
        return "".join(f"{line}\r\n" for line in (*head, "")).encode() + body


def listening_at(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises ServingError where the address cannot be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, backlog=_QUEUED)
    except OSError as error:
        raise ServingError(
            f"metrics at {host}:{port}: {error.strerror}; change [metrics] host or port"
        ) from error
    listening.setblocking(False)
    return listening
