"""The handshake, with a clock that stands still."""

import struct
from dataclasses import replace

import pytest

from fakes.testing import ManualClock
from vgrd.gate.image_feed import ImageFeed
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
    Scale16,
    State,
    Status,
    reply,
)

DEADLINE_S = 0.25
TIMEOUT_S = 5.0


class Bench:
    """A desk, the cell's side of it, and the clock."""

    def __init__(self, runtime_dir, scale=Scale16.MRAD):
        self.clock = ManualClock()
        self.runtime_dir = runtime_dir
        self.ring = None
        self.forwarded: list[Request] = []
        self.aborts = 0
        self.reachable = True
        self.bank = RegisterBank(
            ImageFeed(runtime_dir, self.clock),
            self.clock,
            deadline_s=DEADLINE_S,
            timeout_s=TIMEOUT_S,
            forward=self.forward,
            abort=self.abort,
            scale=scale,
        )

    def forward(self, request: Request) -> bool:
        """Take a request as the cell would."""
        if self.reachable:
            self.forwarded.append(request)
        return self.reachable

    def abort(self) -> None:
        """Count."""
        self.aborts += 1

    def start_cell(self) -> None:
        """Make the ring anew, as a cell that starts."""
        path = self.runtime_dir / REGISTER_RING
        self.ring = RingWriter.create(path, 4, PACKED_BYTES, REGISTER_KIND)

    def publish(self, answer: Answer | None = None, state: State = State.READY, beat=0) -> None:
        """Publish as the cell."""
        now = self.clock.monotonic()
        image = RegisterImage(answer or Answer(), state, beat, now)
        self.ring.publish(image.pack(), stamp_s=now)

    def answer(self, trig: int, seq: int, **more) -> Answer:
        """An answer that holds for a second, to the last request with that TRIG, 0: nobody's."""
        now = self.clock.monotonic()
        asked = [request for request in self.forwarded if request.trig == trig]
        to = reply(asked[-1], Status.OK) if asked else Answer(Status.OK)
        valid = {"captured_s": now, "valid_until_s": now + 1.0, "position_um": (1, 2, 3)}
        return replace(to, seq=seq, **{**valid, **more})

    def trigger(self, trig: int, command: int = Command.EC_FRESH, point=4, timeout_ms=0) -> None:
        """Write a request in one piece."""
        words = [trig, command, point, 0, 0, 0, 0, 0, 0, timeout_ms]
        assert self.bank.write_registers(0, struct.pack(">10H", *words))

    def see(self) -> dict[str, float]:
        """Read the response."""
        return RESPONSE.decode(self.bank.read_registers(100, 68))

    def status(self) -> tuple[float, float]:
        """ECHO and STATUS."""
        v = self.see()
        return v["ECHO"], v["STATUS"]


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    made.start_cell()
    made.publish()
    return made


def test_before_the_cell_lives_the_daemon_is_starting_and_answers_so(tmp_path):
    bench = Bench(tmp_path)
    assert bench.status() == (0, Status.STARTING)
    bench.trigger(3)
    assert bench.status() == (3, Status.STARTING)
    bench.clock.now_s += 0.1
    bench.start_cell()
    bench.publish()
    assert bench.status() == (3, Status.STARTING)
    bench.trigger(4)
    assert bench.status() == (0, Status.BUSY)


def test_a_cell_that_does_not_live_finds_no_old_requests_when_it_starts(bench):
    bench.bank.cell_lost()
    for trig in range(1, 400):
        bench.trigger(trig)
        assert bench.status() == (trig, Status.INTERNAL_ERROR)
    assert bench.forwarded == []
    bench.start_cell()
    bench.publish()
    bench.trigger(400)
    assert [request.trig for request in bench.forwarded] == [400]


def test_a_request_is_busy_before_its_write_is_answered_and_then_holds_its_answer(bench):
    bench.trigger(7)
    assert bench.bank._space[2 * 104 : 2 * 105] == struct.pack(">H", Status.BUSY)
    assert [request.trig for request in bench.forwarded] == [7]
    assert bench.forwarded[0].point == 4
    bench.publish()
    assert bench.status() == (0, Status.BUSY)
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (7, Status.OK)
    assert bench.see()["EC32_Z"] == 3


def test_the_same_trig_again_starts_nothing_and_a_change_by_one_register_does(bench):
    bench.trigger(7)
    bench.trigger(7)
    assert len(bench.forwarded) == 1
    bench.bank.write_registers(0, struct.pack(">H", 8))
    assert [request.trig for request in bench.forwarded] == [7, 8]
    assert bench.bank.counters["superseded"] == 1


@pytest.mark.parametrize("answered", [True, False], ids=["answered", "pending"])
def test_the_same_trig_with_another_point_is_refused_and_shows_no_earlier_coordinate(
    bench, answered
):
    """A robot program that starts anew counts from 1 again; ECHO 1 must not be its predecessor's answer."""
    bench.trigger(1)
    if answered:
        bench.publish(bench.answer(1, seq=1))
        assert bench.status() == (1, Status.OK)
    other = bytearray(bench.bank._request)
    other[2 * 2 : 2 * 3] = struct.pack(">H", 9)
    bench.bank.write_registers(0, bytes(other))
    assert bench.status() == (1, Status.BAD_PARAMETER)
    assert bench.see()["DETAIL"] == 0
    assert bench.see()["POINT"] == 9
    bench.publish(bench.answer(1, seq=2))
    assert bench.status() == (1, Status.BAD_PARAMETER)
    bench.bank.write_registers(0, bytes(other))
    assert bench.status() == (1, Status.BAD_PARAMETER)
    bench.trigger(2)
    assert bench.status() == (0, Status.BUSY)


def test_only_the_newest_of_two_requests_is_answered(bench):
    bench.trigger(7)
    bench.trigger(8)
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (0, Status.BUSY)
    bench.publish(bench.answer(8, seq=2))
    assert bench.status() == (8, Status.OK)


def test_an_old_answer_to_the_same_trig_is_not_taken_for_the_new_one(bench):
    bench.trigger(7)
    old = bench.answer(7, seq=1)
    bench.publish(old)
    assert bench.status() == (7, Status.OK)
    bench.trigger(0)
    bench.trigger(7)
    bench.publish(old)
    assert bench.status() == (0, Status.BUSY)
    bench.publish(bench.answer(7, seq=2))
    assert bench.status() == (7, Status.OK)


def test_an_answer_to_the_same_trig_but_another_point_is_not_taken(bench):
    """TRIG 1, 2, 1 while the first is in work: its answer, late and with a new SEQ, is for POINT 1."""
    bench.trigger(1, point=1)
    first = bench.answer(1, seq=1)
    bench.trigger(2, point=9)
    bench.trigger(1, point=2)
    bench.publish(first)
    assert bench.status() == (0, Status.BUSY)
    assert bench.see()["EC32_X"] == -(2**31)
    bench.publish(bench.answer(1, seq=2))
    assert bench.status() == (1, Status.OK)
    assert bench.see()["POINT"] == 2
    bench.publish(replace(first, seq=3))
    assert bench.status() == (0, Status.IDLE)
    assert bench.see()["EC32_X"] == -(2**31)


@pytest.mark.parametrize("field", ["echo", "point", "object"])
def test_an_answer_that_says_another_question_than_was_asked_is_an_error(bench, field):
    bench.trigger(1, point=2)
    bench.publish(bench.answer(1, seq=1, **{field: 40}))
    assert bench.status() == (1, Status.INTERNAL_ERROR)
    v = bench.see()
    assert (v["POINT"], v["OBJECT"], v["EC32_X"]) == (2, 0, -(2**31))


def test_a_gate_that_comes_back_does_not_show_what_its_predecessor_was_answered(bench):
    bench.trigger(7)
    answer = bench.answer(7, seq=1)
    bench.publish(answer)
    assert bench.status() == (7, Status.OK)
    again = Bench(bench.runtime_dir)
    again.clock, again.ring = bench.clock, bench.ring
    assert again.status() == (0, Status.IDLE)
    again.trigger(7)
    bench.publish(replace(answer, seq=2))
    assert again.status() == (0, Status.BUSY)


def test_nonces_of_two_gates_do_not_meet(tmp_path):
    nonces = set()
    for number in range(50):
        (tmp_path / str(number)).mkdir()
        bench = Bench(tmp_path / str(number))
        bench.start_cell()
        bench.publish()
        bench.trigger(1)
        bench.trigger(2)
        nonces |= {request.nonce for request in bench.forwarded}
    assert len(nonces) == 100
    assert 0 not in nonces


def test_an_answer_read_late_has_expired(bench):
    bench.trigger(7)
    answer = bench.answer(7, seq=1)
    bench.publish(answer)
    for _ in range(9):
        bench.clock.now_s += 0.1
        bench.publish(answer)
    assert bench.status() == (7, Status.OK)
    bench.clock.now_s += 0.1
    bench.publish(answer)
    assert bench.status() == (7, Status.IMAGE_TOO_OLD)
    assert bench.see()["EC32_X"] == -(2**31)


def test_an_answer_expires_between_two_images(bench):
    bench.trigger(7)
    answer = bench.answer(7, seq=1, valid_until_s=bench.clock.now_s + 0.1)
    bench.publish(answer)
    assert bench.status() == (7, Status.OK)
    bench.clock.now_s += 0.1
    assert bench.status() == (7, Status.IMAGE_TOO_OLD)


def test_the_object_that_moves_after_the_answer_takes_it_away(bench):
    bench.trigger(7)
    answer = bench.answer(7, seq=1)
    bench.publish(answer)
    assert bench.status() == (7, Status.OK)
    bench.publish(replace(answer, status=Status.OBJECT_MOVED))
    assert bench.status() == (7, Status.OBJECT_MOVED)
    assert bench.see()["EC32_X"] == -(2**31)


def test_age_runs_on_while_the_answer_stands(bench):
    bench.trigger(7)
    answer = bench.answer(7, seq=1)
    bench.publish(answer)
    before = bench.see()["AGE"]
    bench.clock.now_s += 0.125
    assert bench.see()["AGE"] - before == 125


def test_a_request_without_an_answer_times_out_once_and_a_late_answer_is_not_shown(bench):
    bench.trigger(7, timeout_ms=200)
    bench.clock.now_s += 0.2
    bench.publish()
    assert bench.status() == (7, Status.TIMEOUT)
    assert bench.aborts == 1
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (7, Status.TIMEOUT)
    bench.trigger(8)
    assert bench.status() == (0, Status.BUSY)


def test_without_tmo_the_configured_timeout_holds(bench):
    bench.trigger(7)
    bench.clock.now_s += TIMEOUT_S - 0.01
    bench.publish()
    assert bench.status() == (0, Status.BUSY)
    bench.clock.now_s += 0.02
    bench.publish()
    assert bench.status() == (7, Status.TIMEOUT)


def test_a_silent_cell_loses_the_request_and_the_answer_stays_when_it_comes_back(bench):
    bench.trigger(7)
    bench.clock.now_s += DEADLINE_S
    assert bench.status() == (7, Status.INTERNAL_ERROR)
    bench.start_cell()
    bench.publish()
    assert bench.status() == (7, Status.INTERNAL_ERROR)
    bench.trigger(8)
    bench.publish(bench.answer(8, seq=1))
    assert bench.status() == (8, Status.OK)


def test_a_dead_cell_is_invalid_at_once(bench):
    bench.trigger(7)
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (7, Status.OK)
    bench.bank.cell_lost()
    assert bench.see()["STATUS"] == Status.INTERNAL_ERROR
    bench.trigger(8)
    assert bench.status() == (8, Status.INTERNAL_ERROR)


def test_a_request_that_cannot_be_passed_on_is_answered_at_once(bench):
    bench.reachable = False
    bench.trigger(7)
    assert bench.status() == (7, Status.INTERNAL_ERROR)


def test_a_damaged_ring_is_a_lost_cell_until_there_is_a_good_one(bench):
    bench.trigger(7)
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (7, Status.OK)
    path = bench.runtime_dir / REGISTER_RING
    bench.publish(bench.answer(7, seq=1))
    with path.open("r+b") as file:
        file.seek(4096 + 64)
        file.write(b"\xa5" * (path.stat().st_size - 4096 - 64))
    bench.clock.now_s += DEADLINE_S
    assert bench.see()["STATUS"] == Status.INTERNAL_ERROR
    path.unlink()
    assert bench.see()["STATUS"] == Status.INTERNAL_ERROR
    bench.start_cell()
    bench.publish(bench.answer(7, seq=1))
    bench.clock.now_s += 0.06
    assert bench.see()["STATUS"] == Status.OK


def test_a_cell_that_comes_back_after_its_ring_was_deleted_is_seen(bench, monkeypatch):
    monkeypatch.setattr("vgrd.ipc.ring.monotonic", bench.clock.monotonic)
    bench.trigger(7)
    bench.publish(bench.answer(7, seq=1))
    assert bench.status() == (7, Status.OK)
    (bench.runtime_dir / REGISTER_RING).unlink()
    bench.bank.cell_lost()
    bench.start_cell()
    bench.publish()
    bench.clock.now_s += 0.06
    assert bench.see()["STATUS"] == Status.IDLE
    bench.trigger(8)
    bench.publish(bench.answer(8, seq=1))
    assert bench.status() == (8, Status.OK)


@pytest.mark.parametrize("how", ["trig 0", "command", "coil"])
def test_clearing_drops_answer_and_request_and_tells_the_cell(bench, how):
    bench.trigger(6)
    bench.publish(bench.answer(6, seq=1))
    assert bench.status() == (6, Status.OK)
    echo = 0
    if how == "trig 0":
        bench.trigger(0)
    elif how == "command":
        bench.trigger(echo := 7, command=Command.CLEAR)
    else:
        bench.bank.write_coils(1, [True])
    assert bench.status() == (echo, Status.IDLE)
    assert bench.aborts == 1
    assert len(bench.forwarded) == 1
    bench.publish(bench.answer(6, seq=1))
    assert bench.status() == (echo, Status.IDLE)
    bench.trigger(9)
    bench.publish(bench.answer(9, seq=2))
    assert bench.status() == (9, Status.OK)


def test_clearing_does_not_hide_that_the_cell_is_lost(bench):
    bench.trigger(7, command=Command.CLEAR)
    assert bench.status() == (7, Status.IDLE)
    bench.clock.now_s += DEADLINE_S
    assert bench.status() == (7, Status.INTERNAL_ERROR)


def test_a_continuous_answer_that_nobody_asked_for_is_shown_also_after_a_clear(bench):
    bench.publish(bench.answer(0, seq=1))
    assert bench.status() == (0, Status.OK)
    bench.trigger(5)
    bench.trigger(0)
    assert bench.status() == (0, Status.IDLE)
    bench.publish(bench.answer(0, seq=2))
    assert bench.status() == (0, Status.OK)


def test_a_rising_edge_of_the_coil_is_the_next_trig(bench):
    bench.bank.write_registers(0, struct.pack(">3H", 0, Command.EC_NEWEST, 9))
    bench.bank.write_coils(0, [True])
    assert (bench.forwarded[-1].trig, bench.forwarded[-1].point) == (1, 9)
    bench.bank.write_coils(0, [True])
    assert len(bench.forwarded) == 1
    bench.bank.write_coils(0, [False])
    bench.bank.write_coils(0, [True])
    assert bench.forwarded[-1].trig == 2
    assert bench.bank.read_coils(0, 2) == [True, False]


@pytest.mark.parametrize("scale", Scale16)
def test_the_int16_units_of_the_cell_file_hold_in_every_answer(tmp_path, scale):
    bench = Bench(tmp_path, scale=scale)
    assert int(bench.see()["FMT"]) >> 8 == scale
    bench.clock.now_s += 0.1
    bench.start_cell()
    bench.publish()
    bench.trigger(1)
    assert int(bench.see()["FMT"]) >> 8 == scale
    bench.publish(bench.answer(1, seq=1, position_um=(10_000, 0, 0)))
    assert int(bench.see()["FMT"]) >> 8 == scale
    assert bench.see()["EC16_X"] == (200 if scale is Scale16.FINE else 100)


ORIENTATION = struct.pack(">3i", 3_000_000, 0, 100_000)
POLICY_3 = 3 << 8


def test_the_orientation_counts_only_if_all_of_it_was_written_since_the_last_trig(bench):
    def oriented(trig: int) -> bool:
        bench.bank.write_registers(0, struct.pack(">4H", trig, Command.EC_FRESH, 4, POLICY_3))
        return bench.forwarded[-1].orientation_written

    assert not oriented(1)
    bench.bank.write_registers(23, ORIENTATION)
    assert oriented(2)
    assert not oriented(3)
    bench.bank.write_registers(23, ORIENTATION[:10])
    assert not oriented(4)
    bench.bank.write_registers(28, ORIENTATION[10:])
    assert not oriented(5)
    for register in range(23, 29):
        bench.bank.write_registers(register, ORIENTATION[2 * register - 46 : 2 * register - 44])
    assert oriented(6)
    bench.bank.write_registers(23, ORIENTATION)
    bench.trigger(0)
    assert not oriented(7)
    bench.bank.write_registers(23, ORIENTATION)
    bench.bank.write_coils(1, [True])
    assert not oriented(8)
    whole = struct.pack(">4H", 9, Command.EC_FRESH, 4, POLICY_3) + bytes(38) + ORIENTATION
    bench.bank.write_registers(0, whole)
    assert bench.forwarded[-1].trig == 9
    assert bench.forwarded[-1].orientation_written


def test_the_coil_with_policy_3_is_refused_by_name_and_without_it_works_on(bench):
    bench.bank.write_registers(1, struct.pack(">3H", Command.EC_FRESH, 4, POLICY_3))
    bench.bank.write_registers(23, ORIENTATION)
    bench.bank.write_coils(0, [True])
    assert bench.forwarded == []
    assert bench.status() == (1, Status.BAD_PARAMETER)
    assert bench.see()["DETAIL"] == 3
    bench.bank.write_registers(3, bytes(2))
    bench.bank.write_coils(0, [False])
    bench.bank.write_coils(0, [True])
    assert bench.status() == (0, Status.BUSY)


def test_trig_by_coil_goes_round_without_zero(bench):
    bench.trigger(0xFFFF)
    bench.bank.write_coils(0, [True])
    assert bench.forwarded[-1].trig == 1


def test_inputs_show_the_state_and_a_toggle_of_the_heartbeat(bench):
    bench.publish(state=State.READY | State.TAG_B_SEEN, beat=5)
    inputs = bench.bank.read_inputs(0, 17)
    assert [i for i, value in enumerate(inputs) if value] == [0, 10, 16]
    bench.publish(state=State.READY, beat=10)
    assert bench.bank.read_inputs(16, 1) == [False]


def test_a_closed_desk_answers_every_trig_with_the_reason(bench):
    bench.trigger(7)
    bench.bank.close(Status.SHUTTING_DOWN)
    assert bench.status() == (7, Status.SHUTTING_DOWN)
    bench.publish(bench.answer(7, seq=1))
    bench.trigger(8)
    assert bench.status() == (8, Status.SHUTTING_DOWN)
    assert len(bench.forwarded) == 1


@pytest.mark.parametrize(
    ("address", "count", "there"),
    [
        (0, 32, True),
        (31, 2, False),
        (32, 1, False),
        (99, 2, False),
        (100, 68, True),
        (101, 68, False),
        (300, 68, True),
        (367, 1, True),
        (368, 1, False),
        (65535, 125, False),
    ],
)
def test_a_read_must_lie_inside_one_block(bench, address, count, there):
    registers = bench.bank.read_registers(address, count)
    assert (registers is not None) == there
    assert not there or len(registers) == 2 * count


def test_only_the_request_can_be_written(bench):
    assert not bench.bank.write_registers(100, b"\0\1")
    assert not bench.bank.write_registers(31, bytes(4))
    assert not bench.bank.write_coils(1, [True, True])
    assert bench.bank.write_registers(31, b"\1\2")
    assert bench.bank.read_registers(31, 1) == b"\1\2"
