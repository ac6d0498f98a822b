"""`make cell`: the fake cell stays up, calibrated, and goes without a trace."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from fakes.cell.processes import descendants, is_alive
from fakes.controllers.raw_modbus import RawModbus
from fakes.controllers.robot_program import RobotProgram
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.world import World
from vgrd.calibration.calibration import Calibration
from vgrd.orphans import dying_with_us
from vgrd.store.calibrations import CalibrationStore

pytestmark = pytest.mark.system
COMES_WITHIN_S = 240.0
GONE_WITHIN_S = 5.0


class Running(NamedTuple):
    """The command, its registers' port, and all processes of it."""

    process: subprocess.Popen[str]
    port: int
    family: set[int]

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def type(self, words: str) -> str:
        """Type a line and return the answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{words}\n")
        self.process.stdin.flush()
        return self.line()


@pytest.fixture
def running(tmp_path: Path, calibration: Calibration) -> Iterator[Running]:
    """A cell whose earlier run was calibrated, up and serving."""
    store = CalibrationStore(tmp_path / "state")
    store.activate(store.save(calibration), by="test")
    port = free_port()
    command = ["cell", "--folder", str(tmp_path), "--port", str(port)]
    process = subprocess.Popen(
        dying_with_us([sys.executable, "-m", "fakes", *command]),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        cell = Running(process, port, set())
        while not (line := cell.line()).startswith("type: "):
            assert process.poll() is None, "the fake cell ended early"
        assert "help" in line
        cell.family.update(descendants(process.pid))
        assert len(cell.family) > 4
        yield cell
    finally:
        process.kill()
        process.communicate()


def assert_gone(cell: Running, stopwatch) -> None:
    """No process is left, and the port is free."""
    start = time.monotonic()
    while any(is_alive(pid) for pid in cell.family):
        assert time.monotonic() < start + COMES_WITHIN_S
        time.sleep(0.02)
    stopwatch.judge("all processes are gone", time.monotonic() - start, GONE_WITHIN_S)
    with pytest.raises(ConnectionRefusedError):
        RawModbus("127.0.0.1", cell.port)


def test_a_cell_of_an_earlier_run_serves_at_once_tells_what_to_type_and_ends_with_ctrl_c(
    running, stopwatch
) -> None:
    with RobotProgram(World(Layout(), 1), "127.0.0.1", running.port, COMES_WITHIN_S) as program:
        program.ask_until_good(1, COMES_WITHIN_S)
    told = running.type("help")
    for word in ("turn DEGREES", "cover a|b|none", "flange X Y Z", "miss TARGET"):
        assert word in told
    assert "turn DEGREES" in running.type("jump")
    assert running.type("turn 20").startswith("ok")
    assert "bad turn" in running.type("turn around")
    os.killpg(running.process.pid, signal.SIGINT)
    assert running.process.wait(COMES_WITHIN_S) == 0
    assert_gone(running, stopwatch)


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGHUP], ids=["kill -9", "terminal closed"]
)
def test_nothing_of_it_outlives_it_however_it_ends(running, number, stopwatch) -> None:
    running.process.send_signal(number)
    running.process.wait(COMES_WITHIN_S)
    assert_gone(running, stopwatch)
