"""Laws of the handshake, in any order of writes, lines, answers, clears, deaths and time."""

import struct
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from fakes.testing import ManualClock
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.lines import LineTalk
from vgrd.gate.register_bank import RegisterBank
from vgrd.ipc.ring import RingWriter
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REGISTER_RING,
    RESPONSE,
    Answer,
    Command,
    RegisterImage,
    Request,
    State,
    Status,
    reply,
)

DEADLINE_S = 0.25
TIMEOUT_S = 2.0
TICK_S = 0.02
NOTHING = ["99999.00"] * 3 + ["999.000"] * 3 + ["9999"]
trigs = st.integers(0, 3)
points = st.integers(1, 3)
connections = st.integers(0, 1)


class Handshake(RuleBasedStateMachine):
    """Robots at the registers and at two lines, a cell that answers any request it ever got, and a clock."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.clock = ManualClock()
        self.got: list[Request] = []
        self.seq = 0
        self.answer = Answer()
        self.reachable = True
        self.asked: tuple[int, int] | None = None  # ECHO and POINT of what is waited for
        self.written_point = 0  # beside TRIG
        self.line_asked: list[tuple[int, int] | None] = [None, None]  # TRIG and POINT
        self.owner: int | None = None  # the line whose request is in force
        self.asked_s = 0.0
        self.settled = False  # the cell answered it
        self.ring: RingWriter | None = None
        feed = ImageFeed(Path(self.folder.name), self.clock)
        self.bank = RegisterBank(
            feed,
            self.clock,
            deadline_s=DEADLINE_S,
            timeout_s=TIMEOUT_S,
            forward=self.forward,
            abort=lambda: None,
        )
        self.lines = [LineTalk(self.bank, Counter(), self.clock) for _ in self.line_asked]

    def forward(self, request: Request) -> bool:
        if self.reachable:
            self.got.append(request)
        return self.reachable

    def teardown(self) -> None:
        self.folder.cleanup()

    @initialize()
    def first_cell(self) -> None:
        self.start_cell()

    @rule()
    def start_cell(self) -> None:
        """A new life of the cell: it knows of no request and counts from 0."""
        path = Path(self.folder.name) / REGISTER_RING
        self.ring = RingWriter.create(path, 4, PACKED_BYTES, REGISTER_KIND)
        self.answer, self.seq = Answer(), 0
        self.publish()

    @rule()
    def delete_ring(self) -> None:
        (Path(self.folder.name) / REGISTER_RING).unlink(missing_ok=True)

    @rule()
    def lose_cell(self) -> None:
        self.bank.cell_lost()

    @rule(reachable=st.booleans())
    def link(self, reachable: bool) -> None:
        self.reachable = reachable

    @rule()
    def publish(self) -> None:
        now = self.clock.monotonic()
        image = RegisterImage(self.answer, State.READY, 0, now)
        self.ring.publish(image.pack(), stamp_s=now)

    @rule(trig=trigs, point=points)
    def ask(self, trig: int, point: int) -> None:
        before = struct.unpack(">H", self.bank.read_registers(0, 1))[0]
        self.bank.write_registers(0, struct.pack(">3H", trig, Command.EC_FRESH, point))
        if trig != before:
            self.asked, self.asked_s = (trig, point) if trig else None, self.clock.now_s
            self.settled, self.owner, self.written_point = False, None, point
        elif trig and point != self.written_point:  # refused, and nothing else is in force
            self.asked, self.owner, self.written_point = (trig, point), None, point

    @rule()
    def clear(self) -> None:
        self.bank.write_coils(1, [False])
        self.bank.write_coils(1, [True])
        self.asked = self.owner = None

    def line(self, number: int, point: int, trig: int) -> list[str]:
        """Fields of the answer."""
        request = f"EC,{point},{trig}\n".encode()
        answer, length, _ = self.lines[number].answer(request)
        assert length == len(request)
        fields = answer.decode("ascii").rstrip("\n").split(",")
        assert fields[0] == str(trig)
        assert (fields[1] in ("1", "2")) == (fields[4:] != NOTHING)
        return fields

    @rule(number=connections, trig=trigs, point=points)
    def ask_by_line(self, number: int, trig: int, point: int) -> None:
        last = self.line_asked[number]
        status = int(self.line(number, point, trig)[1])
        if trig == 0:
            self.line_asked[number] = None
            if self.owner == number:
                self.asked = self.owner = None
        elif last and trig == last[0]:
            assert (status == Status.BAD_PARAMETER) == (point != last[1])
        else:
            self.line_asked[number], self.owner = (trig, point), number
            self.asked, self.asked_s, self.settled = (0, point), self.clock.now_s, False

    @rule(which=st.integers(0, 5), point=st.sampled_from((None, 9)), ok=st.booleans())
    def answer_some(self, which: int, point: int | None, ok: bool) -> None:
        """Answer one of the last requests, late, twice, or with a point that was not asked."""
        if which >= len(self.got):
            return
        self.seq += 1
        self.settled |= which == 0
        request, now = self.got[-1 - which], self.clock.monotonic()
        self.answer = replace(
            reply(request, Status.OK if ok else Status.TAG_B_NOT_FOUND),
            seq=self.seq,
            captured_s=now,
            valid_until_s=now + 1.0,
            position_um=(1000 * (request.nonce % 1000), 1000 * request.point, request.trig),
            **({"point": point} if point else {}),
        )
        self.publish()

    @rule(seconds=st.sampled_from((0.01, 0.1, 0.3, 1.0)))
    def wait(self, seconds: float) -> None:
        self.clock.now_s += seconds

    @rule(seconds=st.sampled_from((0.5, 1.5, 2.5)))
    def wait_beside_a_living_cell(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.clock.now_s += 0.1
            self.publish()

    @invariant()
    def what_is_valid_is_the_answer_to_what_was_asked(self) -> None:
        v = RESPONSE.decode(self.bank.read_registers(100, 68))
        if v["STATUS"] in (Status.OK, Status.OK_DEGRADED):
            assert self.asked == (v["ECHO"], v["POINT"])
            assert v["EC32_X"] == 1000 * (self.got[-1].nonce % 1000)
            assert (v["EC32_Z"], v["EC32_Y"] / 1000) == self.asked
        else:
            assert v["EC32_X"] == -(2**31)

    @invariant()
    def a_line_says_what_the_registers_say_of_its_own_request_and_of_no_other(self) -> None:
        for number, last in enumerate(self.line_asked):
            if last is None:
                continue
            trig, point = last
            fields = self.line(number, point, trig)
            v = RESPONSE.decode(self.bank.read_registers(100, 68))
            if self.owner != number:
                assert int(fields[1]) == Status.SUPERSEDED
                continue
            assert (int(fields[1]), v["ECHO"]) == (v["STATUS"], 0)
            if v["STATUS"] in (Status.OK, Status.OK_DEGRADED):
                assert v["POINT"] == point
                assert [1000 * float(mm) for mm in fields[4:6]] == [v["EC32_X"], v["EC32_Y"]]

    @invariant()
    def a_request_ends(self) -> None:
        self.clock.now_s += TICK_S / 20  # whatever it is, time goes on
        v = RESPONSE.decode(self.bank.read_registers(100, 68))
        if v["STATUS"] == Status.BUSY:
            assert self.asked is not None
            assert self.clock.now_s - self.asked_s < TIMEOUT_S
        if self.asked and not self.settled:
            assert v["STATUS"] == Status.BUSY or v["ECHO"] == self.asked[0]


TestHandshake = Handshake.TestCase
TestHandshake.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)


@pytest.mark.parametrize("cell", ["silent", "answers others", "restarts"])
def test_whatever_the_cell_does_a_request_ends_after_its_time(tmp_path, cell):
    machine = Handshake()
    machine.start_cell()
    machine.ask(1, 1)
    machine.ask(2, 2)
    for _ in range(round(TIMEOUT_S / TICK_S) + 1):
        machine.clock.now_s += TICK_S
        if cell == "answers others":
            machine.answer_some(1, None, True)
        elif cell == "restarts":
            machine.start_cell()
        else:
            machine.publish()
        machine.bank.refresh()
    v = RESPONSE.decode(machine.bank.read_registers(100, 68))
    assert (v["ECHO"], v["STATUS"], v["POINT"]) == (2, Status.TIMEOUT, 2)
    machine.teardown()
