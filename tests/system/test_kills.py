"""Whatever process dies, the robot never reads a coordinate that is wrong, and all comes back by itself."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from fakes.cell.processes import is_alive, started_s
from fakes.cell.taught import LINK_TIMEOUT_S, TaughtCell
from fakes.controllers.robot_program import RobotProgram, Stopped
from vgrd.errors import ControlError, DaemonUnreachable
from vgrd.geometry import Pose
from vgrd.orphans import dying_with_us
from vgrd.registers import RESPONSE, State, Status
from vgrd.registers.layout import crc_of
from vgrd.store.sessions import iterate_flanges, load_session

pytestmark = pytest.mark.system

MAX_AGE_S = 3.0
LONGEST_GAP_S = 1.0
DEADLINE_S = 0.25  # of the gate: what a cell that is gone said last is not valid any more
LOST_S = 0.3  # 0.26 s, and the time of a read
GONE_WITHIN_S = 2.0
COMES_WITHIN_S = 120.0
MISS_MM = 1.0
WORK_S = 1.5
SETTLE_S = 0.3
STOP_S = 3.0
TARGETS = ("P1", "P2", "P3", "P4", "P5", "P6")


class View(NamedTuple):
    """One read of the response block: when it was sent and came, what was asked last, the bytes."""

    sent_s: float
    came_s: float
    trigger: int
    point: int
    block: bytes

    @property
    def values(self) -> dict[str, float]:
        return RESPONSE.decode(self.block)

    @property
    def valid(self) -> bool:
        return bool(int(self.values["STATE"]) & State.VALID)


class Witness(RobotProgram):
    """A robot program that keeps every view it read."""

    def __init__(self, cell: TaughtCell) -> None:
        super().__init__(cell.world, "127.0.0.1", cell.port, LINK_TIMEOUT_S)
        self.views: list[View] = []
        self.replies: list[float] = []
        self.lost: list[str] = []
        self.point = 0

    def block(self) -> bytes:
        sent = time.monotonic()
        block = super().block()
        self.views.append(View(sent, time.monotonic(), self.trigger, self.point, block))
        return block

    def work(self, stop: threading.Event) -> None:
        """Ask for one target after the other and watch each answer for a while."""
        while not stop.is_set():
            self.point = self.point % len(TARGETS) + 1
            try:
                self.ask(self.point)
                self.replies.append(time.monotonic())
                for _ in range(10):
                    self.check(self.read())
            except Stopped as stopped:
                if stopped.reason.startswith("no link"):
                    self.lost.append(stopped.reason)
                time.sleep(0.005)


@contextmanager
def polled(cell: TaughtCell) -> Iterator[Witness]:
    """A robot program that works in the background from a first good answer on."""
    stop = threading.Event()
    with Witness(cell) as witness:
        thread = threading.Thread(target=witness.work, args=(stop,))
        thread.start()
        try:
            wait_for(lambda: len(witness.replies) > 1)
            yield witness
        finally:
            stop.set()
            thread.join()


def wait_for(condition: Callable[[], object], within_s: float = COMES_WITHIN_S) -> float:
    """Seconds until it came true."""
    start = time.monotonic()
    while not condition():
        assert time.monotonic() < start + within_s, "it did not come true in time"
        time.sleep(0.01)
    return time.monotonic() - start


def assert_every_view_is_honest(cell: TaughtCell, witness: Witness) -> None:
    """A valid view is OK, fresh, of the last request, whole, unchanged and true; no other holds a pose."""
    served: dict[float, bytes] = {}
    for view in witness.views:
        values = view.values
        assert values["EC32_CRC"] == crc_of(view.block)
        assert Status(int(values["STATUS"])).is_ok == view.valid
        coordinate = [values[f"EC32_{axis}"] for axis in ("X", "Y", "Z", "RX", "RY", "RZ")]
        if not view.valid:
            assert coordinate == [-(2**31)] * 6
            continue
        assert values["AGE"] <= 1000 * MAX_AGE_S
        assert values["ECHO"] == values["EC32_ECHO"] == values["ECF_ECHO"] == view.trigger
        assert values["POINT"] == view.point
        position = slice(2 * (130 - 100), 2 * (142 - 100))
        assert served.setdefault(values["ECHO"], view.block[position]) == view.block[position]
        pose = Pose.from_rotvec(np.array(coordinate[3:]) * 1e-6, np.array(coordinate[:3]) * 1e-3)
        miss = cell.world.miss_at(pose, TARGETS[view.point - 1], 0.0)
        assert np.linalg.norm(miss) < MISS_MM
    assert len(served) >= 2
    assert not witness.lost


def longest_gap_s(witness: Witness) -> float:
    """Longest time without an answer of the gate."""
    return max(after.came_s - before.came_s for before, after in pairwise(witness.views))


@pytest.mark.parametrize(
    ("process", "number", "told"),
    [
        ("cell", signal.SIGKILL, {Status.INTERNAL_ERROR}),
        ("robot", signal.SIGKILL, {Status.ROBOT_OFFLINE}),
        ("camera", signal.SIGKILL, {Status.CAMERA_OFFLINE, Status.GRAB_TIMEOUT, Status.TIMEOUT}),
        ("cell", signal.SIGSTOP, {Status.INTERNAL_ERROR}),
    ],
    ids=["cell killed", "robot process killed", "camera process killed", "cell stopped"],
)
def test_a_process_that_dies_never_makes_the_robot_read_a_wrong_coordinate(
    live, process: str, number: signal.Signals, told: set[Status], record_property, stopwatch
) -> None:
    daemon, cell = live.daemon, live.cell
    gate, victim = daemon.process.pid, daemon.pid_of(process)
    with polled(cell) as witness:
        time.sleep(WORK_S)
        os.kill(victim, number)
        struck = time.monotonic()
        daemon.wait_reborn(process, victim)
        reborn = started_s(daemon.pid_of(process))
        wait_for(lambda: witness.replies[-1] > reborn)
        back_s = witness.replies[-1] - struck
        time.sleep(SETTLE_S)
    assert daemon.process.poll() is None
    assert daemon.process.pid == gate
    assert_every_view_is_honest(cell, witness)
    stopwatch.judge("longest gap of the registers", longest_gap_s(witness), LONGEST_GAP_S)
    stale = [v.sent_s - struck for v in witness.views if v.valid and struck < v.sent_s < reborn]
    # A request may outlive a device, which is soon back: it waits (BUSY) and nobody is told.
    lost = [v for v in witness.views if struck + LOST_S < v.sent_s < reborn]
    if process == "robot":
        assert {int(v.values["STATUS"]) for v in lost} <= {*told, Status.BUSY}
    if process == "cell":
        assert told & {int(v.values["STATUS"]) for v in witness.views if v.sent_s > struck}
        assert all(since_s < DEADLINE_S for since_s in stale)
    stopwatch.judge(f"valid after the {process} was lost", max(stale, default=0.0), LOST_S)
    record_property("back_s", round(back_s, 2))
    record_property("longest_gap_ms", round(1e3 * longest_gap_s(witness)))
    record_property("views", len(witness.views))
    record_property("last_valid_ms", round(1e3 * max(stale, default=0.0)))


def test_a_teaching_session_cut_short_by_a_kill_keeps_all_that_was_acknowledged(
    live, stopwatch
) -> None:
    daemon, operator = live.daemon, live.cell.operator(live.daemon)
    began = time.monotonic()
    folder = Path(operator.press("record.start", session="cut-short", plan="joint")["folder"])
    for step in operator.looks(2) + operator.spins(1) + operator.touches(["P1", "P2"], False):
        step()
    assert list(folder.glob("*.mcap.open"))
    acknowledged = dict(operator.taught)
    victim, killed = daemon.pid_of("cell"), threading.Event()

    def touch_until_killed() -> None:
        try:
            while not killed.is_set():
                operator.press("touch", target="P3")
                acknowledged["touch"] += 1
        except (DaemonUnreachable, ControlError):
            killed.set()

    thread = threading.Thread(target=touch_until_killed)
    thread.start()
    wait_for(lambda: acknowledged["touch"] >= 4)
    daemon.kill("cell")
    killed_at = time.monotonic()
    thread.join()
    daemon.wait_reborn("cell", victim)
    live.cell.restore(daemon)

    session = load_session(folder)
    recording = session.recording
    assert session.warnings == () or len(session.warnings) == 1
    harvested = session.harvested
    assert len(recording.looks) - harvested.get("look", 0) == acknowledged["look"]
    assert len(recording.spins) - harvested.get("spin", 0) == acknowledged["spin"]
    assert 0 <= len(recording.touches) - acknowledged["touch"] <= 1
    assert not list(folder.glob("*.mcap.open"))
    assert list(folder.glob("*.mcap"))
    stamps = np.array([reading.stamp_s for reading in iterate_flanges(folder)])
    assert stamps.max() < killed_at
    steps = np.diff(stamps)
    assert np.all(steps > 0)
    stopwatch.judge("the recording begins", float(stamps.min()) - began, 1.0)
    stopwatch.judge("what the recording lost", killed_at - float(stamps.max()), 1.0)
    stopwatch.judge("time from pose to pose", float(np.median(steps)), 2.5 / 125)
    goes_on = {"session": None, "last": "cut-short"}  # closed, and what is to be solved
    wait_for(lambda: daemon.call("status")["recording"] == goes_on)


def assert_no_orphans(pids: Iterable[int], stopwatch) -> None:
    gone_s = wait_for(lambda: not any(is_alive(pid) for pid in pids))
    stopwatch.judge("the processes are gone", gone_s, GONE_WITHIN_S)


def test_no_process_survives_a_gate_that_is_killed(taught, stopwatch) -> None:
    with taught.daemon() as daemon:
        pids = daemon.pids()
        daemon.process.kill()
        daemon.process.wait()
        assert_no_orphans(pids.values(), stopwatch)
        with taught.daemon() as next_one:
            assert next_one.call("status")["calibration"] == taught.calibration


@pytest.mark.parametrize("how", ["ctrl-c on the terminal", "SIGTERM"])
def test_the_daemon_stops_quickly_and_cleanly(taught, how: str, stopwatch) -> None:
    with taught.daemon() as daemon:
        pids = daemon.pids()
        start = time.monotonic()
        if how == "SIGTERM":
            daemon.process.send_signal(signal.SIGTERM)
        else:
            os.killpg(daemon.process.pid, signal.SIGINT)
        assert daemon.process.wait(COMES_WITHIN_S) == 0
        stopwatch.judge("the daemon stops", time.monotonic() - start, STOP_S)
        assert_no_orphans(pids.values(), stopwatch)
    log = daemon.log.read_text(encoding="utf-8")
    assert "Traceback" not in log
    assert "stopped" in log


def test_a_second_daemon_in_the_same_folder_leaves_the_first_alone(live) -> None:
    before = live.daemon.pids()
    table = (live.daemon.runtime / "processes.json").read_bytes()
    command = [sys.executable, "-m", "vgrd.cli", "run", str(live.daemon.cell_file)]
    second = subprocess.run(
        dying_with_us(command),
        capture_output=True,
        text=True,
        timeout=COMES_WITHIN_S,
        check=False,
    )
    assert second.returncode == 69
    assert f"process {before['gate']}" in second.stderr
    assert "runtime_dir" in second.stderr
    assert "Traceback" not in second.stderr
    assert live.daemon.pids() == before
    assert (live.daemon.runtime / "processes.json").read_bytes() == table
    with live.cell.program() as program:
        program.ask_until_good(1, COMES_WITHIN_S)
