"""How long an answer stands: until the object moves, its tag is hidden, it is too old or it is dropped."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cell.serving.bench import CALIBRATION_ID, LIMITS, Bench, Taught, at, hidden, turned
from vgrd.cell.serving.vouching import MARGIN_S, Hold
from vgrd.geometry import Pose
from vgrd.registers import Command, State, Status


def test_an_answer_stands_until_the_object_moves(bench: Bench, taught: Taught) -> None:
    assert bench.ask().answer.status is Status.OK
    assert bench.measuring.watching
    bench.measuring.show(at(taught.sight, 1000.3))
    assert bench.read().answer.status is Status.OK
    bench.measuring.show(turned(taught, 0.02, 1000.4))
    assert bench.read().answer.status is Status.OBJECT_MOVED
    assert not bench.measuring.watching
    bench.measuring.show(at(taught.sight, 1000.5))
    assert bench.read().answer.status is Status.OBJECT_MOVED


@pytest.mark.parametrize("trouble", ["robot", "blind", "camera"])
def test_an_answer_that_a_fault_has_ended_does_not_come_back_with_its_cause_gone(
    bench: Bench, trouble: str
) -> None:
    assert bench.ask().answer.status is Status.OK
    before = bench.read().answer.seq
    bench.measuring.troubles[trouble] = "gone"
    assert not bench.read().answer.status.is_ok
    bench.measuring.troubles[trouble] = ""
    image = bench.read()
    assert not image.answer.status.is_ok
    assert image.answer.seq != before
    assert image.state & State.READY
    assert bench.ask().answer.status is Status.OK


def test_without_pictures_an_answer_expires_in_the_registers_after_period_latency_and_margin(
    bench: Bench, taught: Taught
) -> None:
    """The camera froze or is off the net; the registers need nobody to tell them."""
    vouch = bench.serving.vouch
    assert bench.ask().answer.status is Status.OK
    for _ in range(5):
        bench.clock.sleep(0.1)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.03))
    assert vouch.latency_s <= 0.2 + 1e-9
    assert bench.read().answer.valid_until_s == pytest.approx(vouch.until_s)
    last_s = bench.measuring.sight.stamp_s  # type: ignore[union-attr]
    assert vouch.until_s == pytest.approx(last_s + vouch.span_s)
    bench.clock.now_s = vouch.until_s - 0.001
    assert bench.read().answer.status is Status.OK
    assert bench.status_after(0.002) is Status.GRAB_TIMEOUT


def test_the_first_picture_after_an_answer_must_come_in_time(bench: Bench) -> None:
    assert bench.ask().answer.status is Status.OK
    vouch = bench.serving.vouch
    assert bench.status_after(vouch.interval_s + MARGIN_S - 0.01) is Status.OK
    assert bench.status_after(0.02) is Status.GRAB_TIMEOUT


def test_pictures_never_make_an_answer_older_than_it_may_be(bench: Bench, taught: Taught) -> None:
    assert bench.ask().answer.status is Status.OK
    until_s = taught.sight.stamp_s + LIMITS.max_age_s
    while bench.clock.monotonic() < until_s + 1.0:
        bench.clock.sleep(0.05)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.02))
        assert bench.read().answer.valid_until_s <= bench.serving.answer.captured_s + 3.0


def test_a_hidden_tag_ends_the_answer(bench: Bench, taught: Taught) -> None:
    bench.ask()
    bench.measuring.show(hidden(taught.sight, 1000.3))
    assert bench.read().answer.status is Status.TAG_B_NOT_FOUND
    bench.measuring.show(at(taught.sight, 1000.4))
    assert bench.read().answer.status is Status.TAG_B_NOT_FOUND


class TestHold:
    """hidden_tag = "hold": bounded in time, and to an arm that may well hide the tag itself."""

    LIMITS = replace(LIMITS, hold=Hold(1.0, 60.0))

    @pytest.fixture
    def bench(self, tmp_path: Path, taught: Taught) -> Bench:
        bench = Bench(tmp_path, taught, self.LIMITS)
        image = bench.ask()
        assert image.answer.status is Status.OK
        position_mm = np.array(image.answer.position_um) / 1000
        bench.measuring.flange = Pose(np.eye(3), position_mm + np.array((0, 0, 50.0)))
        return bench

    def test_an_arm_near_the_target_may_hide_the_tag_for_a_while(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        image = bench.read()
        assert image.answer.status is Status.OK
        assert image.state & State.HELD
        seen_s = bench.serving.standing.basis.latest_stamp_s
        while (
            bench.clock.monotonic() < seen_s + 0.9
        ):  # pictures without the tag do not lengthen it
            bench.clock.sleep(0.1)
            bench.measuring.show(hidden(taught.sight, bench.clock.monotonic() - 0.02))
            assert bench.read().answer.status is Status.OK
        bench.measuring.show(hidden(taught.sight, seen_s + 0.98))
        bench.clock.now_s = seen_s + 0.99
        assert bench.read().answer.status is Status.OK
        assert bench.status_after(0.02) is Status.TAG_B_NOT_FOUND

    def test_a_camera_that_freezes_ends_it_as_it_ends_every_answer(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.25))
        assert bench.read().answer.status is Status.OK
        until_s = bench.serving.vouch.until_s
        assert until_s < bench.serving.standing.basis.latest_stamp_s + 1.0
        bench.clock.now_s = until_s + 0.001
        assert bench.read().answer.status is Status.GRAB_TIMEOUT

    def test_it_goes_on_when_the_tag_comes_back_in_its_place_and_ends_when_elsewhere(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        bench.clock.sleep(0.3)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic()))
        image = bench.read()
        assert image.answer.status is Status.OK
        assert not image.state & State.HELD
        assert image.answer.valid_until_s < bench.clock.monotonic() + 1.0
        bench.measuring.show(hidden(taught.sight, bench.clock.monotonic() + 0.01))
        bench.measuring.show(turned(taught, 0.02, bench.clock.monotonic() + 0.02))
        assert bench.read().answer.status is Status.OBJECT_MOVED

    def test_an_arm_that_is_away_or_goes_away_cannot_be_what_hides_it(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        assert bench.read().answer.status is Status.OK
        away_mm = bench.measuring.flange.translation + np.array((0, 0, 20.0))
        bench.measuring.flange = Pose(np.eye(3), away_mm)
        assert bench.read().answer.status is Status.TAG_B_NOT_FOUND

    @pytest.mark.parametrize("trouble", ["robot", "blind", "camera"])
    def test_it_ends_with_the_camera_or_the_robot(
        self, bench: Bench, taught: Taught, trouble: str
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        bench.measuring.troubles[trouble] = "gone"
        assert not bench.read().answer.status.is_ok


def test_an_answer_that_is_too_old_ends_and_is_watched_no_more(
    bench: Bench, taught: Taught
) -> None:
    assert bench.ask().answer.status is Status.OK
    until_s = bench.read().answer.captured_s + LIMITS.max_age_s
    while bench.clock.monotonic() < until_s:
        bench.clock.sleep(0.05)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.02))
    assert bench.read().answer.status is Status.IMAGE_TOO_OLD
    assert not bench.measuring.watching


def test_clear_drops_the_answer(bench: Bench) -> None:
    bench.ask()
    image = bench.ask(CMD=Command.CLEAR, TRIG=8)
    assert (image.answer.status, image.answer.echo) == (Status.IDLE, 8)


def test_an_answer_that_another_calibration_drops_stays_the_answer_to_its_request(
    bench: Bench, taught: Taught
) -> None:
    first = bench.ask().answer
    bench.serving.use(taught.calibration, CALIBRATION_ID + 1)
    dropped = bench.read().answer
    assert dropped.status is Status.IDLE
    assert (dropped.nonce, dropped.echo, dropped.point) == (first.nonce, 7, 1)
