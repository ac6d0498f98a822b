"""The gate's own life, in this process and without children: what ends it, and what must not."""

import asyncio
import contextlib
import os
import signal
import socket

import pytest

from vgrd.clock import SystemClock
from vgrd.gate.gate import Gate, LastUse
from vgrd.gate.settings import GateSettings, ProcessSpec
from vgrd.gate.systemd import ServiceManager

PATIENCE_S = 20.0


def settings(*processes: ProcessSpec) -> GateSettings:
    return GateSettings("test", "127.0.0.1", 0, ("127.0.0.1",), processes)


@pytest.fixture
def manager(tmp_path, monkeypatch):
    """A service manager whose queue is full: it reads nothing until the test lets it."""
    path = tmp_path / "notify"
    monkeypatch.setenv("NOTIFY_SOCKET", str(path))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(path))
        heard.setblocking(False)
        yield heard


def fill(manager: socket.socket) -> None:
    """Until a new sender is refused at its first message: not its own buffer is full then."""
    sent = 1
    while sent:
        sent = 0
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
            other.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    sent += other.sendto(b"X=full", manager.getsockname())


def drain(manager: socket.socket) -> list[str]:
    heard = []
    while True:
        try:
            heard.append(manager.recv(4096).decode())
        except BlockingIOError:
            return [line for message in heard for line in message.splitlines()]


async def until(condition) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.02)


def test_what_a_full_service_manager_did_not_take_is_told_later(manager):
    fill(manager)
    told = ServiceManager()
    assert not told.tell(READY="1", STATUS="one")
    assert not told.tell(WATCHDOG="1", STATUS="two")
    drain(manager)
    assert told.catch_up()
    assert sorted(drain(manager)) == ["READY=1", "STATUS=two", "WATCHDOG=1"]
    assert told.catch_up()
    assert drain(manager) == []


def test_a_service_manager_that_is_gone_ends_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    assert not ServiceManager().tell(WATCHDOG="1")


def test_a_full_notify_queue_ends_neither_the_start_nor_the_watchdog(
    tmp_path, manager, monkeypatch
):
    monkeypatch.setenv("WATCHDOG_USEC", "100000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)

    async def run() -> None:
        gate = Gate(settings(), tmp_path, SystemClock())
        async with asyncio.TaskGroup() as tasks:
            running = tasks.create_task(gate.run())
            for _ in range(2):
                fill(manager)
                await asyncio.sleep(0.3)
                assert not running.done()
                drain(manager)
                await until(lambda: "WATCHDOG=1" in drain(manager))
            os.kill(os.getpid(), signal.SIGTERM)

    asyncio.run(run())


@pytest.mark.parametrize("chore", ["_bank.refresh", "_server.sweep", "_report", "_log_abuse"])
def test_a_chore_that_fails_ends_the_gate(tmp_path, monkeypatch, chore):
    class ChoreError(Exception):
        pass

    def fail(*_: object) -> None:
        raise ChoreError(chore)

    async def run() -> None:
        gate = Gate(settings(), tmp_path, SystemClock())
        owner, name = gate, chore
        if "." in chore:
            attribute, name = chore.split(".")
            owner = getattr(gate, attribute)
        monkeypatch.setattr(owner, name, fail)
        async with asyncio.timeout(PATIENCE_S):
            await gate.run()

    with pytest.raises(ExceptionGroup) as caught:
        asyncio.run(run())
    assert caught.group_contains(ChoreError)


def test_a_callback_that_fails_ends_the_gate(tmp_path):
    class CallbackError(Exception):
        pass

    def fail() -> None:
        raise CallbackError

    async def run() -> None:
        gate = Gate(settings(), tmp_path, SystemClock())
        asyncio.get_running_loop().call_later(0.1, fail)
        async with asyncio.timeout(PATIENCE_S):
            await gate.run()

    with pytest.raises(CallbackError):
        asyncio.run(run())


def test_stopping_does_not_wait_for_the_next_start_of_a_process(tmp_path):
    async def run() -> None:
        gate = Gate(settings(ProcessSpec("robot", ("/bin/false",))), tmp_path, SystemClock())
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(gate.run())
            await until(lambda: gate._supervisor.reports()[0].exit_code == 1)
            await until(lambda: gate._supervisor.reports()[0].state == "waiting")
            os.kill(os.getpid(), signal.SIGTERM)

    asyncio.run(asyncio.wait_for(run(), PATIENCE_S))


def test_when_a_robot_asked_and_read_last_is_told_by_what_was_counted():
    use = LastUse()
    assert use.times(0, 0, 1.0) == (None, None)
    assert use.times(0, 5, 2.0) == (None, 2.0)
    assert use.times(1, 5, 3.0) == (3.0, 2.0)
    assert use.times(1, 5, 4.0) == (3.0, 2.0)
    assert use.times(0, 0, 5.0) == (3.0, 2.0)  # a bank that begins anew: nobody asked
    assert use.times(1, 1, 6.0) == (6.0, 6.0)
