"""A small slip that a person takes over: what the pictures told is put in, and no more is claimed than is known."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fakes.studies.movement.visits import Visits
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.adoption import TERM_S, adopt, bear_out, link_called, term_unix_s
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.model import CameraPlace, FlangeTag, Link, Policy, frozen_array

ARM = ArmErrors(sigma_mm=0.02, field_mm=0.05)
STABILITY = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
MOST = (0.5, 5e-3)
NOW = 1.8e9
SLIP = Pose.from_rotvec((0.0008, -0.0005, 0), (0, 0, 0.12))  # of tag B, off its plane


@cache
def slipped(link=Link.TAG_B):
    """A cell whose tag slipped, its calibration, and its series that has found the slip."""
    sim = Simulation(4, vision=FINE, arm=ARM, touch_sigma_mm=0.03, center_sigma_mm=0.02)
    tilted = [sim.wrist(np.radians(25)) for _ in range(4)]
    recording = sim.record(wrists=[sim.wrist()] * 6 + tilted)
    calibration = replace(calibrate_system(recording), id="cal-000001")
    visits = Visits(sim, calibration.solution, recording.facts, STABILITY, poses=3)
    assert all(report.fits for report in visits.go(12))
    reports = list(visits.go(20, SLIP, link))
    assert not any(report.fits for report in reports)
    if link is Link.TAG_B:
        sim.object_from_tag_b = sim.object_from_tag_b @ SLIP
    else:
        sim.wrist_from_tag_a = sim.wrist_from_tag_a @ SLIP
    return sim, calibration, visits.series


def answer(calibration, request):
    place = CameraPlace(STABILITY, FlangeTag(request.seen.tag_a, request.seen.base_from_wrist))
    tag_b, taught = request.seen.tag_b, calibration.taught[request.target]
    solution, facts = calibration.solution, calibration.facts
    return solution.expected(facts, taught, tag_b, Policy.FIXED, WORK_ROTATION, place)


def adopted(link=Link.TAG_B):
    _, calibration, series = slipped(link)
    return adopt(calibration, series.slip(link), *MOST, "operator", NOW)


def test_the_pictures_tell_the_slip_and_how_well_they_know_it():
    _, calibration, series = slipped()
    slip = series.slip(Link.TAG_B)
    error = slip.tangent - SLIP.log()
    assert error @ np.linalg.solve(slip.covariance, error) < 12.6  # 95 % of six numbers
    np.testing.assert_allclose(slip.tangent[:3], SLIP.translation, atol=0.05)
    axis = calibration.solution.camera_from_axis
    X = calibration.solution.camera_from_tag_b.inverse() @ axis
    arc = X.adjoint()[:, 5]  # a turn about the axis, which no picture tells from a slip
    arc = arc / np.linalg.norm(arc[:3])
    told = 1 / (arc @ np.linalg.solve(slip.covariance, arc))
    assert np.sqrt(told) > 0.25 * slip.size_mm


def test_what_is_taken_over_is_served_nearer_to_the_truth_and_knows_less():
    sim, calibration, _ = slipped()
    new = adopted()
    before, after, grown = [], [], []
    for _ in range(30):
        request = sim.request()
        old, now = answer(calibration, request), answer(new, request)
        before.append(sim.miss(request, old.base_from_wrist))
        after.append(sim.miss(request, now.base_from_wrist))
        grown.append(now.u95_mm - old.u95_mm)
        assert np.linalg.norm(after[-1]) < now.u95_mm
    assert np.linalg.norm(np.mean(after, axis=0)) < 0.7 * np.linalg.norm(np.mean(before, axis=0))
    assert min(grown) > 0.02


def test_it_lapses_unless_a_touch_bears_it_out():
    sim, _, _ = slipped()
    new = adopted()
    assert term_unix_s(new) == NOW + TERM_S
    touch = sim.touch("P3", WORK_ROTATION, angle_rad=1.2)
    sound = bear_out(new, touch, STABILITY)
    assert math.isinf(term_unix_s(sound))
    assert sound.adopted[0].link is Link.TAG_B
    wrong = replace(
        touch,
        base_from_wrist=Pose(
            touch.base_from_wrist.rotation, touch.base_from_wrist.translation + 4.0
        ),
    )
    assert "misses by" in bear_out(new, wrong, STABILITY)


def test_no_more_than_the_stated_total_since_teaching_is_taken_over():
    _, calibration, series = slipped()
    slip = series.slip(Link.TAG_B)
    with pytest.raises(InputError, match=r"at most 0\.1 mm"):
        adopt(calibration, slip, 0.1, 1.0, "operator", NOW)
    once = adopt(calibration, slip, *MOST, "operator", NOW)
    twice = adopt(once, slip, *MOST, "operator", NOW)
    assert len(twice.adopted) == 2
    most = (2.5 * slip.size_mm, MOST[1])
    with pytest.raises(InputError, match="with all slips since teaching"):
        adopt(twice, slip, *most, "operator", NOW)


@pytest.mark.parametrize("link", [Link.CAMERA, Link.OBJECT])
def test_only_a_tag_is_taken_over(link):
    _, calibration, series = slipped()
    slip = replace(series.slip(Link.TAG_B), link=link)
    with pytest.raises(InputError, match=f"{link} cannot be taken over"):
        adopt(calibration, slip, *MOST, "operator", NOW)


def test_what_is_no_link_or_no_suspect_is_refused_by_name():
    with pytest.raises(InputError, match="choose one of camera, tag A, tag B, object"):
        link_called("tag C")
    _, calibration, series = slipped()
    with pytest.raises(InputError, match="not camera"):
        series.slip(Link.CAMERA)
    fresh = calibration.solution.series(calibration.facts, STABILITY)
    with pytest.raises(InputError, match="show no slip"):
        fresh.slip(Link.TAG_B)


def test_a_tag_a_that_slipped_is_taken_over_too():
    sim, calibration, _ = slipped(Link.TAG_A)
    new = adopted(Link.TAG_A)
    before, after = [], []
    for _ in range(20):
        request = sim.request()
        before.append(sim.miss(request, answer(calibration, request).base_from_wrist))
        now = answer(new, request)
        after.append(sim.miss(request, now.base_from_wrist))
        assert np.linalg.norm(after[-1]) < now.u95_mm
    assert np.linalg.norm(np.mean(after, axis=0)) < np.linalg.norm(np.mean(before, axis=0))
