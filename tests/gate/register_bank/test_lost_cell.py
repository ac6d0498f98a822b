"""A cell that does not live yet, is silent, died, cannot be reached or whose ring is damaged."""

from tests.gate.register_bank.bench import DEADLINE_S, Bench
from vgrd.registers import REGISTER_RING, Command, Status


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


def test_a_cell_that_comes_back_after_its_ring_was_deleted_is_seen(bench):
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


def test_clearing_does_not_hide_that_the_cell_is_lost(bench):
    bench.trigger(7, command=Command.CLEAR)
    assert bench.status() == (7, Status.IDLE)
    bench.clock.now_s += DEADLINE_S
    assert bench.status() == (7, Status.INTERNAL_ERROR)
