"""From a fault to "invalid" at the robot, and from its end to the next good answer, on a quiet machine.

The real daemon on the fake cell; a robot reads all the time. The fault strikes while an answer stands,
stays until the coordinate is gone and the robot program has had time to see it, and is then undone. Each
row is the longest of some tries: figures of docs/registers.md, "An answer stands only ...".
"""

import math
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from fakes.cell.daemon import Daemon
from fakes.cell.taught import TaughtCell, rehearse
from fakes.controllers.robot_program import RobotProgram
from fakes.controllers.rtde import RtdeServer
from fakes.world.poses import retracted_pose
from tests.benchmarks.harness import Row
from tests.benchmarks.moved_object import frozen, killed, stopped, unplugged, wait_until_served
from vgrd.geometry import Pose
from vgrd.registers import Status

TRIES = 4
STAYS_S = 0.5  # a fault, beyond the moment at which the coordinate is gone
LOST_MS = 260.0  # of a process that died or stopped, and of what health tells
UNSEEN_MS = 400.0  # watch period + latency of the pictures + 0.1 s, in all
SERVED_S = 5.0
CELL_SERVED_S = 3.0

Fault = Callable[[TaughtCell, Daemon], AbstractContextManager[None]]


def robot_fault(**faults: object) -> Fault:
    """The controller does something else than it should."""

    @contextmanager
    def fault(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
        del daemon

        def strike(controller: RtdeServer) -> None:
            for name, value in faults.items():
                setattr(controller.faults, name, value)

        cell.fake.disturb(strike)
        yield
        cell.fake.disturb(lambda controller: _calm(controller, faults))

    return fault


def _calm(controller: RtdeServer, faults: dict[str, object]) -> None:
    for name, value in faults.items():
        setattr(controller.faults, name, type(value)())


@contextmanager
def robot_dropped(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The controller resets its connections and takes none."""
    del daemon

    def drop(controller: RtdeServer) -> None:
        controller.faults.silent = True
        controller.drop(reset=True)

    cell.fake.disturb(drop)
    yield
    cell.fake.disturb(lambda controller: setattr(controller.faults, "silent", False))


def process_fault(process: str, number: signal.Signals) -> Fault:
    """One of the daemon's processes is killed or stopped."""

    @contextmanager
    def fault(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
        del cell
        pid = daemon.pid_of(process)
        os.kill(pid, number)
        yield
        if number is signal.SIGSTOP:
            os.kill(pid, signal.SIGCONT)

    return fault


@contextmanager
def tag_covered(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """A hand lies on tag B while the arm is away."""
    del daemon
    cell.world.cover("b")
    yield
    cell.world.cover()


@contextmanager
def lights_off(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """Dark pictures come."""
    del daemon
    cell.world.switch_lights(on=False)
    yield
    cell.world.switch_lights(on=True)


@contextmanager
def tcp_changed(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """Another TCP on the pendant; put back and confirmed."""
    arm, right = cell.world.arm, cell.world.arm.wrist_from_tcp
    arm.wrist_from_tcp = right @ Pose.from_rotvec((0, 0, 0), (0, 0, 5.0))
    yield
    arm.wrist_from_tcp = right
    time.sleep(0.3)  # until the controller has told it
    daemon.control.call("confirm")


FAULTS: dict[str, tuple[Fault, float, float]] = {
    "camera_killed": (killed, LOST_MS, SERVED_S),
    "camera_stopped": (stopped, LOST_MS, SERVED_S),
    "camera_frozen": (frozen, UNSEEN_MS, SERVED_S),
    "camera_unplugged": (unplugged, UNSEEN_MS, SERVED_S),
    "tag_covered": (tag_covered, UNSEEN_MS, SERVED_S),
    "lights_off": (lights_off, UNSEEN_MS, SERVED_S),
    "robot_frozen": (robot_fault(freeze=True), LOST_MS, SERVED_S),
    "robot_dropped": (robot_dropped, LOST_MS, SERVED_S),
    "robot_not_a_number": (robot_fault(not_a_number=True), LOST_MS, SERVED_S),
    "robot_stopped_by_safety": (robot_fault(protective_stop=True), LOST_MS, SERVED_S),
    "robot_process_killed": (process_fault("robot", signal.SIGKILL), LOST_MS, SERVED_S),
    "robot_process_stopped": (process_fault("robot", signal.SIGSTOP), LOST_MS, SERVED_S),
    "tcp_changed": (tcp_changed, LOST_MS, SERVED_S),
    "cell_killed": (process_fault("cell", signal.SIGKILL), LOST_MS, CELL_SERVED_S),
    "cell_stopped": (process_fault("cell", signal.SIGSTOP), LOST_MS, SERVED_S),
}


def struck(
    cell: TaughtCell, daemon: Daemon, program: RobotProgram, fault: Fault
) -> tuple[float, float]:
    """Ms until the coordinate is gone, and s from the fault's end to the next good answer."""
    wait_until_served(program)
    time.sleep(0.3)
    start = time.monotonic()
    with fault(cell, daemon):
        gone_s = math.inf
        while time.monotonic() < start + 4.0:
            if not Status(int(program.view()["STATUS"])).is_ok:
                gone_s = time.monotonic()
                break
            time.sleep(0.001)
        time.sleep(STAYS_S)
    healed = time.monotonic()
    wait_until_served(program)
    return 1e3 * (gone_s - start), time.monotonic() - healed


def rows() -> Iterator[Row]:
    """fault_*_invalid (ms) and fault_*_served (s): longest of the tries."""
    with tempfile.TemporaryDirectory() as folder:
        calibration = rehearse(Path(folder))
        with TaughtCell(Path(folder) / "cell", calibration) as cell, cell.daemon() as daemon:
            cell.world.move_flange(retracted_pose(), time.monotonic())
            with cell.program() as program:
                for name, (fault, invalid_ms, served_s) in FAULTS.items():
                    times = [struck(cell, daemon, program, fault) for _ in range(TRIES)]
                    gone, served = zip(*times, strict=True)
                    note = f"{TRIES} tries"
                    yield Row.at_most(f"fault_{name}_invalid", max(gone), "ms", invalid_ms, note)
                    yield Row.at_most(f"fault_{name}_served", max(served), "s", served_s, note)
