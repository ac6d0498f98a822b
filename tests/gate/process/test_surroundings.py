"""What the gate finds around it: another gate, a taken port, a bad table, systemd, a full pipe, little memory."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.gate.process.gate_process import (
    COMES_WITHIN_S,
    GateProcess,
    answered,
    ask,
    cell,
    see,
    served,
    until,
)
from vgrd.orphans import dying_with_us
from vgrd.registers import State, Status

pytestmark = pytest.mark.system


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
