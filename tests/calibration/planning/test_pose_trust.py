"""What is held against the pose of one proposed sample."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import COARSE
from fakes.world.simulation import Simulation
from vgrd.calibration.checks.misinterpreted_points import rival_names
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.fit import JointFit
from vgrd.calibration.planning.pose_trust import MARGIN_MM, place_u95_mm, reason_against
from vgrd.calibration.planning.reach import Looking, Reach, Spinning, Touching, flange_of
from vgrd.geometry import Pose, exp_rotation
from vgrd.geometry.covariance import radius95

TILT = np.radians(20)


@pytest.fixture(scope="module")
def result() -> JointFit:
    sim = Simulation(1, vision=COARSE)
    wrists = [sim.wrist()] * 3 + [sim.wrist(TILT) for _ in range(4)]
    return calibrate_joint(sim.record(looks=4, spins=3, wrists=wrists))


def test_the_uncertainty_of_a_place_is_what_steps_of_the_estimate_do_to_it(result):
    touching = Touching("P4", result.recording.touches[4].base_from_wrist.rotation)
    by, n = [], result.layout.size
    for step in np.eye(n) * 1e-4:
        ends = [flange_of(_at(result, sign * step), touching).translation for sign in (1, -1)]
        by.append((ends[0] - ends[1]) / 2e-4)
    J = np.array(by).T
    assert place_u95_mm(result, touching) == pytest.approx(radius95(J @ result.covariance @ J.T))


def _at(result, step):
    return replace(result, state=result.state.retract(step, result.layout))


def test_a_place_that_the_samples_leave_open_is_no_pose():
    sim = Simulation(1, vision=COARSE)
    upright = calibrate_joint(sim.record(looks=4, spins=3))
    straight = upright.recording.touches[0].base_from_wrist.rotation
    tilted = Touching("P1", straight @ exp_rotation((0.4, 0, 0)))
    assert place_u95_mm(upright, Touching("P1", straight)) < 1
    assert place_u95_mm(upright, tilted) > 100
    assert "jog there by eye" in reason_against(upright, tilted, Reach())
    assert reason_against(upright, Touching("P1", straight), Reach()) == ""


def test_a_place_that_is_no_number_is_no_pose(result):
    broken = replace(result, covariance=result.covariance * np.nan)
    straight = result.recording.touches[0].base_from_wrist.rotation
    assert reason_against(broken, Touching("P1", straight), Reach()) != ""


def test_a_look_is_named_within_a_margin_of_where_the_arm_stood(result):
    stood = [look.base_from_wrist for look in result.recording.looks]
    stood += [touch.base_from_wrist for touch in result.recording.touches]
    highest = max(stood, key=lambda pose: pose.translation[2])
    for beyond_mm, named in ((0.0, True), (MARGIN_MM - 1, True), (MARGIN_MM + 1, False)):
        place = highest.translation + np.array([0, 0, beyond_mm])
        look = Looking(Pose(highest.rotation, place))
        assert (reason_against(result, look, Reach()) == "") is named


def test_a_wrist_is_named_within_the_tilt_from_one_that_was_reached(result):
    look = result.recording.looks[0].base_from_wrist
    far = Looking(Pose(look.rotation @ exp_rotation((1.8, 0, 0)), look.translation))
    assert "turn it by eye" in reason_against(result, far, Reach())
    assert reason_against(result, Looking(look), Reach(max_tilt_rad=0.0, max_yaw_rad=0.0)) == ""


def test_a_turn_of_the_object_has_no_pose_to_be_wrong(result):
    assert reason_against(result, Spinning(1.0), Reach()) == ""


def test_four_axes_have_touches_that_show_wrong_names():
    sim = Simulation(4, one_axis=True)
    assert (
        rival_names(sim.record(looks=0, spins=0, wrists=[sim.wrist(1.5) for _ in range(6)])) == ""
    )


def test_one_name_that_the_touches_would_not_show_is_named():
    sim = Simulation(6, vision=COARSE)
    fits = sim.record(looks=0, spins=0, names=["P1", "P2", "P4", "P5"], wrists=[sim.wrist()] * 4)
    assert rival_names(fits) == ""
    three = sim.record(looks=0, spins=0, names=["P1", "P2", "P4"], wrists=[sim.wrist()] * 3)
    assert "touch 4 or more" in rival_names(three)
    twice = sim.record(looks=0, spins=0, names=["P1", "P2", "P3", "P2"], wrists=[sim.wrist()] * 4)
    assert "P1 and P3 were exchanged" in rival_names(twice)
