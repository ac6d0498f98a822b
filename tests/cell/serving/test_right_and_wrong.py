"""Where answers may send the arm: right ones pass at any angle of the table, wrong ones are told by name."""

from collections.abc import Callable

import numpy as np
import pytest

from fakes.world.poses import WORK_ROTATION, retracted_pose
from tests.cell.serving.room import CAMERA, MARGIN_MM, Room
from tests.invariant.simulation.teaching import VISION, calibration_by
from vgrd.calibration.calibration import expected_coordinate
from vgrd.cell.serving.limits import excess_of
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import (
    CameraPlace,
    CellBounds,
    FlangeTag,
    Motion,
    Plan,
    Policy,
)
from vgrd.registers import Status
from vgrd.registers.limits import LIMIT_STATUS, LimitCode

ANSWERS = 360  # of each policy: a turn of the table by degrees


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


def leaning(rng: np.random.Generator, most_deg: float) -> Array:
    axis = rng.standard_normal(3)
    axis *= np.radians(rng.uniform(0, most_deg)) / np.linalg.norm(axis)
    return np.asarray(exp_rotation(axis) @ WORK_ROTATION)


@pytest.mark.parametrize("policy", list(Policy))
@pytest.mark.parametrize(
    ("motion", "count"), [(Motion.TURNTABLE, ANSWERS), (Motion.PLANAR, 60), (Motion.FREE, 60)]
)
def test_no_right_answer_is_refused_at_any_angle(
    motion: Motion, count: int, policy: Policy
) -> None:
    _refuse_nothing(Room(motion), policy, count)


@pytest.mark.parametrize(
    "stability", [CAMERA.stability, np.full(6, np.inf)], ids=["fixed", "movable"]
)
def test_no_right_answer_is_refused_by_a_camera_that_was_moved(
    room: Room, stability: Array
) -> None:
    """Tag A tells where it stands now."""
    layout = room.plant.layout
    flange, unheeded = retracted_pose(), 0
    tag_a_in_base = room.plant.arm.true_at(flange) @ layout.wrist_from_tag_a
    for i in range(24):
        moved = Pose.from_rotvec(room.rng.normal(0, 0.02, 3), room.rng.normal(0, 15.0, 3))
        camera_from_base = (layout.base_from_camera @ moved).inverse()
        base_from_object = room.object_at(2 * np.pi * i / 24)
        tag_b_in_base = base_from_object @ layout.object_from_tag_b
        tag_a, tag_b = (
            VISION.observe(room.rng, spec, camera_from_base @ there)
            for spec, there in ((layout.tag_a, tag_a_in_base), (layout.tag_b, tag_b_in_base))
        )
        camera = CameraPlace(stability, FlangeTag(tag_a, flange))
        answer = expected_coordinate(room.calibration, "P1", tag_b, Policy.FIXED, None, camera)
        pose, taught_from_camera = answer.base_from_wrist, answer.taught_from_camera
        truth = base_from_object @ layout.targets["P1"].cad
        assert np.linalg.norm(room.plant.tip(pose) - truth) < 2.0
        assert (
            room.excess(pose, tag_b, Policy.FIXED, taught_from_camera=taught_from_camera) is None
        )
        unheeded += room.excess(pose, tag_b, Policy.FIXED) is not None
    assert unheeded > 12


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("plan", [Plan.UNIVERSAL, Plan.SPECIAL])
def test_no_right_answer_of_the_plans_of_the_paper_is_refused(plan: Plan, policy: Policy) -> None:
    _refuse_nothing(Room(calibration=calibration_by(plan)), policy, 60)


@pytest.mark.parametrize("plan", [Plan.UNIVERSAL, Plan.SPECIAL])
def test_plans_of_the_paper_keep_the_distance_from_the_centre(plan: Plan) -> None:
    room, angle = Room(calibration=calibration_by(plan)), 1.0
    pose = room.expected("P1", room.tag(room.object_at(angle)), Policy.FIXED).base_from_wrist
    outwards = exp_rotation((0, 0, angle)) @ room.plant.layout.targets["P1"].cad
    outwards = outwards / np.linalg.norm(outwards)
    for sign in (1, -1):
        moved = Pose(pose.rotation, pose.translation + sign * 1.2 * MARGIN_MM * outwards)
        excess = excess_of(room.calibration, "P1", moved, Policy.FIXED, CellBounds())
        assert excess is not None
        assert excess.code is LimitCode.PLACE_RADIUS


def _refuse_nothing(room: Room, policy: Policy, count: int) -> None:
    for i in range(count):
        target, base_from_object = f"P{i % 6 + 1}", room.object_at(2 * np.pi * i / count)
        tag = room.tag(base_from_object)
        # An orientation counts as it was taught where nothing tells how the object lies: leave it room.
        work = leaning(room.rng, 45.0) if policy is Policy.REQUESTED else None
        answer = room.expected(target, tag, policy, work)
        pose, moved = answer.base_from_wrist, answer.taught_from_camera
        truth = base_from_object @ room.plant.layout.targets[target].cad
        assert np.linalg.norm(room.plant.tip(pose) - truth) < 1.5
        excess = room.excess(pose, tag, policy, target, taught_from_camera=moved)
        assert excess is None, excess


def exchanged(i: int, j: int) -> Callable[[Pose], Pose]:
    order = [0, 1, 2]
    order[i], order[j] = j, i
    return lambda pose: Pose(pose.rotation, pose.translation[order])


def negated(i: int) -> Callable[[Pose], Pose]:
    signs = np.ones(3)
    signs[i] = -1
    return lambda pose: Pose(pose.rotation, signs * pose.translation)


WRONG: dict[str, Callable[[Pose], Pose]] = {
    "x and y exchanged": exchanged(0, 1),
    "y and z exchanged": exchanged(1, 2),
    "x and z exchanged": exchanged(0, 2),
    "x negative": negated(0),
    "y negative": negated(1),
    "z negative": negated(2),
    "metres": lambda pose: Pose(pose.rotation, pose.translation / 1000),
    "inverse": lambda pose: pose.inverse(),
    "RX and RZ exchanged": lambda pose: Pose.from_rotvec(
        pose.rotvec()[[2, 1, 0]], pose.translation
    ),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_wrong_answer_is_refused_wherever_it_is_off_by_more_than_the_margin(
    room: Room, mistake: str
) -> None:
    judged = 0
    for angle in np.arange(0.05, 2 * np.pi, 0.2):
        base_from_object = room.object_at(float(angle))
        tag = room.tag(base_from_object)
        right = room.expected("P2", tag, Policy.FIXED).base_from_wrist
        wrong = WRONG[mistake](right)
        truth = base_from_object @ room.plant.layout.targets["P2"].cad
        if np.linalg.norm(room.plant.tip(wrong) - truth) > MARGIN_MM + 1.0:
            judged += 1
            excess = room.excess(wrong, tag, Policy.FIXED, "P2")
            assert excess is not None
            assert LIMIT_STATUS[excess.code] is Status.OUTSIDE_CALIBRATED_VOLUME
    assert judged > 20


def test_a_turn_with_the_wrong_sign_is_told_by_the_tag_alone(room: Room) -> None:
    """It is on its circle, at its height, and upright: everything else finds it right."""
    angle = 0.8
    tag, mirrored = room.tag(room.object_at(angle)), room.tag(room.object_at(-angle))
    wrong = room.expected("P1", mirrored, Policy.FIXED).base_from_wrist
    assert room.excess(wrong, mirrored, Policy.FIXED) is None
    excess = room.excess(wrong, tag, Policy.FIXED)
    assert excess is not None
    assert excess.code is LimitCode.PLACE_IN_TAG


@pytest.mark.parametrize("policy", list(Policy))
def test_the_coordinate_of_another_target_is_told_by_the_tag(room: Room, policy: Policy) -> None:
    tag = room.tag(room.object_at(2.0))
    work = WORK_ROTATION if policy is Policy.REQUESTED else None
    excess = room.excess(room.expected("P2", tag, policy, work).base_from_wrist, tag, policy, "P1")
    assert excess is not None
    assert excess.code is LimitCode.PLACE_IN_TAG
