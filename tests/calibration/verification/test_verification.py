"""Held-out touches count along what they measured, as precisely as they say, and no NaN passes."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.verification import turned_apart, verify
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


FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
ANYWHERE = frozen_array([np.inf] * 6, 6)
BENT = np.array([1.5, -0.8, 0.4])


def with_tool(sim, target, angle, bent=BENT):
    """An honest touch by a tool whose tip sits elsewhere than it was taught."""
    sim.tcp_in_wrist = Simulation.tcp_in_wrist + bent
    return sim.touch(target, WORK_ROTATION, angle)


@pytest.fixture(scope="module", params=[Plan.SPECIAL, Plan.JOINT])
def taught(request):
    sim = Simulation(3)
    tilts = [] if request.param is Plan.SPECIAL else [sim.wrist(np.radians(25)) for _ in range(4)]
    return calibrate_system(sim.record(wrists=[WORK_ROTATION] * 6 + tilts, plan=request.param))


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
def test_a_camera_that_moved_before_the_touches_is_followed_and_no_touch_misses(taught, stability):
    sim = Simulation(5)
    sim.base_from_camera = sim.base_from_camera @ Pose.from_rotvec((0.003, 0, 0.004), (3, -4, 1))
    touches = [sim.touch("P2", WORK_ROTATION, angle) for angle in (-2.0, 0.5, 1.7)]
    findings, residuals = verify(taught, touches, stability)
    assert findings == []
    assert residuals["verification_max_mm"] < 1.5
    assert codes(taught, *touches) == ["verification_failed"] * 3


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
def test_a_bent_tool_is_named_with_the_shift_of_its_tip(taught, stability):
    sim = Simulation(6, touch_sigma_mm=0.05)
    touches = [with_tool(sim, f"P{k + 1}", angle) for k, angle in enumerate((-2.0, 0.5, 1.7))]
    findings, _ = verify(taught, touches, stability)
    assert [one.code for one in findings if one.fatal] == ["verification_failed"] * 3
    (told,) = [one for one in findings if one.code == "tool_suspected"]
    assert told.message.startswith("tool: verification 1 (P1), verification 2 (P2)")
    shift = re.search(r"by \((.*)\) mm in the flange's frame", told.message)
    np.testing.assert_allclose([float(x) for x in shift[1].split(", ")], BENT, atol=0.4)


def test_one_bad_touch_among_good_ones_is_no_shift_of_the_tip(taught):
    sim = Simulation(7)
    touches = [sim.touch("P2", WORK_ROTATION, angle) for angle in (-2.0, 0.5, 1.7)]
    touches[1] = moved(touches[1], (2.0, 1.0, 0.0))
    (told,) = [one for one in verify(taught, touches, FIXED)[0] if one.code == "tool_suspected"]
    assert "verification 2 (P2) missed" in told.message
    assert "flange's frame" not in told.message


def test_without_tag_a_nothing_is_said_of_the_tool(taught):
    touch = with_tool(Simulation(8), "P2", 1.0, bent=3 * BENT)
    hidden = replace(touch, observation=replace(touch.observation, tag_a=None))
    for picture, stability in ((hidden, FIXED), (touch, None)):
        findings, _ = verify(taught, [picture], stability)
        assert [one.code for one in findings] == ["verification_failed"]
    findings, _ = verify(taught, [hidden], ANYWHERE)
    assert [one.code for one in findings] == ["verification_unusable"]


def test_honest_touches_pass_with_every_stability(taught):
    sims = [Simulation(100 + k) for k in range(60)]
    touches = [sim.touch("P2", WORK_ROTATION, sim.rng.uniform(-3, 3)) for sim in sims]
    for stability in (FIXED, ANYWHERE):
        assert verify(taught, touches, stability)[0] == []


def test_a_verification_counts_only_with_the_object_turned_from_all_that_were_touched():
    taught = [touched(angle=angle) for angle in (0.0, 0.2)]
    degrees = np.array([10, 90, 100, 180, 190])
    tried = [touched(angle=np.radians(angle)) for angle in degrees]
    assert degrees[turned_apart(taught, tried)].tolist() == [90, 180]
    unseen = replace(tried[1], observation=None)
    assert turned_apart(taught, [unseen]) == []
    assert turned_apart([], tried[:1]) == [0]
