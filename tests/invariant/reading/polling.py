"""The robots of a machine: two that write and read whole blocks, one that reads register by register, two at lines."""

import asyncio
from collections.abc import Coroutine
from contextvars import copy_context

import numpy as np

from tests.invariant.reading.desk import Desk
from tests.invariant.reading.judge import Judge, Lie
from tests.invariant.reading.lines import LineRobot
from tests.invariant.reading.robots import BLOCK, Asked, Link, pieces
from tests.invariant.simulation.daemon import Daemon
from tests.invariant.simulation.simulated_time import PROCESS
from vgrd.gate.gate import Gate
from vgrd.registers import RESPONSE, SWAPPED_FROM

PROGRAM = "robot program"  # whose process the robots are, to the loop
# A set of 69 registers takes up to 10 s, longer than a cell to start anew.
QUICK_S, SLOW_S = 0.001, 0.15
_AGE = RESPONSE.registers("AGE")[0]
_STATE_AT = slice(2 * (102 - 100), 2 * (103 - 100))


class Robots:
    """Poll all the time, unless they pause; `lies` are the reads that must not have been.

    read_s: from one read of a block to the next.
    """

    def __init__(self, daemon: Daemon, judge: Judge, desk: Desk, read_s: float) -> None:
        self.daemon, self.judge, self.desk = daemon, judge, desk
        self.read_s = read_s
        self.pause = False
        self.lies: list[str] = []
        self.links = [Link(daemon.loop) for _ in range(3)]
        self.lines = [LineRobot(daemon.loop, desk, judge.counts) for _ in range(2)]
        self.rng: np.random.Generator = daemon.rng
        self._bank: object = None
        daemon.on_gate.append(self._connect)

    def start(self) -> None:
        for program in (self._poll_block(), self._poll_copy(), self._poll_pieces()):
            self._run(program)
        for line in self.lines:
            self._run(self._poll_line(line))

    def read(self, number: int) -> bool:
        """Read a block now; whether it is valid."""
        block = self.links[number].read(RESPONSE.start, BLOCK)
        return block is not None and self._judge(block)

    def write(self, number: int, address: int, words: list[int]) -> None:
        now = self.daemon.clock.now_s
        self._look_at_desk()
        if self.links[number].write(address, words):
            self.desk.wrote(address, words, now)

    def write_coil(self, number: int, address: int, *, on: bool) -> None:
        now = self.daemon.clock.now_s
        self._look_at_desk()
        if self.links[number].write_coil(address, on):
            self.desk.wrote_coil(address, on, now)

    def ask_by_line(self, number: int, asked: Asked) -> None:
        """A line, with the next TRIG of its connection."""
        self._look_at_desk()
        self.lines[number].ask(asked, self.daemon.clock.now_s)

    def drop_by_line(self, number: int) -> None:
        """TRIG 0."""
        self._look_at_desk()
        self.lines[number].drop()

    def crowd(self, count: int) -> None:
        """So many connections more, which ask once and stay."""
        for _ in range(count):
            link = Link(self.daemon.loop)
            link.connect(self.daemon.gate)
            link.read(RESPONSE.start, 1)

    def _run(self, program: Coroutine[object, object, None]) -> None:
        context = copy_context()
        context.run(PROCESS.set, PROGRAM)
        self.daemon.loop.create_task(program, context=context)

    def _connect(self, gate: Gate) -> None:
        for link in (*self.links, *self.lines):
            link.connect(gate)

    def _look_at_desk(self) -> None:
        """A gate that began anew, or took over another table, has forgotten what was asked."""
        bank = None if self.daemon.gate is None else self.daemon.gate._bank
        if bank is not self._bank:
            self._bank = bank
            self.desk.forget()

    async def _poll_block(self) -> None:
        while True:
            await asyncio.sleep(self.rng.uniform(0.5, 1.5) * self.read_s)
            if not self.pause:
                self.read(0)

    async def _poll_copy(self) -> None:
        while True:
            await asyncio.sleep(self.rng.uniform(0.5, 1.5) * self.read_s)
            copy = None if self.pause else self.links[1].read(SWAPPED_FROM, BLOCK)
            if copy is not None:
                self._judge(RESPONSE.swapped(copy), copy)

    async def _poll_line(self, line: LineRobot) -> None:
        while True:
            await asyncio.sleep(self.rng.uniform(2.0, 6.0) * self.read_s)
            if not self.pause:
                self._look_at_desk()
                self._judge_line(line)

    def _judge_line(self, line: LineRobot) -> None:
        """A line is held against the registers of the same moment, and these against the truth."""
        told = line.read(self.daemon.clock.now_s)
        block = None if told is None else self.links[0].read(RESPONSE.start, BLOCK)
        if told is None or block is None:
            return
        is_valid = self._judge(block)
        try:
            line.compare(told, RESPONSE.decode(block), is_valid=is_valid)
        except Lie as lie:
            self.lies.append(str(lie))

    async def _poll_pieces(self) -> None:
        """Sometimes so slow that much happens meanwhile."""
        while True:
            pause_s = QUICK_S + SLOW_S * self.rng.uniform(0, 1) ** 12
            steps, age_s, block = pieces(self.links[2]), self.daemon.clock.now_s, None
            while True:
                try:
                    age_s = self.daemon.clock.now_s if next(steps) == _AGE else age_s
                except StopIteration as end:
                    block = end.value
                    break
                self.judge.counts["reads"] += 1
                self.judge.counts["reads of one register"] += 1
                await asyncio.sleep(self.rng.uniform(0, 2) * pause_s)
            if block is not None:
                self._judge(block, age_read_s=age_s)
                self.judge.counts["sets of registers"] += 1
            await asyncio.sleep(self.rng.uniform(0, 0.1))

    def _judge(
        self, block: bytes, as_read: bytes | None = None, age_read_s: float | None = None
    ) -> bool:
        self._look_at_desk()
        self.desk.state = int.from_bytes(block[_STATE_AT], "big")
        try:
            return self.judge.read(block, self.daemon.clock.now_s, as_read, age_read_s)
        except Lie as lie:
            self.lies.append(str(lie))
            return True
