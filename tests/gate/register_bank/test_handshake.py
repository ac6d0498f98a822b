"""Which request is forwarded, and that its own answer and no other is shown, until it is cleared."""

import struct
from dataclasses import replace

import pytest

from tests.gate.register_bank.bench import Bench
from vgrd.registers import Command, Status


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


def test_a_continuous_answer_that_nobody_asked_for_is_shown_also_after_a_clear(bench):
    bench.publish(bench.answer(0, seq=1))
    assert bench.status() == (0, Status.OK)
    bench.trigger(5)
    bench.trigger(0)
    assert bench.status() == (0, Status.IDLE)
    bench.publish(bench.answer(0, seq=2))
    assert bench.status() == (0, Status.OK)


def test_a_closed_desk_answers_every_trig_with_the_reason(bench):
    bench.trigger(7)
    bench.bank.close(Status.SHUTTING_DOWN)
    assert bench.status() == (7, Status.SHUTTING_DOWN)
    bench.publish(bench.answer(7, seq=1))
    bench.trigger(8)
    assert bench.status() == (8, Status.SHUTTING_DOWN)
    assert len(bench.forwarded) == 1
