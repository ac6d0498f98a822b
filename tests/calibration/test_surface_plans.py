"""Plans plane and sphere: the conventional method with another contact of figure 3."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fakes.studies.sessions import Session
from fakes.world.noise import Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.checks import examine, missing_motion
from vgrd.calibration.joint import calibrate_joint
from vgrd.calibration.planning import advise_session
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.model import Plan, Policy

PERFECT = Vision(1e-6, 1e-6, 1e-7, 1e-7)
TURNED = WORK_ROTATION @ Rotation.from_euler("xyz", [0.2, -0.1, 0.7]).as_matrix()
SURFACES = [Plan.PLANE, Plan.SPHERE]
WORDS = {Plan.PLANE: "of the plane", Plan.SPHERE: "of the ball"}


def session(cell, plan, points=16):
    return Session(plan, points=points, looks=8).record(cell)


@pytest.mark.parametrize("plan", SURFACES)
def test_the_true_coordinate_is_served_at_any_orientation(plan):
    world = Simulation(4, vision=PERFECT, touch_sigma_mm=0.0)
    calibration = calibrate_system(session(world, plan))
    assert calibration.verdict.ok
    np.testing.assert_allclose(calibration.tcp.in_wrist, world.tcp_in_wrist, atol=2e-3)
    for policy, R_work in [(Policy.FIXED, None), (Policy.REQUESTED, TURNED)]:
        request = world.request()
        served = expected_coordinate(
            calibration, request.target, request.seen.tag_b, policy, R_work
        ).base_from_wrist
        truth = world.flange(request.target, request.angle_rad, served.rotation)
        np.testing.assert_allclose(served.translation, truth, atol=5e-3)


@pytest.mark.parametrize("plan", SURFACES)
def test_the_stated_radius_holds(plan):
    inside = []
    for seed in range(15):
        world = Simulation(seed)
        calibration = calibrate_system(session(world, plan))
        request = world.request()
        served = expected_coordinate(calibration, request.target, request.seen.tag_b, Policy.FIXED)
        miss = world.miss(request, served.base_from_wrist)
        inside.append(np.linalg.norm(miss) <= served.u95_mm)
    assert np.mean(inside) >= 0.8


@pytest.mark.parametrize("plan", SURFACES)
def test_an_arm_that_turns_about_one_axis_is_refused_with_the_plans_that_serve_it(plan):
    recording = session(Simulation(1, one_axis=True), plan)
    with pytest.raises(NotObservable, match=r"one axis only.*4 axes, is taught by plan joint or"):
        calibrate_system(recording)
    fatal = [remark for remark in examine(recording) if remark.fatal]
    assert [remark.code for remark in fatal] == ["surface_motion"]
    assert "plan joint or conventional" in fatal[0].message


@pytest.mark.parametrize("plan", SURFACES)
def test_a_session_asks_for_touches_until_there_are_enough(plan):
    recording = session(Simulation(2), plan)
    assert missing_motion(recording) is None
    begun = replace(recording, points=recording.points[:3])
    missing = missing_motion(begun)
    assert missing.code == "surface_motion"
    assert f"3 touches {WORDS[plan]}" in missing.sentence
    assert missing.rank < missing.unknowns
    with pytest.raises(TooFewObservations):
        calibrate_system(begun)
    still = replace(recording, points=recording.points[:1] * 9)
    assert "kept its orientation" in missing_motion(still).sentence


@pytest.mark.parametrize("plan", SURFACES)
def test_advice_tells_what_is_missing_and_foresees_nothing(plan):
    recording = session(Simulation(3), plan)
    begun = replace(recording, points=recording.points[:2])
    assert f"2 touches {WORDS[plan]}" in advise_session(begun).trouble
    advice = advise_session(recording)
    assert "nothing is missing" in advice.trouble
    assert not advice.predicted_mm


@pytest.mark.parametrize("plan", SURFACES)
def test_the_joint_estimate_takes_no_surface_for_a_fixed_point(plan):
    recording = session(Simulation(5), plan)
    with_points, without = (
        calibrate_joint(one) for one in (recording, replace(recording, points=()))
    )
    assert with_points.noise_scale == without.noise_scale


@pytest.mark.parametrize("plan", [Plan.CONVENTIONAL, *SURFACES])
def test_a_touch_beside_the_object_that_slipped_is_named_and_refuses(plan):
    world = Simulation(6)
    recording = session(world, plan)
    slipped = recording.points[4]
    pose = slipped.base_from_wrist
    off = np.array([0, 0, 1.0])
    if plan is Plan.SPHERE:
        off = pose @ world.tcp_in_wrist - world.fixed_point_in_base  # out of the ball
    away = Pose(pose.rotation, pose.translation + 8 * off / np.linalg.norm(off))
    points = list(recording.points)
    points[4] = replace(slipped, base_from_wrist=away)
    verdict = calibrate_system(replace(recording, points=tuple(points))).verdict
    assert calibrate_system(recording).verdict.ok
    assert not verdict.ok
    (named,) = [remark for remark in verdict.findings if remark.code == "point_outlier"]
    assert f"point 5 ({slipped.target}) does not belong to the others" in named.message
