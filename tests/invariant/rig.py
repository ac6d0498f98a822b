"""The machine: a daemon in simulated time, robots that poll it all the time, and all that can happen to it.

Every public method below `What people do` is a rule. `RULES` in `rules.py` says which faults it stands for.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterator
from contextvars import copy_context
from dataclasses import replace
from pathlib import Path
from typing import Self

import structlog

from tests.invariant.daemon import Daemon
from tests.invariant.desk import Desk
from tests.invariant.judge import Judge, Lie
from tests.invariant.robots import BLOCK, Asked, Link, pieces
from tests.invariant.simulated_time import PROCESS
from tests.invariant.teaching import Variant
from vgrd.errors import ControlError, VgrdError
from vgrd.gate.gate import Gate
from vgrd.registers import RESPONSE, SWAPPED_FROM

SETTLED_S = 6.0  # until all processes run and pictures come
SILENT = logging.CRITICAL  # nothing logs so loudly
_AGE = RESPONSE.registers("AGE")[0]
_STATE_AT = slice(2 * (102 - 100), 2 * (103 - 100))


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
    """read_s: from one read of a poller to its next; slow_s: idem, register by register, at most."""

    def __init__(
        self,
        folder: Path,
        variant: Variant,
        seed: int,
        *,
        read_s: float = 0.004,
        slow_s: float = 0.01,
    ) -> None:
        self.read_s, self.slow_s = read_s, slow_s
        self.daemon = Daemon(folder, variant, seed)
        self.plant, self.clock, self.rng = self.daemon.plant, self.daemon.clock, self.daemon.rng
        self.desk = Desk()
        self.links = [Link(self.daemon.loop) for _ in range(3)]
        stored = {
            self.daemon.register_id(name): calibration
            for name, calibration in self.daemon.calibrations.items()
        }
        self.judge = Judge(self.plant, self.daemon.camera.film, self.desk, variant, stored)
        self.lies: list[str] = []
        self._trigs = [1, 2]
        self.daemon.on_gate.append(self._connect)
        self.daemon.start()
        self._client(self._poll_block())
        self._client(self._poll_copy())
        self._client(self._poll_pieces())
        self.daemon.run_for(SETTLED_S)

    def wait(self, seconds: float) -> None:
        """Let time pass; raises Lie when a robot read one."""
        self.daemon.run_for(seconds)
        if self.lies:
            raise Lie(self.lies[0])

    def close(self) -> None:
        self.daemon.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Robots that poll.

    def _connect(self, gate: Gate) -> None:
        self.desk.forget()
        for link in self.links:
            link.connect(gate)

    def _client(self, program: object) -> None:
        context = copy_context()
        context.run(PROCESS.set, "robot program")
        self.daemon.loop.create_task(program, context=context)  # type: ignore[arg-type]

    async def _poll_block(self) -> None:
        while True:
            await asyncio.sleep(self.rng.uniform(0.5, 1.5) * self.read_s)
            block = self.links[0].read(RESPONSE.start, BLOCK)
            if block is not None:
                self._judge(block)

    async def _poll_copy(self) -> None:
        while True:
            await asyncio.sleep(self.rng.uniform(0.5, 1.5) * self.read_s)
            copy = self.links[1].read(SWAPPED_FROM, BLOCK)
            if copy is not None:
                self._judge(RESPONSE.swapped(copy), copy)

    async def _poll_pieces(self) -> None:
        """A reader of single registers, sometimes so slow that much happens meanwhile."""
        while True:
            pause_s = self.rng.uniform(0, 1) ** 4 * self.slow_s + 1e-4
            steps, age_s, block = pieces(self.links[2]), self.clock.now_s, None
            while True:
                try:
                    age_s = self.clock.now_s if next(steps) == _AGE else age_s
                except StopIteration as end:
                    block = end.value
                    break
                self.judge.counts["reads of one register"] += 1
                await asyncio.sleep(self.rng.uniform(0, 2) * pause_s)
            if block is not None:
                self._judge(block, age_read_s=age_s)
                self.judge.counts["sets of registers"] += 1
            await asyncio.sleep(self.rng.uniform(0, 0.1))

    def _judge(
        self, block: bytes, as_read: bytes | None = None, age_read_s: float | None = None
    ) -> None:
        self.desk.state = int.from_bytes(block[_STATE_AT], "big")
        try:
            self.judge.read(block, self.clock.now_s, as_read, age_read_s)
        except Lie as lie:
            self.lies.append(str(lie))

    # What people do.

    def ask(self, client: int, asked: Asked, *, trig: int | None = None) -> None:
        """A program writes a request with a TRIG of its own, or with any."""
        self._trigs[client] = (self._trigs[client] + 2) % 0xFFFE
        request = replace(asked, trig=trig if trig is not None else self._trigs[client] + 1)
        self._write(client, 0, request.words())

    def write(self, client: int, address: int, words: list[int]) -> None:
        """A careless program writes some registers."""
        self._write(client, address, words)

    def coil(self, client: int, address: int, on: bool) -> None:
        now = self.clock.now_s
        if self._in_loop(lambda: self.links[client].write_coil(address, on)):
            self.desk.wrote_coil(address, on, now)

    def garbage(self, client: int, data: bytes) -> None:
        """Bytes that are no Modbus."""
        self._in_loop(lambda: self.links[client].send(data))

    def turn(self, angle_rad: float) -> None:
        self.plant.turn(angle_rad, self.clock.now_s)

    def activate(self, name: str) -> None:
        """An operator puts another calibration in use, and does not wait."""
        cell = self.daemon.cell
        if cell is not None:
            self._forget_error(cell.activation.activate(name, "operator"))

    def confirm(self) -> None:
        cell = self.daemon.cell
        if cell is not None:
            with contextlib.suppress(ControlError):
                self._in_loop(cell.serving.confirm)

    def _write(self, client: int, address: int, words: list[int]) -> None:
        now = self.clock.now_s
        if self._in_loop(lambda: self.links[client].write(address, words)):
            self.desk.wrote(address, words, now)

    def _forget_error(self, work: object) -> None:
        async def perform() -> None:
            with contextlib.suppress(VgrdError):
                await work  # type: ignore[misc]

        context = copy_context()
        context.run(PROCESS.set, "cell")
        self.daemon.loop.create_task(perform(), context=context)

    def _in_loop(self, act: Callable[[], object]) -> object:
        """Do something between two moments of the loop."""

        async def perform() -> object:
            return act()

        context = copy_context()
        context.run(PROCESS.set, "robot program")
        return self.daemon.loop.run_until_complete(
            self.daemon.loop.create_task(perform(), context=context)
        )
