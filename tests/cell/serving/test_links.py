"""What the robot is told when camera, tags or object have moved since the calibration."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cell.serving.bench import STABILITY, Bench, Taught, at
from vgrd.calibration.calibration import expected_coordinate
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.camera_memory import MEMORY_S, CameraMemory
from vgrd.errors import NotSteady
from vgrd.geometry import Pose
from vgrd.model import Motion, Policy, TagObservation, frozen_array
from vgrd.registers import Answer, State, Status

KNOCK = Pose.from_rotvec((0.003, -0.004, 0.001), (3.0, -4.0, 1.0))  # 5 mm, 5 mrad
SLIP = Pose.from_rotvec((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
MOVABLE = frozen_array([np.inf] * 6, 6)


@pytest.fixture
def movable(tmp_path: Path, taught: Taught) -> Iterator[Bench]:
    bench = Bench(tmp_path, taught, stability=MOVABLE)
    yield bench
    with contextlib.suppress(ValueError):
        bench.reader.close()


def seen_from(shift: Pose, tag: TagObservation | None) -> TagObservation | None:
    """The tag as a camera sees it that was moved by `shift` in its own frame."""
    if tag is None:
        return None
    return replace(tag, camera_from_tag=shift.inverse() @ tag.camera_from_tag)


def knocked(sight: Sight, shift: Pose = KNOCK) -> Sight:
    return replace(sight, tag_a=seen_from(shift, sight.tag_a), tag_b=seen_from(shift, sight.tag_b))


def slipped(tag: TagObservation | None) -> TagObservation:
    """The tag after it slid on what it is glued to."""
    assert tag is not None
    return replace(tag, camera_from_tag=tag.camera_from_tag @ SLIP)


def place_mm(answer: Answer) -> np.ndarray:
    return np.array(answer.position_um) / 1000


@pytest.mark.parametrize("fixture", ["bench", "movable"])
def test_a_camera_that_was_knocked_is_followed(
    fixture: str, taught: Taught, request: pytest.FixtureRequest
) -> None:
    bench: Bench = request.getfixturevalue(fixture)
    before = bench.ask().answer
    for _ in range(5):
        bench.measuring.show(at(knocked(taught.sight), bench.clock.monotonic()))
    after = bench.ask().answer
    assert (before.status, after.status) == (Status.OK, Status.OK)
    np.testing.assert_allclose(place_mm(after), place_mm(before), atol=0.05)
    assert bench.serving.fault() is None
    words = bench.serving.faults.knock
    assert bool(words) == (fixture == "bench")  # people may move a movable one
    assert fixture == "movable" or "mm, 5.1 mrad from where it was taught" in words


@pytest.mark.parametrize("is_tag_a", [True, False], ids=["tag A", "tag B"])
def test_a_tag_that_slipped_is_refused_named_and_not_forgotten(
    is_tag_a: bool, bench: Bench, taught: Taught
) -> None:
    sight = taught.sight
    name, bit = ("tag A", 2) if is_tag_a else ("tag B", 4)
    wrong = (
        replace(sight, tag_a=slipped(sight.tag_a))
        if is_tag_a
        else replace(sight, tag_b=slipped(sight.tag_b))
    )
    bench.measuring.show(wrong)
    image = bench.ask()
    assert image.answer.status is Status.CALIBRATION_DRIFT
    assert image.answer.detail & bit
    for _ in range(3):
        bench.measuring.show(at(wrong, bench.clock.monotonic()))
    fault = bench.serving.fault()
    assert fault is not None
    assert fault[0] is Status.CALIBRATION_DRIFT
    assert f"{name} sits elsewhere" in fault[1]
    assert State.READY not in bench.read().state
    bench.measuring.show(taught.sight)
    assert bench.ask().answer.status is Status.OK


def test_an_object_that_was_lifted_off_its_turntable_is_not_served(
    bench: Bench, taught: Taught
) -> None:
    sight = taught.sight
    assert sight.tag_b is not None
    X = taught.calibration.base_from_camera
    lift = X.inverse() @ Pose.from_rotvec((0, 0, 0), (0, 0, 3.0)) @ X
    lifted = replace(sight.tag_b, camera_from_tag=lift @ sight.tag_b.camera_from_tag)
    bench.measuring.show(replace(sight, tag_b=lifted))
    answer = bench.ask().answer
    assert answer.status is Status.CALIBRATION_DRIFT
    assert answer.detail & 8


def test_a_movable_camera_answers_only_where_tag_a_tells_where_it_stands(
    movable: Bench, taught: Taught
) -> None:
    movable.measuring.sight = replace(taught.sight, tag_a=None)
    assert movable.ask().answer.status is Status.TAG_A_NOT_FOUND
    moving = replace(taught.sight, base_from_wrist=None, unpaired=NotSteady("the arm moves"))
    movable.measuring.sight = moving
    assert movable.ask().answer.status is Status.ROBOT_MOVING
    movable.measuring.sight = taught.sight
    assert movable.ask().answer.status is Status.OK


def test_a_fixed_camera_answers_without_tag_a_and_is_less_sure(
    bench: Bench, taught: Taught
) -> None:
    sure = bench.ask().answer
    bench.serving.cameras = CameraMemory(STABILITY)
    bench.measuring.sight = replace(taught.sight, tag_a=None)
    unsure = bench.ask().answer
    assert (sure.status, unsure.status) == (Status.OK, Status.OK)
    assert unsure.u95_um >= sure.u95_um


def test_what_tag_a_told_fades_to_the_stability_and_stays(taught: Taught) -> None:
    memory = CameraMemory(STABILITY)
    bare = replace(taught.sight, tag_a=None)
    assert memory.place(bare).flange_tag is None
    memory.see(taught.sight)
    told = memory.place(taught.sight).flange_tag
    assert told is not None
    for age_s in (0.0, MEMORY_S / 2, MEMORY_S, 100 * MEMORY_S):
        place = memory.place(at(bare, taught.sight.stamp_s + age_s))
        assert place.flange_tag is not None
        spread = np.diag(place.flange_tag.tag.covariance - told.tag.covariance)
        # The earlier picture and the place while teaching, together.
        with np.errstate(divide="ignore"):
            together = 1 / (1 / spread + 1 / place.stability**2)
        share = min(age_s / MEMORY_S, 1.0)
        np.testing.assert_allclose(
            together, (share * STABILITY) ** 2 * 2 * (1 + share) / (2 * share**2 + 1 + share)
        )
    memory.see(bare)
    assert memory.place(bare).flange_tag is not None  # a picture without tag A takes nothing away


def test_a_knock_is_not_forgotten_while_tag_a_is_hidden(bench: Bench, taught: Taught) -> None:
    """Not even on an object that may lie anywhere, of which tag B says nothing about the camera."""
    before = bench.ask().answer
    bench.measuring.show(at(knocked(taught.sight), bench.clock.monotonic()))
    bench.clock.sleep(3600.0)
    late = at(replace(knocked(taught.sight), tag_a=None), bench.clock.monotonic())
    place = bench.serving.cameras.place(late)
    facts = taught.calibration.facts
    free = replace(
        taught.calibration,
        facts=replace(facts, object=replace(facts.object, motion=Motion.FREE)),
    )
    assert late.tag_b is not None
    expected = expected_coordinate(free, "P1", late.tag_b, Policy.FIXED, camera=place)
    miss_mm = np.linalg.norm(expected.base_from_wrist.translation - place_mm(before))
    assert miss_mm < expected.u95_mm
    blind = expected_coordinate(free, "P1", late.tag_b, Policy.FIXED)
    assert np.linalg.norm(blind.base_from_wrist.translation - place_mm(before)) > 2.0


def test_a_movable_camera_remembers_nothing(taught: Taught) -> None:
    memory = CameraMemory(MOVABLE)
    memory.see(taught.sight)
    assert memory.place(replace(taught.sight, tag_a=None)).flange_tag is None
