"""The registers while a fake cell fails on demand: invalid within the deadline, and good again."""

import os
import signal
import time

import pytest

from fakes.cell.processes import is_alive
from tests.gate.process.gate_process import (
    COMES_WITHIN_S,
    DEADLINE_S,
    MARGIN_S,
    GateProcess,
    answered,
    ask,
    cell,
    see,
    served,
    until,
)
from vgrd.registers import RESPONSE, State, Status

pytestmark = pytest.mark.system

HANG_WITH_GIL, ABORT, EXIT, STOP, SILENT, CONFIG, IGNORE_TERM = range(66, 73)


def test_a_request_is_answered_with_the_cells_coordinate(gate):
    with gate.client() as client:
        v = served(client, 1, 5)
        assert (v["STATUS"], v["EC32_X"], v["EC16_RZ"]) == (Status.OK, 5000, 1571)
        beats: set[float] = set()
        until(lambda: beats.add(see(client)["HB"]) or len(beats) > 3)


@pytest.mark.parametrize(
    ("fault", "recovers"),
    [(HANG_WITH_GIL, True), (ABORT, True), (EXIT, True), (STOP, True), (CONFIG, False)],
    ids=["hangs holding the GIL", "aborts", "exits", "is stopped", "has a bad configuration"],
)
def test_a_failed_cell_is_invalid_within_the_deadline_and_the_gate_answers_on(
    gate, fault, recovers, record_property, stopwatch
):
    with gate.client() as robot, gate.client() as saboteur:
        assert served(robot, 11, 5)["STATUS"] == Status.OK
        pid = gate.pid("cell")
        begin = time.monotonic()
        ask(saboteur, 2, fault)
        slowest, v = 0.0, {}
        while v.get("ECHO") != 2:
            sent = time.monotonic()
            assert sent < begin + COMES_WITHIN_S
            v = see(robot)
            slowest = max(slowest, time.monotonic() - sent)
            assert v["STATUS"] not in (Status.OK, Status.OK_DEGRADED)
            assert v["EC32_X"] == -(2**31)
        took_s = time.monotonic() - begin
        record_property("ms_to_invalid", round(took_s * 1000))
        stopwatch.judge("a failed cell is told", took_s, DEADLINE_S + MARGIN_S)
        stopwatch.judge("slowest answer of the gate", slowest, MARGIN_S)
        assert v["STATUS"] in (Status.INTERNAL_ERROR, Status.CONFIG_ERROR)
        if recovers:
            until(lambda: see(robot)["STATE"] & State.READY)
            assert gate.row("cell").pid != pid or until(lambda: gate.row("cell").starts == 2)
            assert not is_alive(pid)
            assert see(robot)["ECHO"] == 2
            assert served(robot, 31, 6)["EC32_X"] == 6000
        else:
            until(lambda: gate.row("cell").state == "stopped")
            assert see(robot)["STATUS"] == Status.CONFIG_ERROR


def test_a_robot_that_asks_faster_than_the_cell_reads_gets_its_last_answer(tmp_path):
    """500 requests into a pause of the cell; the deadline must not hide that they are passed on."""
    row = cell(tmp_path, hang_s=30.0)
    with GateProcess(tmp_path, [row], deadline_s=30.0) as gate, gate.client() as client:
        until(lambda: see(client)["STATE"] == State.READY)
        ask(client, 1, 5)
        answered(client, 1)
        pid = gate.pid("cell")
        os.kill(pid, signal.SIGSTOP)
        for trig in range(2, 502):
            client.write(0, [trig])
        os.kill(pid, signal.SIGCONT)
        assert answered(client, 501)["STATUS"] == Status.OK
        assert (gate.row("cell").pid, gate.row("cell").starts) == (pid, 1)


def test_rings_deleted_before_the_cell_restarts_are_followed(gate):
    with gate.client() as client:
        for ring in (gate.runtime_dir / "registers.ring", gate.runtime_dir / "health/cell.ring"):
            ring.unlink()
        os.kill(gate.pid("cell"), signal.SIGKILL)
        until(lambda: see(client)["STATUS"] == Status.INTERNAL_ERROR)
        until(lambda: see(client)["STATE"] & State.READY)
        ask(client, 1, 5)
        assert answered(client, 1)["STATUS"] == Status.OK
        until(lambda: gate.row("cell").health == "ok")


def test_an_unanswered_request_ends_with_timeout(gate, stopwatch):
    with gate.client() as client:
        for trig in range(1, 20):
            served(client, 100 * trig, 5)
            begin = time.monotonic()
            ask(client, trig, SILENT, timeout_ms=300)
            v = answered(client, trig)
            took_s = time.monotonic() - begin
            if v["STATUS"] != Status.INTERNAL_ERROR:  # the machine is busy and the cell was late
                break
        assert v["STATUS"] == Status.TIMEOUT
        assert took_s > 0.29
        stopwatch.judge("the timeout", took_s, 0.3 + MARGIN_S)


def test_the_gates_report_holds_what_robots_read(gate):
    with gate.client() as client:
        shown = served(client, 7, 1)

        def told() -> dict[str, float] | None:
            block = bytes.fromhex(gate.report().registers)
            values = RESPONSE.decode(block) if block else {}
            return values if values.get("ECHO") == 7 else None

        reported = until(told)
        live = ("AGE", "HB", "STATE")
        assert {k: v for k, v in reported.items() if k not in live} == {
            k: v for k, v in shown.items() if k not in live
        }
        report = gate.report()
        assert report.request_s <= report.read_s <= time.monotonic()
