"""The conventional method (section III) on a 4-axis arm, as the paper's experiment B has it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fakes.studies.sessions import Session
from fakes.world.noise import COARSE, Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.checks import examine
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.tcp import calibrate_fixed_point
from vgrd.calibration.touches import TouchSet
from vgrd.errors import NotObservable
from vgrd.model import Plan, Policy

PERFECT = Vision(1e-6, 1e-6, 1e-7, 1e-7)
TURNED = WORK_ROTATION @ Rotation.from_euler("z", 0.7).as_matrix()
TILTED = WORK_ROTATION @ Rotation.from_euler("x", 0.05).as_matrix()
CONVENTIONAL = Session(Plan.CONVENTIONAL, points=10, looks=8)

axes = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1)


def cell(seed=1, one_axis=True, **options):
    return Simulation(seed, one_axis=one_axis, **options)


def perfect(**options):
    return cell(vision=PERFECT, touch_sigma_mm=0.0, **options)


def pin_touches(axis, tcp, m=6, sigma=0.2, noise=0.0):
    """Touches of one point, the wrist turned about one axis (3,) of its own."""
    rng = np.random.default_rng(0)
    axis = np.asarray(axis) / np.linalg.norm(axis)
    R = TURNED @ Rotation.from_rotvec(np.linspace(-0.6, 0.6, m)[:, None] * axis).as_matrix()
    t = np.array([400.0, 100.0, 60.0]) - R @ tcp + noise * rng.normal(size=(m, 3))
    return axis, TouchSet(R, t, np.array([0, 0, 1.0]), np.full(m, sigma), np.full(m, sigma))


@given(axis=axes)
def test_the_tcp_is_found_but_for_its_part_along_the_axis(axis):
    tcp = np.array([5.0, -8.0, 120.0])
    axis, touches = pin_touches(axis, tcp)
    with pytest.raises(NotObservable, match="5 of 6"):
        calibrate_fixed_point(touches)
    found = calibrate_fixed_point(touches, allow_open_axis=True)
    across = np.eye(3) - np.outer(axis, axis)
    np.testing.assert_allclose(abs(found.open_axis @ axis), 1, atol=1e-9)
    np.testing.assert_allclose(found.tcp_in_wrist, across @ tcp, atol=1e-3)
    assert axis @ found.covariance[:3, :3] @ axis == pytest.approx(500**2, rel=1e-3)


def test_across_the_axis_the_covariance_is_as_large_as_the_scatter():
    tcp, nees = np.array([5.0, -8.0, 0.0]), []
    rng = np.random.default_rng(3)
    for _ in range(200):
        _, clean = pin_touches((0, 0, 1), tcp)
        shifted = clean.translations + 0.2 * rng.normal(size=(6, 3))
        found = calibrate_fixed_point(replace(clean, translations=shifted), allow_open_axis=True)
        error = (found.tcp_in_wrist - tcp)[:2]
        nees.append(error @ np.linalg.solve(found.covariance[:2, :2], error))
    assert np.mean(nees) == pytest.approx(2, rel=0.2)
    assert found.degrees_of_freedom == 13


def test_a_wrist_that_never_turned_stays_refused():
    _, touches = pin_touches((0, 0, 1), np.zeros(3))
    still = replace(touches, rotations=np.tile(TURNED, (6, 1, 1)))
    with pytest.raises(NotObservable, match="kept its orientation"):
        calibrate_fixed_point(still, allow_open_axis=True)


@pytest.mark.parametrize("spins", [0, 6])
@pytest.mark.parametrize("one_axis", [False, True])
def test_plan_conventional_serves_the_true_coordinate(one_axis, spins):
    world = perfect(one_axis=one_axis)
    calibration = calibrate_system(replace(CONVENTIONAL, spins=spins).record(world))
    assert calibration.verdict.ok
    assert (calibration.tcp is None) is one_axis
    for policy, R_work in [(Policy.FIXED, None), (Policy.REQUESTED, TURNED)]:
        request = world.request()
        served = expected_coordinate(
            calibration, request.target, request.seen.tag_b, policy, R_work
        ).base_from_wrist
        truth = world.flange(request.target, request.angle_rad, served.rotation)
        np.testing.assert_allclose(served.translation, truth, atol=2e-3)


def test_it_is_said_in_words_and_asks_for_a_tilt_without_refusing():
    recording = CONVENTIONAL.record(cell())
    assert not any(finding.fatal for finding in examine(recording))
    (said,) = [
        f for f in calibrate_system(recording).verdict.findings if f.code == "tcp_axis_open"
    ]
    assert "the TCP along (0.00, 0.00, 1.00) of the wrist is not determined" in said.message


@pytest.mark.parametrize("spins", [0, 6])
def test_an_answer_at_another_tilt_is_refused_for_it_needs_the_tcp(spins):
    world = cell(vision=COARSE)
    calibration = calibrate_system(replace(CONVENTIONAL, spins=spins).record(world))
    request = world.request()
    asked = (calibration, request.target, request.seen.tag_b, Policy.REQUESTED)
    assert expected_coordinate(*asked, TURNED).u95_mm < 5
    with pytest.raises(NotObservable, match="keep the wrist at the tilt of the touches"):
        expected_coordinate(*asked, TILTED)


def test_the_stated_radius_holds():
    inside = []
    for seed in range(25):
        world = cell(seed)
        calibration = calibrate_system(CONVENTIONAL.record(world))
        request = world.request()
        served = expected_coordinate(calibration, request.target, request.seen.tag_b, Policy.FIXED)
        miss = world.miss(request, served.base_from_wrist)
        inside.append(np.linalg.norm(miss) <= served.u95_mm)
    assert np.mean(inside) >= 0.9
