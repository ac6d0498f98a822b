"""Whatever comes to the control socket is answered in words, and never harms the others."""

import asyncio
import json
import os
import re
import resource
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, closing, suppress
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fakes.testing import ManualClock
from vgrd.cell.control.lines import (
    ControlLimits,
    optional_number,
    optional_text,
    optional_whole,
    text_argument,
    whole_argument,
)
from vgrd.cell.control.operations import Operations
from vgrd.cell.control.server import ControlServer, Operation
from vgrd.errors import ControlError, NotSteady
from vgrd.ipc.control import ControlClient

LONG_S = 10.0  # a test that waits so long has failed
QUICK = ControlLimits(clients=3, request_bytes=2000, idle_s=0.2, line_s=0.1, taking_s=0.1)
PATIENT = ControlLimits(idle_s=LONG_S, line_s=LONG_S)


async def echo(arguments: Mapping[str, Any]) -> Mapping[str, Any]:
    return {
        "text": text_argument(arguments, "text", ""),
        "session": optional_text(arguments, "session"),
        "number": optional_number(arguments, "number"),
    }


async def singular(_: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"inverse": np.linalg.inv(np.zeros((2, 2))).tolist()}


async def unsteady(_: Mapping[str, Any]) -> Mapping[str, Any]:
    raise NotSteady("it moves")


async def unsendable(_: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"value": float("nan")}


async def large(_: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"text": "x" * (1 << 23)}


OPERATIONS = {
    "echo": Operation(echo, ("text", "session", "number")),
    "singular": Operation(singular),
    "unsteady": Operation(unsteady),
    "unsendable": Operation(unsendable),
    "large": Operation(large),
}


@asynccontextmanager
async def serving(folder: Path, limits: ControlLimits) -> AsyncIterator[ControlServer]:
    """A server in `folder`; a fault of it, also one that nobody would see, fails the test."""
    faults: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: faults.append(context))
    server = ControlServer(folder / "c.sock", OPERATIONS, limits)
    task = asyncio.create_task(server.serve())
    try:
        async with asyncio.timeout(LONG_S):
            await until(lambda: server.path.exists() or task.done())
            yield server
            assert not task.done(), task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await asyncio.sleep(0.01)  # for aborted connections to be closed
    assert faults == []


async def until(condition: Callable[[], object]) -> None:
    while not condition():  # noqa: ASYNC110  what is waited for knows nothing of the test
        await asyncio.sleep(0.002)


class Client:
    """One connection that sends bytes and reads replies."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def of(cls, server: ControlServer) -> "Client":
        return cls(*await asyncio.open_unix_connection(str(server.path), limit=1 << 24))

    async def ask(self, line: bytes) -> dict[str, Any]:
        self.writer.write(line + b"\n")
        return await self.reply()

    async def reply(self) -> dict[str, Any]:
        line = await self.reader.readline()
        assert line, "closed without a reply"
        return dict(json.loads(line))

    async def ended(self) -> bytes:
        return await self.reader.read()

    def close(self) -> None:
        self.writer.transport.abort()


def run(folder: Path, limits: ControlLimits, talk: Callable[[ControlServer], Awaitable[None]]):
    async def whole() -> None:
        async with serving(folder, limits) as server:
            await talk(server)

    asyncio.run(whole())


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b'{"id": NaN, "op": "echo"}', "NaN is no JSON number"),
        (b'{"id": 1e999, "op": "echo"}', "1e999 is no JSON number"),
        (b'{"id": 1, "op": "echo", "number": Infinity}', "Infinity is no JSON number"),
        (b'{"id": [1], "op": "echo"}', "id [1]"),
        (b'{"id": true, "op": "echo"}', "id True"),
        (b'{"id": "' + b"x" * 101 + b'", "op": "echo"}', "at most 100"),
        (b'{"id": 1}', "op must be the name"),
        (b'{"id": 1, "op": ["echo"]}', "op must be the name"),
        (b'{"id": 1, "op": "ecco"}', "unknown operation 'ecco'; known are: echo"),
        (b'{"id": 1, "op": "echo", "txet": "a"}', "unknown argument 'txet'; known are: text"),
        (b'{"id": 1, "op": "echo", "session": 5}', "'session' must be a text, got 5"),
        (b'{"id": 1, "op": "echo", "text": null}', "'text' must be a text, got None"),
        (b'{"id": 1, "op": "echo", "number": "nan"}', "'number' must be a number, got 'nan'"),
        (b'{"id": 1, "op": "echo", "number": true}', "'number' must be a number"),
        (b'{"id": 1, "op": "echo", "number": 1' + b"0" * 400 + b"}", "must be a number"),
        (b"", "not JSON"),
        (b"\xff\xfe\x00garbage\x80", "not JSON"),
        (b"[" * 1900, "not JSON"),
        (b"[]", "a JSON list, not an object"),
        (b'{"id": 1, "op": "unsteady"}', "it moves"),
    ],
)
def test_what_cannot_be_done_is_an_error_in_words_and_the_connection_lives(
    tmp_path: Path, line: bytes, words: str
) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        reply = await client.ask(line)
        assert reply["ok"] is False
        assert words in reply["message"]
        again = await client.ask(b'{"id": "two", "op": "echo", "text": "a", "number": "2.5"}')
        result = {"text": "a", "session": None, "number": 2.5}
        assert again == {"id": "two", "ok": True, "result": result}
        client.close()

    run(tmp_path, PATIENT, talk)


@pytest.mark.parametrize(
    ("op", "fault"),
    [("singular", "LinAlgError: Singular matrix"), ("unsendable", "NaN|nan|Out of")],
)
def test_a_fault_of_ours_reaches_the_user_as_one_and_the_connection_lives(
    tmp_path: Path, op: str, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        reply = await client.ask(b'{"id": 1, "op": "%s"}' % op.encode())
        assert reply["error"] == "InternalError"
        assert reply["id"] == 1
        assert "internal error in" in reply["message"]
        assert any(one in reply["message"] for one in fault.split("|"))
        assert "please report it" in reply["message"]
        assert (await client.ask(b'{"op": "echo"}'))["ok"]
        client.close()
        loop = asyncio.get_running_loop()
        call = loop.run_in_executor(None, lambda: ControlClient(server.path).call(op))
        with pytest.raises(ControlError) as told:
            await call
        assert (told.value.error, told.value.exit_code) == ("InternalError", 70)

    run(tmp_path, PATIENT, talk)
    if op == "singular":
        assert "Traceback" in "".join(capsys.readouterr())


def test_a_crowd_of_idle_clients_is_told_and_the_first_are_served_on(tmp_path: Path) -> None:
    async def talk(server: ControlServer) -> None:
        first = [await Client.of(server) for _ in range(3)]
        await until(lambda: server.clients == 3)
        for _ in range(100):
            late = await Client.of(server)
            reply = await late.reply()
            assert "3 clients are connected" in reply["message"]
            late.close()
        loop = asyncio.get_running_loop()
        with pytest.raises(ControlError, match="3 clients are connected"):
            await loop.run_in_executor(None, lambda: ControlClient(server.path).call("echo"))
        assert (await first[0].ask(b'{"op": "echo"}'))["ok"]
        first[1].close()
        await until(lambda: server.clients == 2)
        first[1] = await Client.of(server)
        assert (await first[1].ask(b'{"op": "echo"}'))["ok"]
        for client in first:
            client.close()

    limits = ControlLimits(clients=3)
    run(tmp_path, limits, talk)


def test_without_a_free_descriptor_clients_wait_and_the_server_lives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def talk(server: ControlServer) -> None:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        waiting = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        used = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        with closing(waiting):
            resource.setrlimit(resource.RLIMIT_NOFILE, (used - 1, hard))
            try:
                waiting.connect(str(server.path))
                waiting.sendall(b'{"op": "echo"}\n')
                await asyncio.sleep(0.3)
            finally:
                resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            loop = asyncio.get_running_loop()
            waiting.setblocking(False)
            assert b'"ok":true' in await loop.sock_recv(waiting, 4096)

    run(tmp_path, PATIENT, talk)


def test_the_cap_leaves_most_descriptors_to_the_cell(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, hard))
    try:
        assert ControlServer(tmp_path, {}).limits.clients == 16
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b'{"op": "echo"', "not complete within 0.1 s"),
        (b"x" * 3000, "more than 2000 bytes"),
        (b"x" * 3000 + b"\n", "more than 2000 bytes"),
        (bytes(range(11, 256)) * 10, "more than 2000 bytes"),
    ],
)
def test_a_line_that_does_not_end_or_is_huge_is_told_and_ends_the_connection(
    tmp_path: Path, sent: bytes, words: str
) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        client.writer.write(sent)
        assert words in (await client.reply())["message"]
        with suppress(ConnectionError):  # it had not read all of it
            assert await client.ended() == b""
        await until(lambda: server.clients == 0)
        client.close()

    run(tmp_path, QUICK, talk)


def test_a_request_cut_short_by_its_client_is_not_obeyed(tmp_path: Path) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        client.writer.write(b'{"op": "echo"}')
        client.writer.write_eof()
        assert "cut short" in (await client.reply())["message"]
        client.close()

    run(tmp_path, PATIENT, talk)


def test_an_idle_client_is_let_go(tmp_path: Path) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        assert await client.ended() == b""
        await until(lambda: server.clients == 0)
        client.close()

    run(tmp_path, QUICK, talk)


def test_a_client_that_takes_no_replies_is_dropped(tmp_path: Path) -> None:
    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        client.reader._transport.pause_reading()  # type: ignore[attr-defined]
        client.writer.write(b'{"op": "large"}\n')
        await until(lambda: server.clients == 1)
        await until(lambda: server.clients == 0)
        client.close()

    run(tmp_path, QUICK, talk)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
KEYS = st.sampled_from(["id", "op", "text", "session", "number"]) | st.text(max_size=5)
REQUESTS = st.dictionaries(KEYS, VALUES, max_size=5) | st.fixed_dictionaries(
    {"op": st.sampled_from(list(OPERATIONS)[:4])}, optional={"text": VALUES, "number": VALUES}
)
LINES = REQUESTS.map(lambda request: json.dumps(request).encode()) | st.binary(max_size=300).map(
    lambda data: data.replace(b"\n", b"?")
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(lines=st.lists(LINES, min_size=1, max_size=20), cut=st.integers(1, 40))
def test_every_line_of_any_bytes_in_any_pieces_gets_exactly_one_reply(
    tmp_path: Path, lines: list[bytes], cut: int
) -> None:
    stream = b"".join(line + b"\n" for line in lines)

    async def talk(server: ControlServer) -> None:
        client = await Client.of(server)
        for at in range(0, len(stream), len(stream) // cut + 1):
            client.writer.write(stream[at : at + len(stream) // cut + 1])
            await asyncio.sleep(0)
        for _ in lines:
            reply = await client.reply()
            assert isinstance(reply["ok"], bool)
            assert reply["ok"] or reply["message"]
        assert (await client.ask(b'{"id": "end", "op": "echo"}'))["id"] == "end"
        client.close()

    run(tmp_path, PATIENT, talk)


@pytest.mark.parametrize(("given", "told"), [(5, 5), ("12", 12), (3.0, 3), (None, None)])
def test_the_number_of_a_sample_is_whole(given, told):
    assert optional_whole({"sample": given}, "sample") == told


@pytest.mark.parametrize("given", [2.5, "last", True, [1]])
def test_what_is_no_whole_number_is_refused_by_its_name(given):
    with pytest.raises(ControlError, match="'sample' must be a"):
        optional_whole({"sample": given}, "sample")
    with pytest.raises(ControlError, match="'sample' must be a whole number, and is missing"):
        whole_argument({}, "sample")


def test_the_page_names_every_operation_with_its_arguments():
    page = Path(__file__).parents[3] / "docs" / "control-socket.md"
    told = {}
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("| `"):
            names, arguments = line.strip("| ").split(" | ")
            options = re.sub(r":.*?(?=[]]|, or |$)", "", arguments)  # which values there are
            for name in re.findall(r"`([a-z.]+)`", names):
                told[name] = set(re.findall(r"`([a-z_]+)`", options))
    parts = dict.fromkeys(signature(Operations).parameters)
    table = Operations(**parts | {"runtime_dir": Path(), "clock": ManualClock()}).table()
    assert told == {name: set(operation.arguments) for name, operation in table.items()}
