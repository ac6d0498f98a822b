"""The link to the cell, over a real socket pair."""

import asyncio
import itertools
import json
import socket

import pytest

from vgrd.gate.link import CellLink


def send_until_stuck(link: CellLink, limit: int = 5000) -> int:
    """Send numbered messages while the cell sleeps, far more than a socket's buffer holds."""
    for number in range(limit):
        assert link.send(op="request", number=number, padding="x" * 128)
    return limit - 1


async def read_lines(theirs: socket.socket, until: int, chunk: int = 65536) -> list[dict]:
    """Read as the cell, in pieces, until message `until`."""
    loop, received, lines = asyncio.get_running_loop(), b"", []
    while not lines or lines[-1]["number"] != until:
        piece = await asyncio.wait_for(loop.sock_recv(theirs, chunk), 5)
        assert piece, "the gate hung up"
        *whole, received = (received + piece).split(b"\n")
        lines += map(json.loads, whole)
    return lines


@pytest.fixture
def pair():
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    yield ours, theirs
    ours.close()
    theirs.close()


@pytest.mark.parametrize("chunk", [65536, 7])
def test_a_cell_that_pauses_finds_the_newest_request_and_hardly_an_older_one(pair, chunk):
    async def run() -> None:
        ours, theirs = pair
        link = CellLink(ours, lambda _: None)
        for begin in range(3):
            last = send_until_stuck(link)
            lines = await read_lines(theirs, last, chunk)
            numbers = [line["number"] for line in lines]
            assert numbers == sorted(numbers), begin
            assert len(numbers) < 20
        link.close()

    asyncio.run(run())


def test_nothing_grows_between_gate_and_cell(pair):
    async def run() -> None:
        ours, theirs = pair
        link = CellLink(ours, lambda _: None)
        send_until_stuck(link)
        theirs.setblocking(False)
        waiting = len(theirs.recv(1 << 22))
        assert waiting < 16384
        assert len(link._sending) + len(link._newest) < 1024
        link.close()

    asyncio.run(run())


def test_an_abort_takes_the_place_of_the_requests_before_it(pair):
    async def run() -> None:
        ours, theirs = pair
        link = CellLink(ours, lambda _: None)
        send_until_stuck(link)
        assert link.send(op="abort", number=-1)
        lines = await read_lines(theirs, -1)
        assert lines[-1]["op"] == "abort"
        assert 4999 not in [line["number"] for line in lines]
        link.close()

    asyncio.run(run())


def test_a_line_that_does_not_fit_the_buffer_arrives_whole(pair):
    async def run() -> None:
        ours, theirs = pair
        link = CellLink(ours, lambda _: None)
        assert link.send(op="request", number=1, padding="x" * 300_000)
        assert link.send(op="request", number=2)
        lines = await read_lines(theirs, 2)
        assert [(line["number"], len(line.get("padding", ""))) for line in lines] == [
            (1, 300_000),
            (2, 0),
        ]
        link.close()

    asyncio.run(run())


def test_a_cell_that_hangs_up_is_gone(pair):
    async def run() -> None:
        ours, theirs = pair
        link = CellLink(ours, lambda _: None)
        theirs.close()
        for _ in itertools.takewhile(lambda _: link.send(op="abort"), range(100)):
            await asyncio.sleep(0.01)
        assert not link.send(op="abort")

    asyncio.run(run())


def test_what_the_cell_says_arrives_line_by_line_and_nonsense_is_dropped(pair):
    async def run() -> None:
        ours, theirs = pair
        heard = []
        link = CellLink(ours, heard.append)
        for piece in (b'{"op":"rea', b'dy"}\nnonsense\n{"op":"x"}', b"\n"):
            theirs.send(piece)
            await asyncio.sleep(0.01)
        assert heard == [{"op": "ready"}, {"op": "x"}]
        link.close()

    asyncio.run(run())
