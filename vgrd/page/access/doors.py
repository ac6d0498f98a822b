"""ASGI middleware of a page that is reached over the network: limits for each address, and a mark for each browser."""

import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final

import structlog
from fastapi import Response

from vgrd.clock import Clock
from vgrd.page import texts
from vgrd.page.access.buckets import Buckets

# A browser asks 30 times a second, pulses and pictures: six behind one address, and time to catch up.
RATE_HZ: Final = 200.0
MOST: Final = 600.0
PAGE_COST: Final = (
    50.0  # a screen, or the framework's page of an error, takes as long as so many pulses
)
_CHEAP: Final = ("/pulse", "/frame", "/assets/", "/_nicegui")
COOKIE: Final = "__Host-vgrd"  # by this prefix no other host can set it, nor anything without TLS
_MARK: Final = re.compile(r"[A-Za-z0-9_-]{43}")  # as `secrets.token_urlsafe(32)` gives
# Of this name alone: other services of the machine may be without TLS.
_TLS_ONLY: Final = (b"strict-transport-security", b"max-age=31536000")

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]

log = structlog.get_logger()


class Doors:
    """Who asks too much gets 429, by HTTP, or loses the websocket. The mark is in `request.state.mark`."""

    def __init__(self, inner: Callable[..., Awaitable[None]], clock: Clock) -> None:
        self._inner, self._buckets = inner, Buckets(clock, RATE_HZ, MOST)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Pass on what is not too much."""
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        address = scope["client"][0] if scope.get("client") else "?"
        if not self._may(address, 1.0 if scope["path"].startswith(_CHEAP) else PAGE_COST):
            await _refuse(scope, receive, send)
        elif scope["type"] == "http":
            await self._inner(scope, receive, _marking(scope, send))
        else:
            await self._inner(scope, self._limited(receive, address), send)

    def _may(self, address: str, cost: float = 1.0) -> bool:
        may = self._buckets.take(address, cost)
        if not may:
            log.warning("too_many_requests", address=address)
        return may

    def _limited(self, receive: Receive, address: str) -> Receive:
        async def receiving() -> Message:
            message = await receive()
            if message["type"] == "websocket.receive" and not self._may(address):
                return {"type": "websocket.disconnect", "code": 1008}
            return message

        return receiving


async def _refuse(scope: Message, receive: Receive, send: Send) -> None:
    if scope["type"] == "http":
        await Response(texts.TOO_MANY, 429, {"Retry-After": "2"})(scope, receive, send)
    else:
        await send({"type": "websocket.close", "code": 1008})


def _marking(scope: Message, send: Send) -> Send:
    """Tell the page who its browser is; one that is new is given a mark with the page."""
    mark = _mark_in(scope["headers"])
    more = [_TLS_ONLY]
    if mark is None:
        mark = secrets.token_urlsafe(32)
        cookie = f"{COOKIE}={mark}; Path=/; Secure; HttpOnly; SameSite=Strict"
        if scope["path"] == "/":
            more.append((b"set-cookie", cookie.encode()))
    scope.setdefault("state", {})["mark"] = mark

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return sending


def _mark_in(headers: list[tuple[bytes, bytes]]) -> str | None:
    """The mark that a browser sends, None where it sends none that we could have made."""
    for name, value in headers:
        if name == b"cookie":
            for part in value.decode("latin-1").split(";"):
                key, _, mark = part.strip().partition("=")
                if key == COOKIE and _MARK.fullmatch(mark):
                    return mark
    return None
