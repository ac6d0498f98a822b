"""The port of the metrics: rightly asked it answers, whatever else comes is dropped, counted, and hurts nobody."""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Coroutine

import pytest

from fakes.testing import free_port
from vgrd.errors import ServingError
from vgrd.metrics.server import ScrapeLimits, Scrapes, listening_at

RIGHT = b"GET /metrics HTTP/1.1\r\nHost: cell\r\nAccept: text/plain\r\n\r\n"
QUICK = ScrapeLimits(pause_s=0.001, request_s=0.5)


def serving(
    check: Callable[[Scrapes, int], Coroutine[object, object, None]],
    limits: ScrapeLimits = QUICK,
    text: Callable[[Scrapes], bytes] = lambda _: b"vgrd_x 1\n",
) -> None:
    """Run `check` beside a server, on its port."""

    async def run() -> None:
        with listening_at("127.0.0.1", 0) as listening:
            scrapes = Scrapes(text, limits)
            server = asyncio.create_task(scrapes.serve(listening))
            async with asyncio.timeout(60.0):
                await check(scrapes, listening.getsockname()[1])
            server.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await server

    asyncio.run(run())


async def ask(port: int, request: bytes, *, end: bool = False) -> bytes:
    """All that comes back."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request)
    if end:
        writer.write_eof()
    try:
        return await reader.read()
    except ConnectionResetError:
        return b""
    finally:
        writer.close()


def test_who_asks_rightly_is_answered() -> None:
    async def check(scrapes: Scrapes, port: int) -> None:
        answer = await ask(port, RIGHT)
        head, body = answer.split(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4")
        assert b"Content-Length: 9" in head
        assert body == b"vgrd_x 1\n"
        assert scrapes.answered == 1

    serving(check)


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET /metrics/../../etc/passwd HTTP/1.1\r\n\r\n",
        b"POST /metrics HTTP/1.1\r\nContent-Length: 9\r\n\r\n",
        b"get /metrics HTTP/1.1\r\n\r\n",
        b"GET /metrics HTTP/2\r\n\r\n",
        b"GET /metrics\r\n\r\n",
        b"\x00\x01\x00\x00\x00\x06\x01\x03\x00\x64\x00\x10" * 400,  # Modbus at the wrong port
        b"\x16\x03\x01" + b"\xff" * 5000,  # TLS
        b"A" * 5000,
        b"GET /metrics HTTP/1.1\r\n" + b"X: y\r\n" * 2000,
    ],
)
def test_anything_else_is_dropped_without_a_word(request_: bytes) -> None:
    async def check(scrapes: Scrapes, port: int) -> None:
        assert await ask(port, request_) == b""
        assert scrapes.dropped == {"garbage": 1}
        assert (await ask(port, RIGHT)).endswith(b"vgrd_x 1\n")

    serving(check)


@pytest.mark.parametrize("request_", [b"", b"GET /metr", RIGHT[:-1]])
def test_a_request_that_ends_early_or_never_is_dropped(request_: bytes) -> None:
    async def check(scrapes: Scrapes, port: int) -> None:
        assert await ask(port, request_, end=True) == b""
        assert await ask(port, request_) == b""
        assert scrapes.dropped == {"garbage": 1, "timeouts": 1}

    serving(check)


def test_more_than_may_come_at_a_time_are_closed_and_those_that_wait_are_let_go() -> None:
    limits = ScrapeLimits(clients=3, pause_s=0.001, request_s=0.5)

    async def check(scrapes: Scrapes, port: int) -> None:
        answers = await asyncio.gather(*(ask(port, b"GET") for _ in range(6)))
        assert answers == [b""] * 6
        assert scrapes.dropped["busy"] + scrapes.dropped["timeouts"] == 6
        assert scrapes.dropped["timeouts"] >= 3
        assert (await ask(port, RIGHT)).endswith(b"vgrd_x 1\n")

    serving(check, limits)


def test_who_asks_and_never_reads_is_let_go_and_others_are_answered_meanwhile() -> None:
    body = b"vgrd_x 1\n" * 2_000_000  # more than the kernel's buffers of both ends take

    async def check(scrapes: Scrapes, port: int) -> None:
        with contextlib.ExitStack() as links:
            for _ in range(QUICK.clients - 1):
                link = links.enter_context(socket.socket())
                link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                link.connect(("127.0.0.1", port))
                link.sendall(RIGHT)
            assert await ask(port, b"GET / HTTP/1.1\r\n\r\n") == b""
            while scrapes.dropped["timeouts"] < QUICK.clients - 1:
                assert await ask(port, b"GET / HTTP/1.1\r\n\r\n") == b""
        assert scrapes.dropped.keys() == {"garbage", "timeouts"}
        assert scrapes.dropped["timeouts"] == QUICK.clients - 1
        assert scrapes.answered == 0

    serving(check, text=lambda _: body)


def test_the_daemon_is_asked_once_however_many_ask() -> None:
    asked = []

    def text(_: Scrapes) -> bytes:
        asked.append(1)
        return b"x 1\n"

    async def check(scrapes: Scrapes, port: int) -> None:
        await asyncio.gather(*(ask(port, RIGHT) for _ in range(5)))
        assert scrapes.answered == 5

    serving(check, text=text)
    assert len(asked) <= 2  # a machine may be so busy that they take more than a second


def test_a_port_that_is_taken_is_named_with_the_remedy() -> None:
    with (
        socket.create_server(("127.0.0.1", free_port())) as taken,
        pytest.raises(ServingError, match=r"change \[metrics\] host or port"),
    ):
        listening_at("127.0.0.1", taken.getsockname()[1])
