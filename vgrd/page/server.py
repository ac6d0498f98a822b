"""The page's server: one screen for each browser, the pulse that its watchdog asks for, pictures, headers."""

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable, Collection
from pathlib import Path
from typing import Any, Final

import structlog
from fastapi import Request, Response
from nicegui import app, ui

from vgrd.clock import Clock
from vgrd.errors import ControlError, ServingError
from vgrd.ipc.health import PERIOD_S, HealthReporter
from vgrd.page import texts
from vgrd.page.access.doors import Doors
from vgrd.page.access.terms import Terms
from vgrd.page.link import Link, Reply
from vgrd.page.screen import Screen
from vgrd.page.visitor import Visitor

ASSETS: Final = Path(__file__).with_name("assets")
SMALL_PX: Final = 40.0  # of a tag's edge, as `vgrd detect` calls it (docs/fit.md)
OLD_S: Final = 2.0  # of a picture: a moment ago for who looks, not now any more
OLD_PERIODS: Final = 3.0  # of a cell that takes few pictures
MOST_AGE_MS: Final = 10**7  # of what was never heard; JSON has no infinity
_ANY_SCHEME: Final = ("http", "https")  # without TLS of ours there may be a proxy that has it
_HEADERS: Final = {
    # The page's framework compiles its templates in the browser and writes styles into elements.
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws: wss:; object-src 'none'; base-uri 'self'; form-action 'self'; "
    "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}
_HEAD: Final = (
    f"<script>document.documentElement.lang={json.dumps(texts.LANGUAGE)};"
    f"document.documentElement.dataset.noLink={json.dumps(texts.NO_LINK)};"
    f"document.documentElement.dataset.oldPicture={json.dumps(texts.OLD_PICTURE)}</script>"
    '<link rel="stylesheet" href="/assets/page.css"><script src="/assets/watchdog.js"></script>'
)

log = structlog.get_logger()


class OnlyHere:
    """ASGI middleware: whoever comes under another name, or from another page, gets nothing, by HTTP or websocket.

    Even where the address is loopback, any page in the same browser can ask it, under a name that leads here.
    """

    def __init__(
        self,
        inner: Callable[..., Awaitable[None]],
        hosts: frozenset[str],
        schemes: tuple[str, ...] = _ANY_SCHEME,
    ) -> None:
        self._inner, self._hosts, self._schemes = inner, hosts, schemes

    async def __call__(self, scope: dict, receive: Callable, send: Callable) -> None:  # type: ignore[type-arg]
        """Pass on what is ours."""
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        came_from_us = origin is None or origin in {f"{kind}://{host}" for kind in self._schemes}
        if host in self._hosts and came_from_us:
            await self._inner(scope, receive, _with_headers(send))
        elif scope["type"] == "http":
            await Response("not served under this name", 403)(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1008})


def _with_headers(send: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
    async def sending(message: dict) -> None:  # type: ignore[type-arg]
        if message["type"] == "http.response.start":
            more = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return sending


def serve(
    link: Link, health: HealthReporter, host: str, port: int, terms: Terms, clock: Clock
) -> None:
    """Serve until killed. Raises ServingError where the address cannot be had, or a file of `terms` is not good."""
    guard = terms.guard(host, clock)
    _check_free(host, port)
    app.add_static_files("/assets", ASSETS, max_cache_age=0)
    hosts = names_of(host, port, terms.names)
    app.add_middleware(OnlyHere, hosts=hosts, schemes=("https",) if guard else _ANY_SCHEME)
    if guard is not None:
        app.add_middleware(Doors, clock=clock)
    app.on_startup(lambda: _work(link, health))

    @app.get("/pulse")
    def _pulse() -> Response:
        return pulse(link)

    @app.get("/report")
    async def _report(session: str = "") -> Response:
        return await report(link, session)

    @app.get("/frame")
    async def _frame(after: int = -1) -> Response:
        return await frame(link, after)

    @ui.page("/", title=texts.TITLE, response_timeout=20)
    def screen(request: Request) -> None:
        ui.add_head_html(_HEAD)
        address = request.client.host if request.client else "?"
        mark = request.state.mark if guard is not None else ""
        Screen(Visitor(link, address, guard, mark))

    log.info("showing_page", host=host, port=port, tls=guard is not None)
    ui.run(
        host=host,
        port=port,
        title=texts.TITLE,
        dark=None,
        reload=False,
        show=False,
        show_welcome_message=False,
        binding_refresh_interval=None,
        reconnect_timeout=5.0,
        access_log=False,
        **({} if guard is None else _over_network(terms)),
    )
    raise ServingError(f"page at {host}:{port}: cannot be served; change [page] port")


def _over_network(terms: Terms) -> dict[str, Any]:
    """Nobody may say that he asks for another address: lock-out and limits go by it."""
    return {
        "ssl_certfile": terms.certificate,
        "ssl_keyfile": terms.key,
        "proxy_headers": False,
    }


def _check_free(host: str, port: int) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
    except OSError as error:
        raise ServingError(
            f"page at {host}:{port}: {error.strerror}; change [page] host or port"
        ) from error


def names_of(host: str, port: int, names: Collection[str] = ()) -> frozenset[str]:
    """What a browser may call us by."""
    called = (host, "localhost", "127.0.0.1", *names)
    return frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in called)


async def _work(link: Link, health: HealthReporter) -> None:
    """Follow the daemon, and tell the gate that this loop turns."""
    async with asyncio.TaskGroup() as tasks:
        following = tasks.create_task(link.follow())
        while not following.done():
            health.progress("ok")
            await asyncio.sleep(PERIOD_S)


def pulse(link: Link) -> Response:
    """How old is what the page shows; milliseconds."""
    age_ms = round(min(MOST_AGE_MS, 1e3 * link.age_s))
    return Response(
        json.dumps({"age_ms": age_ms, "now_ms": 1e3 * link.now_s}), media_type="application/json"
    )


async def frame(link: Link, after: int) -> Response:
    """The newest picture as JPEG, what is in it in a header; 204 where there is no other than the one that is shown."""
    picture = await link.newest_picture(after)
    if picture is None:
        return Response(status_code=204)
    facts = {key: picture.facts[key] for key in ("frame", "taken_unix_s", "width_px", "height_px")}
    facts |= {"tags": picture.facts["tags"], "words": picture_in_words(picture.facts)}
    facts["age_ms"] = round(1e3 * (link.now_s - picture.taken_s))
    facts["old_ms"] = round(1e3 * max(OLD_S, OLD_PERIODS * picture.facts["period_s"]))
    headers = {"X-Facts": json.dumps(facts), "Cache-Control": "no-store"}
    return Response(picture.jpeg, media_type="image/jpeg", headers=headers)


async def report(link: Link, session: str) -> Response:
    """The page to print; 404 with the reason where there is none."""
    try:
        told = await link.ask("report", **({"session": session} if session else {}))
    except ControlError as refusal:
        return Response(str(refusal), 404, media_type="text/plain")
    return Response(told["html"], media_type="text/html")


def picture_in_words(facts: Reply) -> str:
    """Which tags it shows, and how well."""
    tags = [_tag_in_words(name.upper(), tag) for name, tag in facts["tags"].items()]
    return "; ".join([*tags, texts.AT_REST if facts["robot_at_rest"] else texts.MOVES])


def _tag_in_words(name: str, tag: Reply) -> str:
    if not tag["corners"]:
        return texts.NOT_SEEN.format(name=name, wanted=tag["wanted"])
    small = texts.SMALL if tag["side_px"] < SMALL_PX else ""
    return texts.SEEN.format(
        name=name, wanted=tag["wanted"], side=tag["side_px"], small=small, fit=tag["fit_px"]
    )
