"""The gate as a process, with a fake cell that fails on demand."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from fakes.cell.processes import is_alive
from fakes.controllers.raw_modbus import RawModbus
from vgrd.errors import IpcError
from vgrd.gate.supervisor import FIRST_DELAY_S, GROWTH
from vgrd.ipc.messages import GATE_KIND, GATE_RING, GateReport, ProcessReport
from vgrd.ipc.ring import RingReader
from vgrd.orphans import dying_with_us
from vgrd.registers import RESPONSE, Command, State, Status

HERE = Path(__file__).parent
DEADLINE_S = 0.25
DELAYS_S = [FIRST_DELAY_S * GROWTH**k for k in range(3)]
# What a fault may take beyond the deadline on a busy machine.
MARGIN_S = 0.35
COMES_WITHIN_S = 60.0
HANG_WITH_GIL, ABORT, EXIT, STOP, SILENT, CONFIG, IGNORE_TERM = range(66, 73)
HANG_DEVICE = "import ctypes; ctypes.PyDLL(None).pause()"

pytestmark = pytest.mark.system


class GateProcess:
    """`python -m vgrd.gate` on a folder of its own; killed at the end of the `with`."""

    def __init__(
        self,
        runtime_dir: Path,
        processes: list[dict],
        env: dict[str, str] | None = None,
        deadline_s: float = DEADLINE_S,
    ):
        self.runtime_dir = runtime_dir
        self.env = {**os.environ, **(env or {})}
        runtime_dir.mkdir(exist_ok=True)
        table = {
            "cell": "test",
            "deadline_s": deadline_s,
            "modbus": {"host": "127.0.0.1", "port": 0, "allow": ["127.0.0.1"]},
            "processes": processes,
        }
        (runtime_dir / "processes.json").write_text(json.dumps(table))

    def __enter__(self) -> "GateProcess":
        self.log = (self.runtime_dir / "gate.log").open("a")
        self.process = subprocess.Popen(
            dying_with_us([sys.executable, "-m", "vgrd.gate", str(self.runtime_dir)]),
            stderr=self.log,
            env=self.env,
        )
        self.port = until(lambda: self.report()).port
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.log.close()

    def report(self) -> GateReport | None:
        """Return what this very gate says about itself, None before it says anything."""
        try:
            with RingReader.open(self.runtime_dir / GATE_RING, GATE_KIND) as ring:
                message = ring.newest()
        except IpcError:
            return None
        report = GateReport.unpack(message.payload) if message else None
        return report if report and report.pid == self.process.pid else None

    def row(self, name: str) -> ProcessReport:
        """Return one row of the process table."""
        report = self.report()
        assert report is not None
        return next(row for row in report.processes if row.name == name)

    def pid(self, name: str) -> int:
        """Id of a process that runs; one that waits for its start has none, and 0 would mean us all."""
        return until(lambda: self.row(name).pid)

    def client(self) -> RawModbus:
        """Connect."""
        return RawModbus("127.0.0.1", self.port)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> float:
        """Ask it to stop and return how long that took."""
        begin = time.monotonic()
        self.process.send_signal(number)
        self.process.wait(COMES_WITHIN_S)
        return time.monotonic() - begin


def until(condition, timeout_s: float = COMES_WITHIN_S):
    """First true value of `condition`."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.01)
    raise AssertionError("it did not come true in time")


def cell(runtime_dir: Path, **more) -> dict:
    argv = [sys.executable, str(HERE / "fake_cell.py"), str(runtime_dir)]
    return {"name": "cell", "argv": argv, "kind": "cell", "hang_s": 1.0, **more}


def script(name: str, code: str, **more) -> dict:
    return {"name": name, "argv": [sys.executable, "-c", code], "kind": "device", **more}


def see(client: RawModbus) -> dict[str, float]:
    return RESPONSE.decode(client.read(100, 68))


def ask(client: RawModbus, trig: int, point: int, **more) -> None:
    client.write(0, [trig, Command.EC_FRESH, point, 0, 0, 0, 0, 0, 0, more.get("timeout_ms", 0)])


def answered(client: RawModbus, trig: int) -> dict[str, float]:
    return until(lambda: (v := see(client))["ECHO"] == trig and v)


def served(client: RawModbus, trig: int, point: int) -> dict[str, float]:
    """A good answer; asked for again, with the next trigger, where a busy machine lost the cell or the time."""
    end = time.monotonic() + COMES_WITHIN_S
    while True:
        ask(client, trig, point)
        v = answered(client, trig)
        if v["STATUS"] == Status.OK or time.monotonic() > end:
            return v
        assert v["STATUS"] in (Status.INTERNAL_ERROR, Status.TIMEOUT, Status.STARTING)
        trig += 1
        time.sleep(0.1)


@pytest.fixture
def gate(tmp_path):
    with GateProcess(tmp_path, [cell(tmp_path)]) as running:
        with running.client() as client:
            until(lambda: see(client)["STATE"] == State.READY)
        yield running


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


def test_a_second_daemon_exits_at_once_and_leaves_the_first_untouched(tmp_path):
    calm = cell(tmp_path, hang_s=COMES_WITHIN_S)
    with GateProcess(tmp_path, [calm]) as gate:
        until(lambda: gate.row("cell").health == "ok")
        assert_a_second_one_leaves_it_alone(gate)


def assert_a_second_one_leaves_it_alone(gate):
    argv = [sys.executable, "-m", "vgrd.gate", str(gate.runtime_dir)]
    second = subprocess.run(
        dying_with_us(argv), capture_output=True, text=True, timeout=COMES_WITHIN_S, check=False
    )
    assert second.returncode == 69
    assert f"process {gate.process.pid}" in second.stderr
    assert "runtime_dir" in second.stderr
    with gate.client() as client:
        assert served(client, 1, 5)["STATUS"] == Status.OK
    assert gate.row("cell").starts == 1


def test_a_taken_port_is_named_with_the_remedy(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        gate = GateProcess(tmp_path, [cell(tmp_path)])
        table = json.loads((tmp_path / "processes.json").read_text())
        table["modbus"]["port"] = port
        (tmp_path / "processes.json").write_text(json.dumps(table))
        argv = [sys.executable, "-m", "vgrd.gate", str(gate.runtime_dir)]
        done = subprocess.run(
            dying_with_us(argv),
            capture_output=True,
            text=True,
            timeout=COMES_WITHIN_S,
            check=False,
        )
    assert done.returncode == 69
    assert f"127.0.0.1:{port}" in done.stderr
    assert "[serving] port" in done.stderr


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{", "cannot be read"),
        ("{}", "modbus: missing"),
        ('{"cell": 1, "modbus": {"host": "x", "port": "y", "allow": ["z"]}}', "is not a str"),
        ('{"cell": "c", "modbus": {"host": "x", "port": 1, "allow": ["z"]}}', "no address"),
        ('{"cell": "c", "int16_scale": "inch"}', "int16_scale: 'inch', not one of mrad, centi"),
    ],
)
def test_a_bad_process_table_is_refused_with_its_faults(tmp_path, text, fault):
    (tmp_path / "processes.json").write_text(text)
    argv = [sys.executable, "-m", "vgrd.gate", str(tmp_path)]
    done = subprocess.run(
        dying_with_us(argv), capture_output=True, text=True, timeout=COMES_WITHIN_S, check=False
    )
    assert done.returncode == 78
    assert fault in done.stderr
    assert "Traceback" not in done.stderr


def test_systemd_hears_ready_watchdog_status_and_stopping(tmp_path):
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(path))
        manager.settimeout(COMES_WITHIN_S)
        env = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": "200000"}
        heard: list[str] = []
        with GateProcess(tmp_path / "run", [cell(tmp_path / "run")], env) as gate:
            while sum("WATCHDOG=1" in message for message in heard) < 3 or not any(
                "cell ok" in message for message in heard
            ):
                heard.append(manager.recv(4096).decode())
            gate.process.send_signal(signal.SIGTERM)
            while "STOPPING=1" not in heard[-1]:
                heard.append(manager.recv(4096).decode())
            gate.process.wait(COMES_WITHIN_S)
        assert heard[0].startswith("READY=1")


@contextlib.contextmanager
def full_pipe():
    """The end to write to of a pipe that is full and that nobody reads."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    yield writing
    os.close(reading)
    os.close(writing)


@contextlib.contextmanager
def full_disk():
    with Path("/dev/full").open("w") as full:
        yield full.fileno()


@contextlib.contextmanager
def closed():
    yield None


@pytest.mark.parametrize("standard_error", [full_pipe, full_disk, closed])
def test_standard_error_that_takes_nothing_stops_neither_the_registers_nor_the_cell(
    tmp_path, standard_error, stopwatch
):
    gate = GateProcess(tmp_path, [cell(tmp_path)])
    argv = [sys.executable, "-m", "vgrd.gate", str(tmp_path)]
    with standard_error() as stderr:
        if stderr is None:
            argv = ["sh", "-c", 'exec "$@" 2>&-', "sh", *argv]
        gate.process = subprocess.Popen(dying_with_us(argv), stderr=stderr)
        try:
            gate.port = until(lambda: gate.report()).port
            with gate.client() as client:
                until(lambda: see(client)["STATE"] == State.READY)
                for trig in range(1, 601):
                    ask(client, trig, 5)
                    assert answered(client, trig)["STATUS"] == Status.OK
            assert gate.row("cell").starts == 1
            stopwatch.judge("the gate stops", gate.stop(), 5.0)
        finally:
            gate.process.kill()
            gate.process.wait()


def test_the_gate_stays_under_40_mib_and_imports_nothing_heavy(gate):
    with gate.client() as client:
        for _ in range(2000):
            client.read(100, 68)
    rollup = Path(f"/proc/{gate.process.pid}/smaps_rollup").read_text()
    match = re.search(r"^Pss:\s+(\d+) kB", rollup, re.MULTILINE)
    assert match is not None
    assert int(match[1]) < 40 * 1024
    maps = Path(f"/proc/{gate.process.pid}/maps").read_text()
    assert not re.search(r"numpy|scipy|cv2|pydantic", maps)
