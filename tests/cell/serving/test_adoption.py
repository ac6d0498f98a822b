"""A tag that slipped a little is taken over by a person: served again, logged, for a while, and taken back."""

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.world.poses import WORK_ROTATION, retracted_pose
from tests.cell.serving.bench import Bench, Taught, at
from vgrd.calibration.adoption import TERM_S
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.activation import Activation
from vgrd.errors import ControlError, InputError
from vgrd.geometry import Pose
from vgrd.model import Link
from vgrd.registers import Status
from vgrd.store.calibrations import CalibrationStore

LIFT_MM = 0.2  # of tag B off its plane: no turn explains it
PICTURE_S = 0.5


def lifted(sight: Sight) -> Sight:
    assert sight.tag_b is not None
    up = Pose.from_rotvec((0, 0, 0), (0, 0, LIFT_MM))
    tag_b = replace(sight.tag_b, camera_from_tag=sight.tag_b.camera_from_tag @ up)
    return replace(sight, tag_b=tag_b)


class Slipped:
    """A cell in which tag B has slipped; its calibrations are in a store."""

    def __init__(self, folder: Path, bench: Bench, taught: Taught) -> None:
        self.bench, self.taught = bench, taught
        self.store = CalibrationStore(folder, bench.clock)
        self.store.activate(self.store.save(taught.calibration))
        serving = bench.serving
        self.activation = Activation(serving, self.store, taught.calibration.facts, (0.5, 5e-3))
        asyncio.run(self.activation.load_current())
        bench.measuring.show(taught.sight)
        self.watch(3)

    def watch(self, pictures: int) -> None:
        for _ in range(pictures):
            self.bench.clock.sleep(PICTURE_S)
            self.bench.measuring.show(at(lifted(self.taught.sight), self.bench.clock.monotonic()))

    def adopt(self, link: Link = Link.TAG_B) -> dict[str, object]:
        reply = asyncio.run(self.activation.adopt(link, "operator"))
        self.watch(1)
        return dict(reply)


@pytest.fixture
def slipped(tmp_path: Path, bench: Bench, taught: Taught) -> Slipped:
    return Slipped(tmp_path, bench, taught)


def test_nothing_is_taken_over_before_pictures_tell_how_far(slipped: Slipped) -> None:
    assert slipped.bench.ask().answer.status is Status.CALIBRATION_DRIFT
    with pytest.raises(InputError, match="have come: wait"):
        slipped.adopt()


def test_what_is_taken_over_is_served_with_another_id_and_a_larger_uncertainty(
    slipped: Slipped,
) -> None:
    taught = slipped.taught
    slipped.bench.measuring.show(at(taught.sight, slipped.bench.clock.monotonic()))
    before = slipped.bench.ask().answer
    slipped.watch(25)
    refused = slipped.bench.ask().answer
    assert refused.status is Status.CALIBRATION_DRIFT
    assert refused.moved_um == pytest.approx(1000 * LIFT_MM, rel=0.2)
    reply = slipped.adopt()
    after = slipped.bench.ask().answer
    assert after.status.is_ok
    assert reply["slip_mm"] == pytest.approx(LIFT_MM, rel=0.1)
    assert after.calibration_id != before.calibration_id
    assert after.u95_um > before.u95_um + 1000 * 0.1 * LIFT_MM
    np.testing.assert_allclose(after.position_um, before.position_um, atol=50)
    last = slipped.store.activations()[-1]
    assert (last.calibration, last.previous, last.by) == ("cal-000002", "cal-000001", "operator")


def test_it_ends_by_either_clock_unless_a_touch_bears_it_out(slipped: Slipped) -> None:
    slipped.watch(25)
    slipped.adopt()
    clock = slipped.bench.clock
    clock.sleep(TERM_S + 1.0)
    slipped.watch(1)
    fault = slipped.bench.serving.fault()
    assert fault is not None
    assert fault[0] is Status.CALIBRATION_DRIFT
    assert "not borne out by a touch in time" in fault[1]
    asyncio.run(slipped.activation.activate("cal-000001", "operator"))  # it is taken back
    slipped.bench.measuring.show(at(slipped.taught.sight, clock.monotonic()))
    assert slipped.bench.ask().answer.status.is_ok


def test_a_touch_bears_it_out(slipped: Slipped) -> None:
    slipped.watch(25)
    slipped.adopt()
    rehearsal = slipped.taught.rehearsal
    touch = rehearsal.touch("P2", WORK_ROTATION)
    rehearsal.stand(retracted_pose(), 0.7)
    assert touch.observation is not None
    assert touch.observation.tag_b is not None
    up = Pose.from_rotvec((0, 0, 0), (0, 0, LIFT_MM))
    seen = replace(
        touch.observation.tag_b, camera_from_tag=touch.observation.tag_b.camera_from_tag @ up
    )
    touch = replace(touch, observation=replace(touch.observation, tag_b=seen))
    reply = asyncio.run(slipped.activation.bear_out(touch))
    assert reply["adopted_slip"] == "borne out"
    slipped.bench.clock.sleep(2 * TERM_S)
    slipped.watch(1)
    assert slipped.bench.ask().answer.status.is_ok
    assert asyncio.run(slipped.activation.bear_out(touch)) == {}


def test_a_slip_that_is_too_large_is_not_taken_over(slipped: Slipped) -> None:
    slipped.watch(25)
    slipped.activation.most_adopted = (0.1, 1e-3)
    with pytest.raises(InputError, match=r"at most 0\.1 mm"):
        slipped.adopt()
    assert slipped.store.list() == ("cal-000001",)


def test_a_latched_slip_is_not_forgotten_before_pictures_show_none(
    bench: Bench, taught: Taught
) -> None:
    """As after a restart, and after the same calibration was activated once more."""
    faults = bench.serving.faults
    faults.latched = (Status.CALIBRATION_DRIFT, "tag B sits elsewhere")
    bench.serving.use(taught.calibration, 1)
    with pytest.raises(ControlError, match="of 20 pictures have shown"):
        bench.serving.confirm()
    for _ in range(25):
        bench.clock.sleep(PICTURE_S)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic()))
    bench.serving.confirm()
    assert faults.latched is None


def test_a_clock_that_was_ahead_makes_no_term_longer(slipped: Slipped) -> None:
    slipped.watch(25)
    slipped.adopt()
    clock = slipped.bench.clock
    stored = slipped.store.current()
    ahead = replace(
        stored.calibration,
        adopted=(replace(stored.calibration.adopted[0], term_unix_s=clock.wall() + 30 * TERM_S),),
    )
    slipped.bench.serving.use(ahead, 1)
    clock.sleep(TERM_S + 1.0)
    slipped.watch(1)
    fault = slipped.bench.serving.fault()
    assert fault is not None
    assert "not borne out" in fault[1]
