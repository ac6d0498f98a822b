"""The cell's process by itself: how it ends, what crowds do to it, what it keeps."""

import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from filelock import FileLock

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.samples import Samples
from fakes.world.world import CellNoise, World
from vgrd.cell.serving.latches import LATCH_FILE
from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved, save_resolved
from vgrd.errors import ControlError, VgrdError
from vgrd.ipc.control import ControlClient
from vgrd.model import Verdict
from vgrd.orphans import dying_with_us
from vgrd.store.calibrations import CalibrationStore

pytestmark = pytest.mark.system

START_S = 60.0  # of a busy machine
END_S = 5.0  # the interpreter would wait for the lock twice as long


class CellProcess:
    """`python -m vgrd.cell` on a file of its own; the test is its gate."""

    def __init__(self, folder: Path) -> None:
        self.facts = facts_of(World(Layout(), 5, CellNoise.none()), folder)
        (path,) = folder.glob("*.toml")
        config = load_config(path)
        self.runtime, self.state = Path(config.cell.runtime_dir), Path(config.cell.state_dir)
        self.runtime.mkdir(exist_ok=True)
        self.resolved = save_resolved(Resolved(config, str(path), 0.0), self.runtime)
        self.log = folder / "cell.log"
        self.control = ControlClient(self.runtime / "control.sock")

    def __enter__(self) -> "CellProcess":
        return self

    def start(self, descriptors: int | None = None) -> "CellProcess":
        """Start it and wait until it answers."""
        self.gate, theirs = socket.socketpair()
        limit = (
            partial(resource.setrlimit, resource.RLIMIT_NOFILE, (descriptors, descriptors))
            if descriptors
            else None
        )
        with theirs, self.log.open("ab") as log:
            self.process = subprocess.Popen(
                dying_with_us([sys.executable, "-m", "vgrd.cell", str(self.resolved)]),
                env={**os.environ, "VGRD_GATE_FD": str(theirs.fileno())},
                pass_fds=[theirs.fileno()],
                stderr=log,
                preexec_fn=limit,
            )
        try:
            self.until(lambda: self.status() is not None)
        except BaseException:
            self.__exit__()
            raise
        return self

    def until(self, condition: Callable[[], object]) -> None:
        end_s = time.monotonic() + START_S
        while not condition():
            assert self.process.poll() is None, self.words()
            assert time.monotonic() < end_s, self.words()
            time.sleep(0.02)

    def status(self) -> dict[str, object] | None:
        with contextlib.suppress(VgrdError):
            return self.control.call("status", timeout_s=2.0)
        return None

    def words(self) -> str:
        return self.log.read_text(encoding="utf-8")

    def __exit__(self, *_: object) -> None:
        self.gate.close()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[CellProcess]:
    with CellProcess(tmp_path).start() as cell:
        yield cell


def test_a_cell_ends_with_its_gate_at_once_and_cleanly_also_while_it_waits_for_a_lock(
    cell: CellProcess, stopwatch
) -> None:
    store = CalibrationStore(cell.state)
    usable = replace(Samples(1).calibration(), facts=cell.facts, verdict=Verdict())
    name = store.save(usable)
    with FileLock(store.path / ".lock", thread_local=False):
        with pytest.raises(ControlError, match="timed out"):
            cell.control.call("activate", calibration=name, timeout_s=0.5)
        assert cell.status() is not None
        start = time.monotonic()
        cell.gate.close()
        assert cell.process.wait(START_S) == 0
        stopwatch.judge("the cell ends", time.monotonic() - start, END_S)
    assert "gate_gone" in cell.words()
    assert "never retrieved" not in cell.words()
    assert "Traceback" not in cell.words()


def test_a_crowd_on_the_control_socket_of_a_cell_with_few_descriptors_harms_nobody(
    tmp_path: Path,
) -> None:
    cell = CellProcess(tmp_path)
    with cell.start(descriptors=64), contextlib.ExitStack() as crowd:
        for _ in range(120):
            link = crowd.enter_context(socket.socket(socket.AF_UNIX))
            link.settimeout(5.0)
            with contextlib.suppress(OSError):
                link.connect(str(cell.control.path))
        with pytest.raises(ControlError, match="clients are connected"):
            cell.control.call("status")
        crowd.close()
        cell.until(lambda: cell.status() is not None)
        assert "Traceback" not in cell.words()


def test_a_latch_that_an_earlier_life_left_is_in_force_until_it_is_confirmed(
    tmp_path: Path,
) -> None:
    cell = CellProcess(tmp_path)
    cell.state.mkdir(exist_ok=True)
    (cell.state / LATCH_FILE).write_bytes(b"torn")
    with cell.start():
        assert "unreadable" in str(cell.control.call("status")["fault"])
        cell.process.send_signal(signal.SIGKILL)
        cell.process.wait()
    with cell.start():
        assert "unreadable" in str(cell.control.call("status")["fault"])
        cell.control.call("confirm")
        assert "unreadable" not in str(cell.control.call("status")["fault"])
        cell.process.send_signal(signal.SIGKILL)
        cell.process.wait()
    with cell.start():
        assert "unreadable" not in str(cell.control.call("status")["fault"])
