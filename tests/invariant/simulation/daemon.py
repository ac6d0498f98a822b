"""The daemon in simulated time: the real gate and the real cell, and the supervisor's part played by tasks.

A kill ends tasks and hangs up the link, as the kernel does; what was in rings and files stays.
"""

import asyncio
import socket
from collections.abc import Callable, Coroutine
from contextvars import copy_context
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.invariant.simulation.devices import CameraDevice, RobotDevice
from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.simulated_time import PROCESS, SimulatedClock, SimulatedLoop
from tests.invariant.simulation.teaching import PORT, Variant, library, resolved
from vgrd.cell.__main__ import Cell
from vgrd.config.limits_section import LimitsSection
from vgrd.gate.gate import Gate
from vgrd.gate.settings import WANTED_TABLE, GateSettings, save_table
from vgrd.gate.supervisor import FIRST_DELAY_S, GROWTH, LAST_DELAY_S

START_S = {"cell": 1.6, "camera": 0.5, "robot": 0.3, "gate": 1.0}
KILLED = -9


class Daemon:
    """Gate, cell and two device processes, in `folder`; `kill` and `stop` take their names."""

    def __init__(self, folder: Path, variant: Variant, seed: int) -> None:
        self.folder, self.variant = folder, variant
        self.rng = np.random.default_rng(seed)
        self.clock = SimulatedClock()
        self.loop = SimulatedLoop(self.clock)
        self.loop.executor_s["cell"] = self.swift
        self.plant = Plant()
        self.robot = RobotDevice(self.plant, self.clock)
        self.camera = CameraDevice(self.plant, self.robot, self.clock, self.rng)
        self.runtime, self.state = folder / "run", folder / "state"
        self.runtime.mkdir(mode=0o700)
        self.resolved = resolved(variant, folder)
        store = library(variant.motion)
        store.copy(self.state)
        self.names, self.calibrations = store.names, store.by_register_id
        self.gate: Gate | None = None
        self.cell: Cell | None = None
        self.faults: list[BaseException] = []
        self.on_gate: list[Callable[[Gate], None]] = []
        self._lives: dict[str, asyncio.Task[None]] = {}
        self._keepers: dict[str, asyncio.Task[None]] = {}
        self._commands: set[asyncio.Task[None]] = set()
        self._pid = 1000
        self.loop.set_exception_handler(self._note)

    def swift(self) -> float:
        """How long a thread of the cell takes while the machine has time to spare."""
        return float(self.rng.uniform(0.005, 0.04))

    def reload(self, max_age_s: float, scale: str, limits: LimitsSection) -> None:
        """Leave another table for the gate; the cell finds another cell file at its next start."""
        config = self.resolved.config
        serving = config.serving.model_copy(update={"max_age_s": max_age_s, "int16_scale": scale})
        config = config.model_copy(update={"serving": serving, "limits": limits})
        self.resolved = replace(self.resolved, config=config)
        table = {
            "cell": "fake",
            "loaded_unix_s": self.clock.wall(),
            "deadline_s": serving.deadline_s,
            "timeout_s": serving.timeout_s,
            "int16_scale": scale,
            "modbus": {"host": serving.host, "port": PORT, "allow": list(serving.allow)},
            "processes": [],
        }
        save_table(self.runtime, table, WANTED_TABLE)

    def start(self) -> None:
        """Start the gate, which starts the others."""
        self._start("gate", self._live_gate)

    def run_for(self, seconds: float) -> None:
        """Let time pass; raises what a process raised that it must not."""
        self.loop.run_for(seconds)
        if self.faults:
            raise self.faults[0]

    def command(self, work: Coroutine[object, object, None]) -> None:
        """Let the cell do what somebody asked for; it dies with the cell."""
        context = copy_context()
        context.run(PROCESS.set, "cell")
        task = self.loop.create_task(work, context=context)
        self._commands.add(task)
        task.add_done_callback(self._commands.discard)

    def kill(self, name: str) -> None:
        """SIGKILL; the gate takes all others along, as PDEATHSIG does."""
        self.loop.forget_process(name)
        life = self._lives.get(name)
        if life is not None:
            if name == "cell" and self.cell is not None:
                self._end_cell(self.cell)
            life.cancel()

    def _end_cell(self, cell: Cell) -> None:
        """Nobody can ask it any more, and what was asked ends with it."""
        self.cell = None
        for task in self._commands:
            task.cancel()
        cell.serving.ring.close()

    def stop(self, name: str) -> None:
        """SIGSTOP."""
        self.loop.stop_process(name)

    def go_on(self, name: str) -> None:
        """SIGCONT."""
        self.loop.continue_process(name)

    def close(self) -> None:
        """End everything."""
        for name in ("gate", "cell", "camera", "robot"):
            self.loop.forget_process(name)
        while tasks := asyncio.all_tasks(self.loop):
            for task in tasks:
                task.cancel()
            self.loop.run_until_complete(asyncio.wait(tasks))
        self.loop.run_for(0.1)
        self.loop.close()

    def _note(self, _: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        error = context.get("exception")
        self.faults.append(
            error if isinstance(error, BaseException) else RuntimeError(str(context))
        )

    def _start(self, name: str, live: Callable[[], Coroutine[object, object, None]]) -> None:
        context = copy_context()
        context.run(PROCESS.set, "supervisor")
        keeper = self._keep(name, live)
        self._keepers[name] = self.loop.create_task(keeper, context=context)

    async def _keep(self, name: str, live: Callable[[], Coroutine[object, object, None]]) -> None:
        """Start it again whenever it ends, as the supervisor (and systemd, for the gate) does."""
        delay_s = FIRST_DELAY_S
        while True:
            context = copy_context()
            context.run(PROCESS.set, name)
            self._pid += 1
            life = self._lives[name] = self.loop.create_task(live(), context=context)
            await asyncio.wait({life})
            if not life.cancelled() and (error := life.exception()) and not life.cancelling():
                self.faults.append(error)
            if name == "cell" and self.gate is not None:
                self.cell = None
                self.gate._cell_ended(KILLED)
            await asyncio.sleep(START_S["gate"] if name == "gate" else delay_s)
            delay_s = min(GROWTH * delay_s, LAST_DELAY_S)

    async def _live_gate(self) -> None:
        """One life of the gate: all its chores, but no listening socket; lines are let in by the clients."""
        serving = self.resolved.config.serving
        settings = GateSettings(
            "fake", serving.host, PORT, tuple(serving.allow), (), serving.deadline_s
        )
        self.gate = Gate(settings, self.runtime, self.clock)
        for listener in self.on_gate:
            listener(self.gate)
        for name, live in (
            ("robot", self._live_robot),
            ("camera", self._live_camera),
            ("cell", self._live_cell),
        ):
            self._start(name, live)
        try:
            async with asyncio.TaskGroup() as tasks:
                for chore in self.gate._chores():
                    tasks.create_task(chore)
        finally:
            gate, self.gate = self.gate, None
            for name in ("cell", "camera", "robot"):
                self.kill(name)
                self._keepers[name].cancel()
            gate._cell_ended(KILLED)
            gate._server.close()
            gate._lines.close()
            gate._ring.close()

    async def _live_cell(self) -> None:
        await asyncio.sleep(START_S["cell"])
        gate_end, cell_end = socket.socketpair()
        if self.gate is None:
            return
        context = copy_context()
        context.run(PROCESS.set, "gate")
        context.run(self.gate._cell_started, gate_end)
        self.cell = Cell(self.resolved, self.clock, self.camera.film)
        await self.cell.run(cell_end)

    async def _live_camera(self) -> None:
        await asyncio.sleep(START_S["camera"])
        await self.camera.live(self.runtime, self._pid)

    async def _live_robot(self) -> None:
        await asyncio.sleep(START_S["robot"])
        await self.robot.live(self.runtime, self._pid)
