"""Held-out touches count along what they measured, as precisely as they say, and no NaN passes."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.verification import verify
from vgrd.geometry import Pose
from vgrd.model import Plan, Tool, frozen_array

ANGLES = np.linspace(-2.5, 2.5, 20)
ASKEW = np.array([0.6, 0.0, 0.8])


@pytest.fixture(scope="module")
def calibration():
    return calibrate_system(Simulation(3).record(plan=Plan.SPECIAL))


def touched(sigmas_mm=(0.233, 0.233), seed=0, angle=1.0):
    """One honest touch with these sigmas, across and along the tool."""
    sim = Simulation(seed, touch_sigma_mm=0.233)
    sim.sigmas_mm = tuple(0.0 if np.isinf(s) else s for s in sigmas_mm)
    touch = sim.touch("P2", WORK_ROTATION, angle)
    return replace(touch, lateral_sigma_mm=sigmas_mm[0], axial_sigma_mm=sigmas_mm[1])


def moved(touch, off_in_wrist):
    pose = touch.base_from_wrist
    off = pose.rotation @ np.asarray(off_in_wrist, dtype=float)
    return replace(touch, base_from_wrist=Pose(pose.rotation, pose.translation + off))


def codes(calibration, *touches):
    findings, _ = verify(calibration, touches)
    return [finding.code for finding in findings if finding.fatal]


@pytest.mark.parametrize(
    "sigmas_mm", [(0.233, 0.233), (0.233, 1.0), (1.0, 0.05), (0.233, np.inf), (np.inf, 0.1)]
)
def test_honest_touches_pass_whatever_their_sigmas_along_and_across(calibration, sigmas_mm):
    touches = [touched(sigmas_mm, k, angle) for k, angle in enumerate(ANGLES)]
    assert codes(calibration, *touches) == []


def test_a_touch_that_is_rough_along_the_tool_is_still_precise_across_it(calibration):
    rough = touched((0.05, 2.0))
    assert codes(calibration, moved(rough, (0, 0, 2.0))) == []
    assert codes(calibration, moved(rough, (1.5, 0, 0))) == ["verification_failed"]


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
def test_the_sigmas_stand_along_the_tool_and_not_along_the_flange(axis):
    sim = Simulation(3)
    recording = sim.record(plan=Plan.SPECIAL)
    tool = Tool(axis_in_wrist=frozen_array(axis, 3))
    recording = replace(recording, facts=replace(recording.facts, tool=tool))
    calibration = calibrate_system(recording)
    across = np.linalg.svd(np.array([axis]))[2][1]
    rough = replace(touched((0.05, 0.05)), axial_sigma_mm=3.0)
    assert codes(calibration, moved(rough, 2.5 * np.array(axis))) == []
    assert codes(calibration, moved(rough, 2.5 * across)) == ["verification_failed"]


@pytest.mark.parametrize("sigmas_mm", [(np.inf, 0.1), (0.1, np.inf)])
def test_a_miss_of_50_mm_fails_although_a_direction_was_not_measured(calibration, sigmas_mm):
    off = moved(touched(sigmas_mm), 50 * ASKEW)
    findings, residuals = verify(calibration, [off])
    assert [finding.code for finding in findings] == ["verification_failed"]
    assert residuals["verification_max_mm"] > 25


def test_a_touch_that_measured_nothing_verifies_nothing_and_says_so(calibration):
    findings, residuals = verify(calibration, [touched((np.inf, np.inf))])
    assert [finding.code for finding in findings] == ["verification_unusable"]
    assert residuals == {}


@pytest.mark.parametrize("sigmas_mm", [(np.nan, 0.1), (0.1, np.nan)])
def test_what_is_not_a_number_passes_no_verification(calibration, sigmas_mm):
    touch = replace(touched(), lateral_sigma_mm=sigmas_mm[0], axial_sigma_mm=sigmas_mm[1])
    assert codes(calibration, touch) == ["verification_failed"]


def test_an_exact_calibration_and_an_exact_touch_allow_no_miss(calibration):
    sure = replace(
        calibration,
        taught={
            name: replace(point, covariance=frozen_array(np.zeros((3, 3)), 3, 3))
            for name, point in calibration.taught.items()
        },
    )
    touch = replace(touched(), lateral_sigma_mm=1e-9, axial_sigma_mm=1e-9)
    assert codes(sure, moved(touch, (0, 0, 5.0))) == ["verification_failed"]
