"""What time alone does: an answer ages and expires, a request times out."""

from dataclasses import replace

from tests.gate.register_bank.bench import TIMEOUT_S
from vgrd.registers import Status


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
