"""A session whose camera was moved between its samples, solved as the daemon does."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.checks import examine, missing_motion
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.planning.advice import advise_session
from vgrd.calibration.planning.next_sample import rank_samples
from vgrd.calibration.planning.predicted_error import Job
from vgrd.calibration.planning.reach import Looking, Spinning, Touching
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.model import Plan, Policy, Stability, place_in

ARM = ArmErrors(sigma_mm=0.03, field_mm=0.1)


class Moving(Simulation):
    """The camera stands elsewhere in every picture, by up to `reach_mm` and as many mrad."""

    reach_mm = 0.0

    def observe(self, *arguments, **options):
        tangent = self.reach_mm * self.rng.uniform(-1, 1, 6) * ([1] * 3 + [1e-3] * 3)
        self.base_from_camera = Simulation.base_from_camera @ Pose.exp(tangent)
        return super().observe(*arguments, **options)

    def facts(self):
        return replace(super().facts(), camera_stability=Stability.MOVABLE)


def taught(seed=1, reach_mm=200.0, **options):
    cell = Moving(seed, vision=FINE, arm=ARM)
    cell.reach_mm = reach_mm
    wrists = [cell.wrist()] * 6 + [cell.wrist(np.radians(25)) for _ in range(4)]
    return cell, cell.record(wrists=wrists, **options)


def codes(findings):
    return {remark.code for remark in findings}


@pytest.mark.parametrize("reach_mm", [0.0, 200.0])
def test_a_session_with_a_movable_camera_is_solved_and_served(reach_mm):
    cell, recording = taught(2, reach_mm)
    calibration = calibrate_system(recording)
    assert calibration.verdict.ok
    assert codes(calibration.verdict.findings) == {"flange_not_proven"}
    for _ in range(5):
        request = cell.request()
        expected = expected_coordinate(
            calibration,
            request.target,
            request.seen.tag_b,
            Policy.FIXED,
            camera=place_in(request.seen, Stability.MOVABLE),
        )
        assert np.linalg.norm(cell.miss(request, expected.base_from_wrist)) < 2 * expected.u95_mm


def test_verifications_are_judged_where_the_camera_stood():
    cell, recording = taught(3)
    held_out = tuple(cell.touch(name, cell.wrist(), 0.7) for name in ("P1", "P4"))
    calibration = calibrate_system(replace(recording, verifications=held_out))
    assert calibration.verdict.ok
    assert calibration.residuals["verification_max_mm"] < 1.5
    hidden = cell.touch("P2", cell.wrist(), 0.7, tag_a=False)
    doubtful = calibrate_system(replace(recording, verifications=(hidden,)))
    assert "verification_unusable" in codes(doubtful.verdict.findings)


@pytest.mark.parametrize("plan", [Plan.SPECIAL, Plan.UNIVERSAL, Plan.CONVENTIONAL])
def test_the_papers_plans_refuse_a_camera_that_may_move(plan):
    _, recording = taught()
    with pytest.raises(
        InputError, match=r"stability is movable: teach with plan joint, or fasten"
    ):
        calibrate_system(replace(recording, plan=plan))


def test_a_good_session_has_no_finding_and_a_mistake_is_still_named():
    _, recording = taught(4)
    assert not examine(recording)
    inverted = replace(
        recording,
        touches=tuple(
            replace(
                touch,
                base_from_wrist=touch.base_from_wrist.inverse(),
                observation=replace(
                    touch.observation, base_from_wrist=touch.base_from_wrist.inverse()
                ),
            )
            for touch in recording.touches
        ),
    )
    assert "poses_inverted_or_mount" in codes(examine(inverted))


def test_the_coach_works_with_a_camera_that_people_move():
    _, recording = taught(6)
    advice = advise_session(recording)
    assert not advice.findings
    assert not advice.trouble
    assert advice.best is not None


def test_the_coach_foresees_what_a_sample_brings_where_the_camera_may_stand_anywhere():
    cell, recording = taught(7)
    fit = calibrate_joint(recording, robust=False, find_noise=False)
    job = Job(Policy.FIXED, angles_rad=(0.0, 2.0))
    look = Looking(Pose(cell.wrist(np.radians(20)), np.array([400.0, 50, 200])))
    touch = Touching("P2", cell.wrist(np.radians(20)))
    looked, spun, touched = (
        rank_samples(fit, [candidate], job)[0] for candidate in (look, Spinning(1.0), touch)
    )
    assert looked.after_mm == pytest.approx(looked.before_mm, rel=1e-9)
    more_touches = (*recording.touches, cell.touch("P2", touch.base_from_wrist))
    more_spins = (*recording.spins, cell.observe(cell.standing, 1.0))
    for foreseen, more in (
        (touched, replace(recording, touches=more_touches)),
        (spun, replace(recording, spins=more_spins)),
    ):
        after = rank_samples(calibrate_joint(more, robust=False, find_noise=False), [look], job)[
            0
        ].before_mm
        assert foreseen.after_mm < foreseen.before_mm
        assert foreseen.before_mm - foreseen.after_mm == pytest.approx(
            foreseen.before_mm - after, rel=0.5, abs=2e-3
        )


def test_what_the_hand_eye_lacks_is_told_of_the_touches():
    _, recording = taught(5)
    blind = replace(
        recording,
        touches=tuple(
            replace(touch, observation=replace(touch.observation, tag_a=None))
            for touch in recording.touches
        ),
    )
    gap = missing_motion(blind)
    assert gap is not None
    assert gap.code == "hand_eye_motion"
    assert "touches showed both tags from 0 different robot poses" in gap.sentence
    assert "touch a target with both tags in view" in gap.sentence
