"""Both tags in one picture: the answer follows a camera that moved, and names what else moved."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE, Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.marginal import solution_of
from vgrd.calibration.joint.state import StepLayout
from vgrd.errors import TagNotSeen
from vgrd.geometry import Pose
from vgrd.model import (
    UNMOVED,
    ArmModel,
    CameraPlace,
    FlangeTag,
    Link,
    Policy,
    frozen_array,
    frozen_copy,
)

PERFECT = Vision(1e-6, 1e-6, 1e-7, 1e-7)
FIELD = ArmErrors(sigma_mm=0.03, field_mm=0.15)
FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
ANYWHERE = frozen_array([np.inf] * 6, 6)
TILT = np.radians(25)


def mixed(sim):
    return [sim.wrist()] * 6 + [sim.wrist(TILT) for _ in range(4)]


def solved(sim, arm):
    recording = sim.record(wrists=mixed(sim))
    return solution_of(calibrate_joint(recording, arm=arm)), recording.facts


@cache
def perfect():
    sim = Simulation(1, vision=PERFECT, touch_sigma_mm=0.0)
    return sim, *solved(sim, ArmModel())


@cache
def real(seed=3):
    sim = Simulation(seed, vision=FINE, arm=FIELD, center_sigma_mm=0.02)
    arm = ArmModel(FIELD.sigma_mm, FIELD.field_mm, FIELD.length_mm, FIELD.rad_per_mm)
    return sim, *solved(sim, arm)


def seen_after(sim, camera=None, tag_a=None, tag_b=None):
    """A request, with the links named shifted by a pose in their own frame."""
    cell = Simulation
    sim.base_from_camera = cell.base_from_camera @ (camera or Pose.identity())
    sim.wrist_from_tag_a = cell.wrist_from_tag_a @ (tag_a or Pose.identity())
    sim.object_from_tag_b = cell.object_from_tag_b @ (tag_b or Pose.identity())
    try:
        return sim.request()
    finally:
        sim.base_from_camera = cell.base_from_camera
        sim.wrist_from_tag_a = cell.wrist_from_tag_a
        sim.object_from_tag_b = cell.object_from_tag_b


def flange_tag(request):
    return FlangeTag(request.seen.tag_a, request.seen.base_from_wrist)


def asked(solution, facts, request, place, policy=Policy.FIXED):
    target = facts.object.targets[request.target]
    return solution.expected_for(facts, target, request.seen.tag_b, policy, WORK_ROTATION, place)


shifts = st.builds(
    lambda r, t: Pose.from_rotvec(r, t),
    st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    st.tuples(*[st.floats(-200, 200)] * 3),
)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(shifts, st.sampled_from([Policy.FIXED, Policy.FOLLOW]))
def test_the_answer_is_true_wherever_the_camera_stands(shift, policy) -> None:
    """The paper's chain (Eq. 5, 6): a camera on a tripod that is put anywhere between two pictures."""
    sim, solution, facts = perfect()
    request = seen_after(sim, camera=shift)
    expected = asked(solution, facts, request, CameraPlace(ANYWHERE, flange_tag(request)), policy)
    assert expected.fits
    if policy is Policy.FIXED:
        assert np.linalg.norm(sim.miss(request, expected.base_from_wrist)) < 1e-3
    else:
        tip = expected.base_from_wrist @ sim.tcp_in_wrist
        assert np.linalg.norm(tip - sim.point(request.target, request.angle_rad)) < 1e-3


@settings(max_examples=20, deadline=None, derandomize=True)
@given(shifts)
def test_a_movable_camera_leaves_no_trace_of_where_it_stood_while_teaching(shift) -> None:
    """Another frame for the taught camera is another name for the same estimate, noise and all."""
    sim, solution, facts = real()
    request = seen_after(sim)
    renamed, G = shift.inverse() @ solution.camera_from_tag_b, shift.inverse().adjoint()
    T = np.eye(solution.layout.size)
    T[StepLayout.TAG_B, StepLayout.TAG_B] = G
    other = replace(
        solution,
        base_from_camera=solution.base_from_camera @ shift,
        camera_from_tag_b=renamed,
        camera_from_axis=shift.inverse() @ solution.camera_from_axis,
        covariance=frozen_copy(T @ solution.covariance @ T.T),
        undetermined=frozen_copy(T @ solution.undetermined),
        arm=replace(
            solution.arm, J_unknowns=frozen_copy(solution.arm.J_unknowns @ np.linalg.inv(T))
        ),
    )
    place = CameraPlace(ANYWHERE, flange_tag(request))
    one, two = (asked(each, facts, request, place) for each in (solution, other))
    np.testing.assert_allclose(
        one.base_from_wrist.translation, two.base_from_wrist.translation, atol=1e-5
    )
    assert one.u95_mm == pytest.approx(two.u95_mm, rel=1e-6)


@pytest.mark.parametrize("moved_mm", [0.3, 1.0, 5.0, 50.0])
def test_a_fixed_camera_that_was_knocked_is_followed_where_tag_a_is_seen(moved_mm) -> None:
    sim, solution, facts = real()
    rng = np.random.default_rng(7)
    shares = []
    for _ in range(25):
        shift, turn = rng.normal(size=(2, 3))
        tangent = [*(shift / np.linalg.norm(shift)), *(1e-3 * turn / np.linalg.norm(turn))]
        request = seen_after(sim, camera=Pose.exp(moved_mm * np.array(tangent)))
        expected = asked(solution, facts, request, CameraPlace(FIXED, flange_tag(request)))
        miss = sim.miss(request, expected.base_from_wrist)
        assert expected.fits
        shares.append(miss @ np.linalg.solve(expected.position_covariance, miss))
    assert np.mean(shares) < 3 * 2.5  # one session's errors are common to all its requests


def test_without_tag_a_a_movable_camera_is_refused_and_a_fixed_one_says_how_sure_it_is() -> None:
    sim, solution, facts = real()
    request = seen_after(sim)
    with pytest.raises(TagNotSeen, match="bring tag A into view"):
        asked(solution, facts, request, CameraPlace(ANYWHERE))
    free = replace(facts, object=replace(facts.object))
    exact, fixed, loose = (
        asked(solution, free, request, place).u95_mm
        for place in (UNMOVED, CameraPlace(FIXED), CameraPlace(frozen_copy(20 * FIXED)))
    )
    assert exact < fixed < loose


def test_a_stability_so_small_that_nothing_can_move_is_that_of_a_camera_that_stands() -> None:
    sim, solution, facts = real()
    request = seen_after(sim)
    exact = asked(solution, facts, request, UNMOVED)
    still = asked(solution, facts, request, CameraPlace(frozen_copy(1e-6 * FIXED)))
    np.testing.assert_allclose(
        exact.base_from_wrist.translation, still.base_from_wrist.translation, atol=1e-4
    )
    np.testing.assert_allclose(exact.position_covariance, still.position_covariance, rtol=1e-4)


def test_a_radius_holds_more_where_no_tag_a_checks_the_camera() -> None:
    sim, solution, facts = real()
    request = seen_after(sim)
    seen = CameraPlace(FIXED, flange_tag(request))
    told = asked(solution, facts, request, seen)
    recalled = asked(solution, facts, request, replace(seen, is_recalled=True))
    np.testing.assert_array_equal(told.position_covariance, recalled.position_covariance)
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(3), told.position_covariance, 40_000
    )
    misses = np.linalg.norm(draws, axis=1)
    assert np.mean(misses <= told.u95_mm) == pytest.approx(0.95, abs=0.005)
    assert np.mean(misses <= recalled.u95_mm) == pytest.approx(0.995, abs=0.002)


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
def test_the_covariance_of_an_answer_is_its_scatter_over_the_pictures(stability) -> None:
    """The picture's own share: noise of both tags, drawn again around one true picture."""
    sim, solution, facts = real()
    truth = seen_after(sim)
    target = facts.object.targets[truth.target]
    rng = np.random.default_rng(11)

    def drawn(tag):
        noise = np.linalg.cholesky(tag.covariance) @ rng.normal(size=6)
        return replace(tag, camera_from_tag=Pose.exp(noise) @ tag.camera_from_tag)

    answers = []
    for _ in range(300):
        place = CameraPlace(
            stability, FlangeTag(drawn(truth.seen.tag_a), truth.seen.base_from_wrist)
        )
        tag_b = drawn(truth.seen.tag_b)
        prediction = solution.predict(facts, target, tag_b, Policy.FIXED, WORK_ROTATION, place)
        answers.append(prediction.base_from_wrist.translation)
    of_tag_a = prediction.J_camera[:, :6]
    share = (
        prediction.J_picture @ truth.seen.tag_b.covariance @ prediction.J_picture.T
        + of_tag_a @ of_tag_a.T
    )
    scatter = np.cov(np.array(answers).T)
    ratios = np.linalg.eigvals(np.linalg.solve(share, scatter)).real
    assert (ratios > 0.6).all()
    assert (ratios < 1.6).all()  # 300 draws: three sigma of a variance are 25 %


SLIP = Pose.from_rotvec((0.004, -0.003, 0.002), (2.0, -1.5, 1.8))


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
@pytest.mark.parametrize("link", [Link.TAG_A, Link.TAG_B, Link.CAMERA])
def test_the_link_that_moved_is_among_those_that_are_named(link, stability) -> None:
    sim, solution, facts = real()
    slips = {link.name.lower(): SLIP}
    request = seen_after(sim, **slips)
    report = solution.examine(
        facts, request.seen.tag_b, CameraPlace(stability, flange_tag(request))
    )
    if link is Link.CAMERA:
        assert report.fits
        assert report.taught_from_camera.distance(SLIP)[0] < 1.0
        return
    assert not report.fits
    assert link in report.suspects
    mm, _ = report.slips[link]
    assert mm == pytest.approx(np.linalg.norm(SLIP.translation), rel=0.4)
    if stability is FIXED:  # the stability tells a tag on the flange from one on the object
        others = {Link.TAG_B, Link.OBJECT} if link is Link.TAG_B else {Link.TAG_A}
        assert set(report.suspects) == others


def test_a_camera_that_moved_far_while_tag_a_is_hidden_is_one_of_three_explanations() -> None:
    sim, solution, facts = real()
    knocked = Pose.from_rotvec((0.02, 0.01, 0.0), (8.0, 5.0, 0.0))
    request = seen_after(sim, camera=knocked)
    report = solution.examine(facts, request.seen.tag_b, CameraPlace(FIXED))
    assert not report.fits
    assert Link.CAMERA in report.suspects


def test_pictures_of_a_good_cell_contradict_nothing() -> None:
    sim, solution, facts = real()
    for _ in range(50):
        request = seen_after(sim)
        for place in (UNMOVED, CameraPlace(FIXED, flange_tag(request)), CameraPlace(FIXED)):
            assert solution.examine(facts, request.seen.tag_b, place).fits


@pytest.mark.parametrize("link", [Link.TAG_A, Link.TAG_B])
def test_a_tag_that_slips_after_the_camera_was_knocked_is_among_those_that_are_named(link) -> None:
    sim, solution, facts = real()
    knocked = Pose.from_rotvec((0.003, -0.004, 0.001), (3.0, -4.0, 1.0))
    request = seen_after(sim, camera=knocked, **{link.name.lower(): SLIP})
    report = solution.examine(facts, request.seen.tag_b, CameraPlace(FIXED, flange_tag(request)))
    assert not report.fits
    assert link in report.suspects


def test_a_good_cell_misfits_as_much_as_its_degrees_of_freedom():
    misfits = []
    for seed in range(40):
        sim, solution, facts = real(seed)
        request = sim.request()
        place = CameraPlace(ANYWHERE, flange_tag(request))
        misfits.append(solution.examine(facts, request.seen.tag_b, place).misfit)
    spread = np.sqrt(2 * 5 / len(misfits))  # of a mean of chi squares of 5 degrees of freedom
    assert abs(np.mean(misfits) - 5) < 3 * spread
