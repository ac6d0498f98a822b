"""The calibration that the daemon serves: the joint estimate, stored, asked and judged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.joint.state import StepLayout
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError, NotObservable
from vgrd.geometry import exp_rotation
from vgrd.model import ArmKnowledge, ArmModel, Plan, Policy
from vgrd.store.calibrations import CalibrationStore


def world(seed=3, **options):
    return Simulation(np.random.default_rng(seed), **options)


def recorded(sim, wrists=None, **options):
    return replace(sim.record(wrists=wrists, **options), plan=Plan.JOINT)


def tilted(sim, count=6):
    return [exp_rotation(sim.rng.normal(0, 0.25, 3)) @ WORK_ROTATION for _ in range(count)]


def codes(calibration):
    return {finding.code for finding in calibration.verdict.findings}


@pytest.mark.parametrize("policy", list(Policy))
def test_a_stored_calibration_answers_as_the_session_itself(tmp_path: Path, policy) -> None:
    sim = world()
    recording = recorded(sim, tilted(sim))
    store = CalibrationStore(tmp_path)
    calibration = store.load(store.save(calibrate_system(recording)))
    assert calibration.method == "joint"
    result = calibrate_joint(recording)
    work = exp_rotation(np.array([0.1, -0.2, 0.4])) @ WORK_ROTATION
    for _ in range(4):
        request = sim.request()
        seen = request.seen.tag_b
        own = expected_by_joint(result, request.target, seen, policy, work)
        kept = expected_coordinate(calibration, request.target, seen, policy, work)
        np.testing.assert_allclose(
            kept.base_from_wrist.matrix(), own.base_from_wrist.matrix(), atol=1e-9
        )
        np.testing.assert_allclose(kept.position_covariance, own.position_covariance, rtol=1e-6)
        assert kept.u95_rad == pytest.approx(own.u95_rad, rel=1e-6)


def test_the_joint_estimate_tells_less_uncertainty_than_the_steps_and_is_right() -> None:
    inside, narrower = [], []
    for seed in range(12):
        sim = world(seed)
        recording = recorded(sim, tilted(sim))
        jointly = calibrate_system(recording)
        in_steps = calibrate_system(replace(recording, plan=Plan.UNIVERSAL))
        request = sim.request()
        ask = (request.target, request.seen.tag_b, Policy.FIXED)
        expected = expected_coordinate(jointly, *ask)
        narrower.append(expected.u95_mm / expected_coordinate(in_steps, *ask).u95_mm)
        miss = np.linalg.norm(sim.miss(request, expected.base_from_wrist))
        inside.append(miss <= expected.u95_mm)
    assert np.median(narrower) < 1
    assert np.mean(inside) >= 0.75


def test_a_constant_wrist_is_served_and_its_open_tcp_told() -> None:
    sim = world()
    calibration = calibrate_system(recorded(sim))
    assert calibration.verdict.ok, calibration.verdict
    assert calibration.tcp_in_wrist is None
    assert "tcp_open" in codes(calibration)
    seen = sim.request().seen.tag_b
    expected_coordinate(calibration, "P1", seen, Policy.FIXED)
    turned = exp_rotation(np.array([0.5, 0, 0])) @ WORK_ROTATION
    with pytest.raises(NotObservable, match="TCP"):
        expected_coordinate(calibration, "P1", seen, Policy.REQUESTED, turned)


def test_a_four_axis_robot_is_served_although_its_tcp_is_open_along_its_axis() -> None:
    sim = world(one_axis=True)
    about_z = [
        exp_rotation(np.array([0, 0, a])) @ WORK_ROTATION for a in (0, 0.8, -0.8, 1.6, 0, 2)
    ]
    recording = recorded(sim, about_z)
    calibration = calibrate_system(recording)
    assert calibration.tcp_in_wrist is None
    turned = exp_rotation(np.array([0, 0, 0.4])) @ WORK_ROTATION
    for _ in range(4):
        request = sim.request()
        seen = request.seen.tag_b
        expected = expected_coordinate(calibration, request.target, seen, Policy.REQUESTED, turned)
        assert expected.u95_mm < 1.0


def test_a_tolerance_that_is_not_met_rejects_the_calibration() -> None:
    sim = world()
    recording = recorded(sim, tilted(sim))
    predicted = calibrate_system(recording).residuals["predicted_u95_mm"]
    assert calibrate_system(recording, 1.3 * predicted).verdict.ok
    rejected = calibrate_system(recording, 0.5 * predicted)
    assert not rejected.verdict.ok
    assert "misses_tolerance" in codes(rejected)


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_a_bad_touch_is_named_and_left_out() -> None:
    sim = world()
    recording = recorded(sim, tilted(sim, 8))
    touch = recording.touches[3]
    pose = touch.base_from_wrist
    moved = replace(pose, translation=pose.translation + np.array([2.5, 0, 0]))
    touches = list(recording.touches)
    touches[3] = replace(touch, base_from_wrist=moved)
    calibration = calibrate_system(replace(recording, touches=tuple(touches)))
    (finding,) = [f for f in calibration.verdict.findings if f.code == "touch_outlier"]
    assert "touch 4" in finding.message
    assert calibration.verdict.ok


def test_an_unknown_target_and_a_missing_orientation_are_refused() -> None:
    sim = world()
    calibration = calibrate_system(recorded(sim, tilted(sim)))
    seen = sim.request().seen.tag_b
    with pytest.raises(InputError, match="'P9' was not taught"):
        expected_coordinate(calibration, "P9", seen, Policy.FIXED)
    with pytest.raises(InputError, match="needs the orientation"):
        expected_coordinate(calibration, "P1", seen, Policy.REQUESTED)


def test_steps_of_the_robot_widen_what_is_stated_but_not_where_it_is_sent() -> None:
    """An arm that is exact but for its steps: at the answer nobody reads a pose, so none is rounded."""
    told = ArmKnowledge(
        ArmModel(quantum_mm=0.6, quantum_rad=0.006),
        *(np.zeros(n) for n in ((0, 3), 0, (0, 1), (0, 0))),
    )
    read, sent = np.array([400.0, 0.0, 200.0]), np.array([450.0, 50.0, 250.0])
    covariance = told.deviations(np.array([read, sent]), sent=1)[2]
    of_rounding = np.array([0.6] * 3 + [0.006] * 3) ** 2 / 12  # uniform over a step
    np.testing.assert_allclose(np.diag(covariance)[:6], of_rounding, rtol=1e-12)
    np.testing.assert_allclose(covariance[6:], 0.0, atol=1e-15)

    sim = world()
    recording = recorded(sim, tilted(sim))
    coarse = replace(recording, facts=replace(recording.facts, robot_step_mm=1.0))
    part = StepLayout.TCP
    wide, narrow = (
        np.trace(calibrate_joint(one, find_noise=False).covariance[part, part])
        for one in (coarse, recording)
    )
    assert wide > 1.1**2 * narrow
