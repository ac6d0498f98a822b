"""The special method on 4-axis robots, without any TCP, and p_f from a hole."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.recordings import SimulatedCell, Vision, fixed_wrist
from vgrd.calibration.baselines import SPECIAL, SPECIAL_CAD, expected_by_method
from vgrd.calibration.rotation_center_hole import find_hole_path
from vgrd.calibration.system import calibrate_system, expected_coordinate
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import Observation, Plan, Policy

PERFECT = Vision(1e-6, 1e-6, 1e-7)


def looks(cell, yaw_rad, count=10):
    """Pictures of tag A from a 4-axis arm: moved in x, y, z, turned about z only."""
    out = []
    for _ in range(count):
        turn = exp_rotation((0.0, 0.0, cell.rng.uniform(-yaw_rad, yaw_rad)))
        at = cell.rng.uniform((250, -100, 150), (450, 100, 350))
        wrist = Pose(turn @ fixed_wrist(), at)
        seen = cell.observe(wrist, 0.0)
        out.append(Observation(wrist, 0.0, seen.tag_a, seen.tag_b))
    return tuple(out)


def recorded(seed, yaw_rad, **options):
    cell = SimulatedCell(np.random.default_rng(seed), **options)
    return cell, replace(cell.record(plan=Plan.SPECIAL), looks=looks(cell, yaw_rad))


def misses(cell, calibration, requests=5):
    """Distances in xy and lengths of the errors, mm, and the radii that were told."""
    rows = []
    for _ in range(requests):
        angle, target = cell.rng.uniform(-np.pi, np.pi), f"P{cell.rng.integers(6) + 1}"
        wrist = Pose(fixed_wrist(), np.array([300.0, 60.0, 300.0]))
        seen = cell.observe(wrist, angle).tag_b
        served = expected_coordinate(calibration, target, seen, Policy.FIXED)
        off = served.base_from_wrist.translation - cell.flange(target, angle, fixed_wrist())
        rows.append((np.linalg.norm(off[:2]), np.linalg.norm(off), served.u95_mm))
    return np.array(rows).T


def test_a_4_axis_robot_at_constant_yaw_is_served_exactly_without_any_tcp():
    cell, recording = recorded(1, 1.0, touch_sigma_mm=0.0, vision=PERFECT)
    calibration = calibrate_system(recording)
    assert calibration.method == "special"
    assert calibration.tcp_in_wrist is None
    assert calibration.verdict.ok
    assert "height_free" in [finding.code for finding in calibration.verdict.findings]
    assert np.linalg.eigvalsh(calibration.hand_eye_covariance)[-1] > 500.0**2
    _, off, _ = misses(cell, calibration)
    np.testing.assert_allclose(off, 0, atol=2e-3)


def test_its_errors_at_the_papers_noise_are_small_and_its_radius_holds_them():
    xy, inside = [], []
    for seed in range(14):
        cell, recording = recorded(seed, 1.0)
        across, off, radius = misses(cell, calibrate_system(recording), 3)
        xy.append(across.mean())
        inside.append(np.mean(off <= radius))
    assert np.mean(xy) <= 0.2
    assert np.mean(inside) >= 0.88


def test_the_published_special_method_answers_for_a_4_axis_robot_too():
    cell, recording = recorded(3, 1.0, touch_sigma_mm=0.0, vision=PERFECT)
    now = cell.observe(Pose(fixed_wrist(), np.array([320.0, 40.0, 280.0])), 1.1)
    answers = expected_by_method(recording, "P2", now)
    for name in (SPECIAL, SPECIAL_CAD):
        np.testing.assert_allclose(answers[name], cell.flange("P2", 1.1, fixed_wrist()), atol=2e-3)


def test_looks_without_any_turn_are_refused_with_the_missing_motion():
    _, recording = recorded(1, 0.0)
    with pytest.raises(NotObservable, match="kept its orientation"):
        calibrate_system(recording)


def test_without_a_rotation_centre_the_missing_motion_is_still_named():
    _, recording = recorded(1, 1.0)
    with pytest.raises(NotObservable, match="about one axis only"):
        calibrate_system(replace(recording, spins=()))


CAMERA_FROM_AXIS = Pose.from_rotvec((2.9, 0.3, -0.2), (40.0, -25.0, 650.0))


def hole_places(angles, hole, seed=None, sigma=0.0):
    rng = np.random.default_rng(seed)
    places = [CAMERA_FROM_AXIS @ Pose.from_rotvec((0, 0, a)) @ np.array(hole) for a in angles]
    return np.array(places) + rng.normal(size=(len(places), 3)) * sigma


def test_a_hole_off_the_axis_gives_the_point_of_the_axis_at_its_height():
    found = find_hole_path(hole_places([0.0, 0.8, 2.0, 4.0], (70, 20, 12)), 0.01)
    np.testing.assert_allclose(found.center_in_camera, CAMERA_FROM_AXIS @ (0, 0, 12.0), atol=1e-6)
    assert abs(found.axis_in_camera @ CAMERA_FROM_AXIS.rotation[:, 2]) == pytest.approx(1)
    assert found.radius_mm == pytest.approx(np.hypot(70, 20))
    np.testing.assert_allclose(found.residuals_mm, 0, atol=1e-6)


def test_the_hole_of_the_bearing_is_the_centre_itself():
    found = find_hole_path(hole_places(np.arange(5.0), (0, 0, 12), 1, 0.02), 0.02)
    np.testing.assert_allclose(found.center_in_camera, CAMERA_FROM_AXIS @ (0, 0, 12.0), atol=0.05)
    assert found.axis_in_camera is None
    assert np.sqrt(np.trace(found.covariance)) < 0.02


@pytest.mark.parametrize("angles", [np.linspace(0, 5, 6), np.linspace(0, 1.5, 8)])
def test_the_covariance_of_a_holes_centre_is_as_large_as_its_scatter(angles):
    nees = []
    for seed in range(200):
        found = find_hole_path(hole_places(angles, (70, 20, 12), seed, 0.05), 0.05)
        off = found.center_in_camera - CAMERA_FROM_AXIS @ (0, 0, 12.0)
        nees.append(off @ np.linalg.solve(found.covariance, off))
    assert np.mean(nees) == pytest.approx(3, rel=0.2)


def test_a_hole_that_tells_no_circle_is_refused_with_the_remedy():
    with pytest.raises(NotObservable, match="third of a turn"):
        find_hole_path(hole_places([0, 0.05, 0.1, 0.15], (70, 0, 0), 1, 0.05), 0.05)
    with pytest.raises(TooFewObservations, match="3 pictures"):
        find_hole_path(hole_places([0, 1], (70, 0, 0)), 0.05)
    with pytest.raises(InputError, match="sigma above 0"):
        find_hole_path(hole_places([0, 1, 2], (70, 0, 0)), 0.0)
