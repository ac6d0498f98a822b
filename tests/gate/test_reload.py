"""A changed table restarts what it changes and nothing else, on the same port, and is refused whole."""

import asyncio
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from vgrd.clock import SystemClock
from vgrd.gate.gate import Gate
from vgrd.gate.settings import (
    PROCESS_TABLE,
    WANTED_TABLE,
    GateSettings,
    ProcessSpec,
    load_settings,
    save_table,
)
from vgrd.gate.supervisor import Supervisor
from vgrd.gate.wanted import WantedTable

PATIENCE_S = 30.0
SLEEP = (sys.executable, "-c", "import time; time.sleep(3600)")


def spec(name: str, *more: str) -> ProcessSpec:
    return ProcessSpec(name, (*SLEEP, *more))


async def until(condition: Callable[[], object]) -> None:
    while not condition():  # noqa: ASYNC110  what is waited for knows nothing of the test
        await asyncio.sleep(0.005)


def table(port: int, *specs: ProcessSpec, loaded_unix_s: float = 1.0) -> dict[str, object]:
    return {
        "cell": "test",
        "loaded_unix_s": loaded_unix_s,
        "deadline_s": 0.25,
        "modbus": {"host": "127.0.0.1", "port": port, "allow": ["127.0.0.1"]},
        "processes": [{"name": one.name, "argv": list(one.argv)} for one in specs],
    }


def lines_at(line_port: object, made: dict[str, object]) -> dict[str, object]:
    address = made["modbus"]
    assert isinstance(address, dict)
    return {**made, "modbus": {**address, "line_port": line_port}}


def pids(supervisor: Supervisor) -> dict[str, int]:
    return {row.name: row.pid for row in supervisor.reports()}


def test_only_what_changed_is_started_again(tmp_path: Path) -> None:
    before = (spec("same"), spec("changed"), spec("gone"))
    after = (spec("same"), spec("changed", "other"), spec("new"))

    async def run() -> None:
        ends: list[int] = []
        supervisor = Supervisor(before, tmp_path, SystemClock(), lambda _: None, ends.append)
        running = asyncio.create_task(supervisor.run())
        try:
            await until(lambda: all(pids(supervisor).values()))
            old = pids(supervisor)
            await supervisor.change(after)
            assert set(pids(supervisor)) == {"same"}
            supervisor.start()
            await until(lambda: len(pids(supervisor)) == 3 and all(pids(supervisor).values()))
            new = pids(supervisor)
            assert new["same"] == old["same"]
            assert set(new) == {"same", "changed", "new"}
            assert new["changed"] != old["changed"]
        finally:
            await supervisor.stop()
            running.cancel()
        supervisor.start()  # a change that comes while all is being stopped starts nothing
        assert {row.state for row in supervisor.reports()} == {"stopped"}

    asyncio.run(asyncio.wait_for(run(), PATIENCE_S))


def test_a_process_that_waits_for_its_next_start_is_changed_without_waiting(
    tmp_path: Path,
) -> None:
    failing = ProcessSpec("one", ("/bin/false",))

    async def run() -> None:
        supervisor = Supervisor((failing,), tmp_path, SystemClock(), lambda _: None, print)
        running = asyncio.create_task(supervisor.run())
        await until(
            lambda: supervisor.reports()[0].state == "waiting" and supervisor.reports()[0].starts
        )
        await supervisor.change((spec("one"),))
        supervisor.start()
        await until(lambda: supervisor.reports()[0].state == "running")
        await supervisor.stop()
        running.cancel()

    asyncio.run(asyncio.wait_for(run(), PATIENCE_S))


def test_the_gate_takes_a_wanted_table_over_and_says_so(tmp_path: Path) -> None:
    async def run() -> None:
        save_table(tmp_path, table(0, spec("one")))
        gate = Gate(load_settings(tmp_path / PROCESS_TABLE), tmp_path, SystemClock())
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(gate.run())
            await until(lambda: all(pids(gate._supervisor).values()))
            old, bank = pids(gate._supervisor), gate._bank
            save_table(tmp_path, table(0, spec("one", "x"), loaded_unix_s=2.0), WANTED_TABLE)
            await until(lambda: gate._wanted.asked_unix_s == 2.0)
            assert gate._wanted.refused == ""
            await until(lambda: all(pids(gate._supervisor).values()))
            assert pids(gate._supervisor) != old
            assert gate._bank is not bank
            assert json.loads((tmp_path / PROCESS_TABLE).read_bytes())["loaded_unix_s"] == 2.0
            gate._stop.set()

    asyncio.run(asyncio.wait_for(run(), PATIENCE_S))


PRESENT = GateSettings("test", "127.0.0.1", 1502, ("127.0.0.1",), (spec("one"),))


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (table(1503, spec("one"), loaded_unix_s=3.0), "needs a restart"),
        (lines_at(1503, table(1502, spec("one"), loaded_unix_s=3.0)), "line_port needs a restart"),
        (lines_at("x", table(1502, loaded_unix_s=3.0)), "line_port: 'x' is not a int"),
        ({**table(1502, loaded_unix_s=3.0), "cell": 5}, "is not a str"),
    ],
)
def test_what_cannot_be_taken_over_is_refused_and_forgotten(
    tmp_path: Path, wanted: dict[str, object], words: str
) -> None:
    looking = WantedTable(tmp_path)
    assert looking.take(PRESENT) is None
    save_table(tmp_path, wanted, WANTED_TABLE)
    assert looking.take(PRESENT) is None
    assert words in looking.refused
    assert not (tmp_path / WANTED_TABLE).exists()
    assert not (tmp_path / PROCESS_TABLE).exists()
    save_table(tmp_path, table(1502, spec("one"), loaded_unix_s=4.0), WANTED_TABLE)
    taken = looking.take(PRESENT)
    assert taken is not None
    assert replace(taken, loaded_unix_s=0.0, processes=()) == replace(PRESENT, processes=())
    looking.mark_in_force(taken)
    assert (looking.asked_unix_s, looking.refused) == (4.0, "")
