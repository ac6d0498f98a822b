"""A focal length that is off: found where pictures and arm are at odds, told, and corrected in every picture."""

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.cameras import FIXED
from fakes.studies.misfits.cell import MisfitCell
from fakes.studies.misfits.judging import judge
from fakes.studies.misfits.worlds import World
from fakes.studies.sessions import Session
from fakes.world.simulation import Simulation
from vgrd.calibration.joint import TAG_A, TAG_B, PriorSigmas, calibrate_joint
from vgrd.calibration.joint.camera_corrections import CameraCorrections, RefinedCorrections
from vgrd.calibration.joint.noise.lens import focal_of, with_lens
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import DidNotConverge
from vgrd.geometry import Pose
from vgrd.model import Plan, Policy, TagObservation, frozen_array
from vgrd.solving.servable import unservable

OFF = 0.006
LOOKS, SPINS, TOUCHES = 12, 8, 10


def taught(seed, focal=OFF):
    session = Session(Plan.JOINT, looks=LOOKS, spins=SPINS, touches=TOUCHES, tilted=4, turned=5)
    pictures = LOOKS + SPINS + TOUCHES
    cell = MisfitCell(SeedSequence(seed), World(focal=focal), looks=LOOKS, pictures=pictures)
    return cell, session.record(cell)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_wrong_focal_length_is_named_with_its_size_and_does_no_harm(seed):
    cell, recording = taught(seed)
    calibration = calibrate_system(recording, stability=FIXED)
    codes = {finding.code for finding in calibration.verdict.findings}
    assert "lens_off" in codes
    assert not codes & {"camera_moved", "look_outlier", "arm_noise", "tag_noise"}
    assert unservable(calibration, Policy.FIXED) == ()
    share, sigma = focal_of(calibrate_joint(recording))
    assert abs(abs(share) - OFF) < 4 * sigma < OFF
    assert judge(cell, recording, 10).within > 0.6


def test_a_right_focal_length_is_not_refined():
    _, recording = taught(4, focal=0.0)
    fit = calibrate_joint(recording)
    assert "focal length" not in fit.data.corrections.sigmas
    assert fit.freed == ()


def test_what_cannot_be_solved_with_the_lens_stays_as_it_was():
    _, recording = taught(1)
    doubtful = calibrate_joint(recording, refine=PriorSigmas.of_print(recording.facts))

    def refined():
        raise DidNotConverge("not settled")

    assert with_lens(doubtful, refined) == (doubtful, None)


@pytest.mark.parametrize("tag", [TAG_A, TAG_B])
def test_a_corrected_tag_is_measured_where_it_was(tag):
    facts = Simulation(5).facts()
    corrections = CameraCorrections.of(
        facts,
        PriorSigmas(
            tag_a_mm=0.1,
            tag_b_mm=0.1,
            focal_px=20.0,
            center_px=3.0,
            stretch_a_mm=0.05,
            stretch_b_mm=0.05,
        ),
    )
    refined = RefinedCorrections(corrections, np.array([2.0, -1.5, 1.0, 0.7, -2.0, 2.0, -2.0]))
    pose = Pose.from_rotvec((2.9, 0.3, 0.4), (40.0, -30.0, 500.0))
    seen = TagObservation(
        facts.tag_b, pose, frozen_array(np.eye(6), 6, 6), frozen_array(np.zeros((4, 2)), 4, 2), 0.0
    )
    corrected = refined.corrected(seen, tag).camera_from_tag
    assert corrected.distance(pose)[0] > 1
    stretched = Pose.exp(refined.tangent(corrected, tag) @ refined.stretches) @ corrected
    assert stretched.distance(corrected)[1] > 0.005
    again = refined.measured(stretched, tag)
    assert again.distance(pose)[0] < 1e-3
    assert again.distance(pose)[1] < 1e-5
