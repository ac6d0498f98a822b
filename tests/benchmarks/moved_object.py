"""How long the registers show a coordinate that is wrong, when the table turns or the camera is lost.

The real daemon on the fake cell. In each trial a robot asks, and at a random moment of the request or of
the standing answer the table turns by 20 degrees; the camera works, or is struck at that moment. A read is
wrong when the coordinate misses the target, where it truly is at that moment, by more than `moved_mm` and
the uncertainty that the registers tell.
"""

import argparse
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fakes.cell.daemon import Daemon
from fakes.cell.taught import TaughtCell, rehearse
from fakes.controllers.robot_program import RobotProgram, Stopped
from fakes.world.poses import retracted_pose
from vgrd.geometry import Pose
from vgrd.registers import Status

TURN_RAD = math.radians(20)
MOVED_MM = 0.3  # the cell file's default: a smaller way is not told
WATCHED_S = 3.5  # longer than an answer lives
SPREAD_S = 1.2  # of the moment of the turn: a request takes 0.3 to 0.6 s, an answer stands 3 s
POLL_S = 0.002


@dataclass(frozen=True)
class Trial:
    """What a robot read: how long it was valid, and how long valid and wrong; the last status."""

    valid_s: float
    wrong_s: float
    worst_mm: float
    end: Status


@contextmanager
def working(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The camera is well."""
    del cell, daemon
    yield


@contextmanager
def killed(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The camera's process of the daemon is killed."""
    del cell
    daemon.kill("camera")
    yield


@contextmanager
def stopped(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The camera's process of the daemon is stopped, as one that hangs in its vendor's library."""
    del cell
    pid = daemon.pid_of("camera")
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


@contextmanager
def frozen(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The camera answers control and sends no picture any more."""
    del daemon
    cell.fake.tell_camera("freeze on")
    try:
        yield
    finally:
        cell.fake.tell_camera("freeze off")


@contextmanager
def unplugged(cell: TaughtCell, daemon: Daemon) -> Iterator[None]:
    """The camera is off the network."""
    del daemon
    cell.fake.unplug_camera()
    try:
        yield
    finally:
        cell.fake.plug_camera()


CAMERAS = {each.__name__: each for each in (working, killed, stopped, frozen, unplugged)}
Strike = Callable[[], None]


def trial(
    cell: TaughtCell, daemon: Daemon, program: RobotProgram, camera: str, delay_s: float
) -> Trial:
    """Ask; `delay_s` after the request, strike and turn; read on until the answer has ended."""
    world = cell.world
    start = time.monotonic()
    program.request(1)
    valid_s = wrong_s = worst_mm = 0.0
    last_s, was_valid, was_wrong, end = start, False, False, Status.BUSY
    with contextmanager_of(camera, cell, daemon) as strike:
        while (now := time.monotonic()) < start + delay_s + WATCHED_S:
            if now >= start + delay_s:
                strike()
            before = time.monotonic()
            values = program.view()
            status = Status(int(values["STATUS"]))
            valid_s += (before - last_s) * was_valid
            wrong_s += (before - last_s) * was_wrong
            was_valid, was_wrong, last_s = status.is_ok, False, before
            if status.is_ok:
                miss_mm = miss_of(cell, values, before)
                was_wrong = miss_mm > MOVED_MM + values["ECF_U95"]
                worst_mm = max(worst_mm, miss_mm if was_wrong else 0.0)
            end = status
            if status not in (Status.OK, Status.BUSY) and now >= start + delay_s:
                break
            time.sleep(POLL_S)
    world.turn_table(0.0, time.monotonic())
    return Trial(valid_s, wrong_s, worst_mm, end)


@contextmanager
def contextmanager_of(camera: str, cell: TaughtCell, daemon: Daemon) -> Iterator[Strike]:
    """A strike that may be called many times and acts once; what it did is undone at the end."""
    entered: list[object] = []
    context = CAMERAS[camera](cell, daemon)

    def strike() -> None:
        if not entered:
            entered.append(context.__enter__())
            cell.world.turn_table(TURN_RAD, time.monotonic())

    try:
        yield strike
    finally:
        if entered:
            context.__exit__(None, None, None)


def miss_of(cell: TaughtCell, values: dict[str, float], now_s: float) -> float:
    """How far off target P1 the coordinate in the registers leads at this moment, mm."""
    position = [values[f"EC32_{axis}"] * 1e-3 for axis in ("X", "Y", "Z")]
    rotation = [values[f"EC32_{axis}"] * 1e-6 for axis in ("RX", "RY", "RZ")]
    angle = cell.world.table_angle(now_s)
    return float(
        np.linalg.norm(cell.world.miss_at(Pose.from_rotvec(rotation, position), "P1", angle))
    )


def trials(camera: str, count: int, seed: int) -> Iterator[Trial]:
    """Trials on one daemon, each after it serves again."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        calibration = rehearse(Path(folder))
        with TaughtCell(Path(folder) / "cell", calibration) as cell, cell.daemon() as daemon:
            cell.world.move_flange(retracted_pose(), time.monotonic())
            with cell.program() as program:
                for _ in range(count):
                    try:
                        wait_until_served(program)
                    except TimeoutError as err:
                        log = daemon.log.read_text(encoding="utf-8", errors="replace")
                        raise TimeoutError(f"{err}\n{log[-3000:]}") from err
                    yield trial(cell, daemon, program, camera, float(rng.uniform(0, SPREAD_S)))


def wait_until_served(program: RobotProgram, within_s: float = 30.0) -> None:
    """Ask until an answer is given, and drop it. TimeoutError."""
    end_s, reason = time.monotonic() + within_s, ""
    while time.monotonic() < end_s:
        try:
            program.ask(1)
        except Stopped as stop:
            reason = stop.reason
            time.sleep(0.1)
        else:
            return
    raise TimeoutError(f"the daemon does not serve again: {reason}")


def main() -> None:
    """Print a line per kind of camera."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.moved_object")
    parser.add_argument("--trials", type=int, default=100, help="of each kind of camera")
    parser.add_argument("--camera", choices=sorted(CAMERAS), action="append")
    asked = parser.parse_args()
    for camera in asked.camera or CAMERAS:
        done = []
        for result in trials(camera, asked.trials, seed=len(camera)):
            done.append(result)
            if len(done) % 10 == 0:
                print(f"  {camera} {len(done)} of {asked.trials}", flush=True)  # noqa: T201
        print(summary(camera, done), flush=True)  # noqa: T201


def summary(camera: str, done: list[Trial]) -> str:
    """One line: how long valid and wrong, and how answers ended."""
    wrong_ms = np.array([1e3 * each.wrong_s for each in done])
    ends = {each.end.name for each in done}
    shown = sum(each.valid_s > 0 for each in done)
    return (
        f"{camera}: {len(done)} trials, {shown} saw an answer; valid and wrong: "
        f"median {np.median(wrong_ms):.0f}, 95 % {np.quantile(wrong_ms, 0.95):.0f}, "
        f"longest {wrong_ms.max():.0f} ms; ended with {', '.join(sorted(ends))}"
    )


if __name__ == "__main__":
    main()
