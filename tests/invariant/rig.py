"""The machine: a daemon in simulated time, robots that poll it all the time, and what people do to it.

The rules (`asking`, `accidents`, `breakdowns`) are made of these methods.
"""

import contextlib
import logging
import math
from collections.abc import Callable, Coroutine, Iterator
from contextvars import copy_context
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
import structlog

from tests.invariant.reading.desk import Desk
from tests.invariant.reading.judge import Judge, Lie
from tests.invariant.reading.polling import PROGRAM, Robots
from tests.invariant.reading.promises import LOST_S
from tests.invariant.reading.robots import Asked
from tests.invariant.simulation.daemon import START_S, Daemon
from tests.invariant.simulation.devices import READING_S
from tests.invariant.simulation.simulated_time import PROCESS
from tests.invariant.simulation.teaching import Variant
from vgrd.cell.serving.faults import TCP_CHANGED_MM
from vgrd.config.limits_section import LimitsSection
from vgrd.errors import ControlError, VgrdError
from vgrd.gate.supervisor import FIRST_DELAY_S
from vgrd.geometry import Pose
from vgrd.model import Motion
from vgrd.registers import Command

SETTLED_S = 6.0  # until all processes run and pictures come
SILENT = logging.CRITICAL  # nothing logs so loudly
CONFIRMED_S = 1.0  # a person needs longer, the devices are back by then, or not


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """No lines of the log: there would be thousands."""
    before = structlog.get_config()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(SILENT))
    try:
        yield
    finally:
        structlog.configure(**before)


class Rig:
    """read_s: from one read of a robot to its next."""

    def __init__(
        self,
        folder: Path,
        variant: Variant,
        seed: int,
        read_s: float = 0.004,
    ) -> None:
        self.daemon = Daemon(folder, variant, seed)
        self.plant, self.clock, self.rng = self.daemon.plant, self.daemon.clock, self.daemon.rng
        film, desk = self.daemon.camera.film, Desk()
        self.judge = Judge(self.plant, film, desk, variant, self.daemon.calibrations)
        self.promises = self.judge.promises
        self.robots = Robots(self.daemon, self.judge, desk, read_s)
        self._trigs = [1, 2]
        self._start_s, self._asleep_s = self.clock.now_s, 0.0
        self.daemon.start()
        self.robots.start()
        self.wait(SETTLED_S)

    @property
    def awake_s(self) -> float:
        """How long the cell has lived, without the time in which nothing ran."""
        return self.clock.now_s - self._start_s - self._asleep_s

    @property
    def motion(self) -> Motion:
        return self.daemon.variant.motion

    def wait(self, seconds: float) -> None:
        """Let time pass; raises Lie when a robot read one."""
        self.daemon.run_for(seconds)
        if self.robots.lies:
            raise Lie(self.robots.lies[0])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.daemon.close()

    # Programs.

    def ask(self, client: int, asked: Asked, *, trig: int | None = None) -> None:
        """A program writes a request with a TRIG of its own, or with any."""
        self._trigs[client] = (self._trigs[client] + 2) % 0xFFFE
        request = replace(asked, trig=trig if trig is not None else self._trigs[client] + 1)
        self.write(client, 0, request.words())

    def ask_any(self, seed: int) -> None:
        """Some request."""
        rng = np.random.default_rng(seed)
        command = (Command.EC_NEWEST, Command.EC_FRESH)[int(rng.integers(2))]
        self.ask(int(rng.integers(2)), Asked(0, command, int(rng.integers(1, 7))))

    def write(self, client: int, address: int, words: list[int]) -> None:
        self._in_loop(lambda: self.robots.write(client, address, words))

    def ask_by_line(self, client: int, asked: Asked) -> None:
        """A program asks by a line."""
        self._in_loop(lambda: self.robots.ask_by_line(client, asked))

    def drop_by_line(self, client: int) -> None:
        self._in_loop(lambda: self.robots.drop_by_line(client))

    def garbage_by_line(self, client: int, data: bytes) -> None:
        """Bytes that are no line, or one that is refused."""
        self._in_loop(lambda: self.robots.lines[client].send(data))

    def coil(self, client: int, address: int, *, on: bool) -> None:
        self._in_loop(lambda: self.robots.write_coil(client, address, on=on))

    def garbage(self, client: int, data: bytes) -> None:
        """Bytes that are no Modbus."""
        self._in_loop(lambda: self.robots.links[client].send(data))

    def crowd(self, count: int) -> None:
        self._in_loop(lambda: self.robots.crowd(count))

    # Operators.

    def activate(self, name: str) -> None:
        """Another calibration is put in use, and nobody waits for it."""
        if self.daemon.cell is not None:
            self._forget_error(self.daemon.cell.activation.activate(name, "operator"))

    def confirm(self) -> None:
        """`vgrd confirm`; what is not confirmed stays."""
        cell = self.daemon.cell
        if cell is not None and not self.daemon.loop.is_stopped("cell"):
            with contextlib.suppress(ControlError):
                self._in_loop(cell.serving.confirm)
                self.promises.kept("tcp")

    def change_tcp(self, size_mm: float) -> None:
        """On the pendant."""
        shift = Pose(np.eye(3), np.array([size_mm, 0, 0]))
        self.plant.arm.wrist_from_tcp = self.plant.arm.wrist_from_tcp @ shift
        if size_mm > TCP_CHANGED_MM:
            within_s = self.daemon.robot.reading_s + LOST_S
            self.promises.made("tcp", "the TCP was changed", self.clock.now_s, within_s)

    def restore_tcp(self) -> None:
        """Nothing is valid before a person confirms it, if the cell has seen that it was changed."""
        self.plant.arm.wrist_from_tcp = self.plant.pendant_tcp
        cell = self.daemon.cell
        if cell is None or cell.serving.faults.latched is None:
            self.promises.kept("tcp")

    def repair(self) -> None:
        """All is as it was taught; who was waited for is there."""
        robot, camera = self.daemon.robot, self.daemon.camera
        self.plant.repair(self.clock.now_s)
        self.restore_tcp()
        self.plug_in()
        robot.fault = camera.fault = ""
        camera.sends_regions = True
        robot.frozen, robot.is_running, robot.reading_s = None, True, READING_S
        for name in ("gate", "cell", "camera", "robot"):
            self.go_on(name)
        self.daemon.loop.executor_s["cell"] = self.daemon.swift
        self.wait(CONFIRMED_S)
        self.confirm()
        cell = self.daemon.cell
        if cell is None or cell.serving.faults.latched is None:
            self.promises.kept("tcp")
        self.judge.faster()

    def reload(self, max_age_s: float, scale: str, outer_radius_mm: float | None = None) -> None:
        """The gate takes over another table, and the cell starts anew with what is in it."""
        if self.daemon.gate is not None and not self.daemon.loop.is_stopped("gate"):
            self.kill("cell")
            self.daemon.reload(max_age_s, scale, LimitsSection(outer_radius_mm=outer_radius_mm))
            self.wait(CONFIRMED_S)
            self.judge.max_age_s = max_age_s
            self.judge.limits.outer_radius_mm = outer_radius_mm or math.inf

    # Cables, processes, time.

    def unplug(self, name: str) -> None:
        now, robot = self.clock.now_s, self.daemon.robot
        if name == "camera":
            self.daemon.camera.is_plugged = False
            within_s = self.judge.told_within_s
        else:
            robot.is_plugged = False
            within_s = max(LOST_S, 3 * min(robot.reading_s, 0.35) + 0.16)
        self.promises.made(f"{name} cable", f"the {name} is unplugged", now, within_s)

    def plug_in(self) -> None:
        self.daemon.camera.is_plugged = self.daemon.robot.is_plugged = True
        self.promises.kept("camera cable")
        self.promises.kept("robot cable")

    def kill(self, name: str) -> None:
        now = self.clock.now_s
        self.go_on(name)
        self.daemon.kill(name)
        back_s = now + FIRST_DELAY_S + START_S[name]
        self.promises.made(f"{name} killed", f"{name} was killed", now, LOST_S, back_s)

    def stop(self, name: str) -> None:
        self.daemon.stop(name)
        if name != "gate":
            words = f"{name} stands"
            self.promises.made(f"{name} stopped", words, self.clock.now_s, LOST_S)

    def go_on(self, name: str) -> None:
        self.daemon.go_on(name)
        self.promises.kept(f"{name} stopped")

    def slow_down(self, seconds: float) -> None:
        """Threads of the cell take so long."""
        self.judge.slower(min(seconds, 1.0))
        self.daemon.loop.executor_s["cell"] = lambda: self.rng.uniform(0.5, 1.0) * seconds

    def suspend(self, seconds: float, turned_rad: float) -> None:
        """Nothing runs; the first read after it shows no answer of before."""
        self.clock.now_s += seconds
        self._asleep_s += seconds
        if turned_rad:
            at = self.plant.placements[-1]
            angle = at.angle(self.clock.now_s) + turned_rad
            self.plant.jerk(angle, self.clock.now_s, at.offset)
        if self._in_loop(lambda: self.robots.read(0)) and seconds > LOST_S:
            raise Lie(f"valid after {seconds} s in which nothing ran")

    def _forget_error(self, work: Coroutine[object, object, object]) -> None:
        async def perform() -> None:
            with contextlib.suppress(VgrdError):
                await work

        self.daemon.command(perform())

    def _in_loop(self, act: Callable[[], object]) -> object:
        """Do something between two moments of the loop."""

        async def perform() -> object:
            return act()

        context = copy_context()
        context.run(PROCESS.set, PROGRAM)
        return self.daemon.loop.run_until_complete(
            self.daemon.loop.create_task(perform(), context=context)
        )
