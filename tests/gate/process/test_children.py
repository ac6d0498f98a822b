"""The gate's children: restarted when they hang or die, and gone when it stops or is killed."""

import signal
import time
from itertools import pairwise

import pytest

from fakes.cell.processes import is_alive
from tests.gate.process.gate_process import (
    COMES_WITHIN_S,
    HANG_DEVICE,
    GateProcess,
    cell,
    script,
    see,
    until,
)
from vgrd.gate.supervisor import FIRST_DELAY_S, GROWTH
from vgrd.registers import State, Status

pytestmark = pytest.mark.system

DELAYS_S = [FIRST_DELAY_S * GROWTH**k for k in range(3)]


def test_a_device_that_hangs_is_killed_and_restarted_while_the_registers_go_on(tmp_path):
    calm = cell(tmp_path, hang_s=COMES_WITHIN_S)
    processes = [calm, script("camera", HANG_DEVICE, hang_s=0.3, start_s=0.4)]
    with GateProcess(tmp_path, processes) as gate, gate.client() as client:
        first = until(lambda: gate.row("camera").pid)
        until(lambda: gate.row("camera").starts > 1)
        assert gate.row("camera").hangs >= 1
        assert not is_alive(first)
        until(lambda: see(client)["STATE"] == State.READY)
        assert gate.row("cell").starts == 1


def test_a_device_that_dies_is_restarted_later_each_time(tmp_path):
    code = (
        f"import time; open({str(tmp_path / 'starts')!r}, 'a').write(f'{{time.monotonic()}}\\n')"
    )
    refused = script("camera", "raise SystemExit(69)")
    with GateProcess(tmp_path, [script("robot", code), refused]) as gate:
        starts = until(
            lambda: (
                (t := (tmp_path / "starts"))
                and t.exists()
                and len(lines := t.read_text().split()) > 3
                and lines
            )
        )
        gaps = [float(b) - float(a) for a, b in pairwise(starts)]
        assert all(gap > delay for gap, delay in zip(gaps, DELAYS_S, strict=False))
        assert gate.row("camera").starts == 1
        assert gate.row("camera").exit_code == 69


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_stopping_is_clean_and_quick_though_children_ignore_it(tmp_path, number, stopwatch):
    device = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(60)"
    processes = [cell(tmp_path), script("robot", device), script("camera", HANG_DEVICE)]
    with GateProcess(tmp_path, processes) as gate:
        until(lambda: gate.row("cell").health == "ok")
        report = gate.report()
        assert report is not None
        stopwatch.judge("the gate stops", gate.stop(number), 3.0)
        assert gate.process.returncode == 0
        assert not any(is_alive(row.pid) for row in report.processes)


def test_while_stopping_the_registers_say_so(tmp_path):
    device = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(60)"
    with GateProcess(tmp_path, [cell(tmp_path), script("robot", device)]) as gate:
        with gate.client() as client:
            until(lambda: see(client)["STATE"] == State.READY)
            time.sleep(0.2)  # the device must have got to its signal handler
            gate.process.send_signal(signal.SIGTERM)
            assert until(lambda: see(client)["STATUS"] == Status.SHUTTING_DOWN)
        gate.process.wait(COMES_WITHIN_S)


def test_no_orphan_survives_the_gate_killed_with_sigkill(tmp_path, stopwatch):
    processes = [cell(tmp_path), script("camera", HANG_DEVICE)]
    with GateProcess(tmp_path, processes) as gate:
        until(lambda: gate.row("cell").health == "ok")
        report = gate.report()
        assert report is not None
        gate.process.kill()
        gate.process.wait()
        killed = time.monotonic()
        until(lambda: not any(is_alive(row.pid) for row in report.processes))
        stopwatch.judge("the children are gone", time.monotonic() - killed, 2.0)


def test_what_a_dead_child_had_started_dies_too(tmp_path):
    path = tmp_path / "grandchild"
    code = (
        "import subprocess, sys, os\n"
        "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(path)!r}, 'w').write(str(p.pid))\n"
        "os._exit(1)"
    )
    with GateProcess(tmp_path, [script("robot", code)]):
        pid = int(until(lambda: path.exists() and path.read_text()))
        until(lambda: not is_alive(pid))
