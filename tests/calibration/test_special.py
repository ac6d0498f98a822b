"""The special method on 4-axis robots, without any TCP, and p_f from holes."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.studies.paper.baselines import (
    SPECIAL,
    SPECIAL_CAD,
    compare_methods,
    expected_by_method,
)
from fakes.world.noise import Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.joint.problem import HolePixel
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.stepwise.hole_center import combine, find_hole_center
from vgrd.calibration.touches.reference import find_reference
from vgrd.calibration.turntable.rotation_center import find_rotation_center
from vgrd.errors import DidNotConverge, InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import Plan, Policy

STEADY = Vision(0.001, 0.02, 0.005, 0.005)
PERFECT = Vision(1e-6, 1e-6, 1e-7, 1e-7)


def looks(cell, yaw_rad, count=10):
    """Pictures of tag A from a 4-axis arm: moved in x, y, z, turned about z only."""
    out = []
    for _ in range(count):
        turn = exp_rotation((0.0, 0.0, cell.rng.uniform(-yaw_rad, yaw_rad)))
        position = cell.rng.uniform((250, -100, 150), (450, 100, 350))
        out.append(cell.observe(Pose(turn @ WORK_ROTATION, position), 0.0))
    return tuple(out)


def recorded(seed, yaw_rad, vision=STEADY, **options):
    cell = Simulation(seed, vision=vision, **options)
    return cell, replace(cell.record(plan=Plan.SPECIAL), looks=looks(cell, yaw_rad))


def misses(cell, calibration, requests=5):
    """Distances in xy and lengths of the errors, mm, and the radii that were told."""
    rows = []
    for _ in range(requests):
        request = cell.request()
        tag_b = request.seen.tag_b
        served = expected_coordinate(calibration, request.target, tag_b, Policy.FIXED)
        flange = cell.flange(request.target, request.angle_rad, WORK_ROTATION)
        error = served.base_from_wrist.translation - flange
        rows.append((np.linalg.norm(error[:2]), np.linalg.norm(error), served.u95_mm))
    return np.array(rows).T


def test_a_4_axis_robot_at_constant_yaw_is_served_exactly_without_any_tcp():
    cell, recording = recorded(1, 1.0, touch_sigma_mm=0.0, vision=PERFECT)
    calibration = calibrate_system(recording)
    assert calibration.method == "special"
    assert calibration.tcp_in_wrist is None
    assert calibration.verdict.ok
    assert "height_free" in [finding.code for finding in calibration.verdict.findings]
    assert np.linalg.eigvalsh(calibration.solution.chain.hand_eye_covariance)[-1] > 500.0**2
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
    now = cell.observe(Pose(WORK_ROTATION, np.array([320.0, 40.0, 280.0])), 1.1)
    answers = expected_by_method(compare_methods(recording), "P2", now)
    for name in (SPECIAL, SPECIAL_CAD):
        np.testing.assert_allclose(answers[name], cell.flange("P2", 1.1, WORK_ROTATION), atol=2e-3)


def test_looks_without_any_turn_are_refused_with_the_missing_motion():
    _, recording = recorded(1, 0.0)
    with pytest.raises(NotObservable, match="kept its orientation"):
        calibrate_system(recording)


def test_without_a_rotation_centre_the_missing_motion_is_still_named():
    _, recording = recorded(1, 1.0)
    with pytest.raises(NotObservable, match="about one axis only"):
        calibrate_system(replace(recording, spins=()))


HOLE_PX = 0.05
SPINS = range(10)


def holes_in(cell, spins, names=("P1", "P2", "P3", "P4", "P5", "P6"), sigma=HOLE_PX):
    """What the camera sees of the holes: as touched (None) and in these spins."""
    return [
        HolePixel(hole.target, hole.pixel, max(sigma, 1e-3), hole.spin)
        for hole in cell.holes(spins, sigma)
        if hole.target in names
    ]


def center_in_tag(cell):
    return cell.object_from_tag_b.inverse().translation


@pytest.mark.parametrize("spins", [[None], SPINS, [None, 3]])
def test_holes_tell_the_centre_exactly_whether_the_object_was_turned_or_not(spins):
    cell, recording = recorded(1, 1.0, vision=PERFECT)
    seen = holes_in(cell, spins, sigma=0.0)
    found = find_hole_center(recording, seen, find_reference(recording.touches))
    np.testing.assert_allclose(found.center_in_tag, center_in_tag(cell), atol=1e-3)
    assert found.used == 6 * len(spins)


@pytest.mark.parametrize("rotation_deg", [0.005, 0.1])
def test_the_covariance_of_the_centre_by_holes_holds_the_noise_of_the_tags_too(rotation_deg):
    nees = []
    for seed in range(40):
        vision = replace(STEADY, tilt_deg=rotation_deg, roll_deg=rotation_deg)
        cell, recording = recorded(seed, 1.0, vision=vision)
        seen = holes_in(cell, [None, *SPINS])
        found = find_hole_center(recording, seen, find_reference(recording.touches))
        off = found.center_in_tag - center_in_tag(cell)
        nees.append(off @ np.linalg.solve(found.covariance, off))
    assert np.mean(nees) == pytest.approx(3, rel=0.35)


def test_without_any_turn_the_holes_let_a_constant_wrist_be_served():
    cell, recording = recorded(3, 1.0, touch_sigma_mm=0.0, vision=PERFECT)
    still = replace(recording, spins=(), looks=cell.looks(8))
    with pytest.raises(InputError, match="rotation centre or the TCP"):
        misses(cell, calibrate_system(still))
    calibration = calibrate_system(still, sightings=holes_in(cell, [None], sigma=0.0))
    _, off, _ = misses(cell, calibration)
    np.testing.assert_allclose(off, 0, atol=5e-3)
    assert calibration.residuals["holes_used"] == 6


def test_a_centre_that_is_wrong_in_cad_is_told_and_served_right_by_the_holes():
    cell, recording = recorded(5, 1.0, touch_sigma_mm=0.0, vision=PERFECT)
    spec = replace(recording.facts.object, center_in_object=np.array([0.6, -0.8, 0.0]))
    wrong = replace(recording, facts=replace(recording.facts, object=spec))
    seen = holes_in(cell, SPINS, sigma=0.01)
    alone, helped = calibrate_system(wrong), calibrate_system(wrong, sightings=seen)
    (told,) = [one for one in helped.verdict.findings if one.code == "pivot_disagrees"]
    assert "1.00 mm" in told.message
    assert helped.verdict.ok
    assert misses(cell, helped)[1].max() < 0.03 < 0.3 < misses(cell, alone)[1].max()


def test_where_both_agree_the_centre_is_better_than_either_and_nothing_is_told():
    apart = {"turned": [], "holes": [], "both": []}
    for seed in range(12):
        vision = Vision(0.05, 0.02, 0.1, 0.1)
        cell, recording = recorded(seed, 1.0, vision=vision)
        tags = [spin.tag_b for spin in recording.spins]
        turned = find_rotation_center(
            [tag.camera_from_tag for tag in tags], [tag.covariance for tag in tags]
        )
        reference = find_reference(recording.touches)
        seen = holes_in(cell, SPINS, sigma=0.5)
        holes = find_hole_center(recording, seen, reference)
        both = combine(holes, turned, 0.02)
        assert both.apart_sigmas < 5
        axis = cell.object_from_tag_b.rotation.T[:, 2]
        for name, found in (("turned", turned), ("holes", holes), ("both", both)):
            apart[name].append(
                np.linalg.norm(np.cross(axis, found.center_in_tag - center_in_tag(cell)))
            )
        codes = [one.code for one in calibrate_system(recording, sightings=seen).verdict.findings]
        assert "pivot_disagrees" not in codes
    rms = {name: np.sqrt(np.mean(np.square(values))) for name, values in apart.items()}
    assert rms["both"] < 1.02 * min(rms["turned"], rms["holes"])


def test_a_wrong_hole_is_left_out_and_too_few_are_refused_with_the_reason():
    cell, recording = recorded(2, 1.0, vision=PERFECT)
    reference = find_reference(recording.touches)
    seen = holes_in(cell, SPINS, sigma=0.01)
    seen[7] = replace(seen[7], pixel=np.add(seen[7].pixel, (9.0, -4.0)))
    found = find_hole_center(recording, seen, reference)
    assert found.used == len(seen) - 1
    np.testing.assert_allclose(found.center_in_tag, center_in_tag(cell), atol=5e-3)
    with pytest.raises(TooFewObservations, match="3 holes"):
        find_hole_center(recording, seen[:2], reference)
    two = holes_in(cell, SPINS, ("P1", "P4"))
    told = calibrate_system(recording, sightings=two).verdict.findings
    assert "holes_unusable" in [one.code for one in told]
    mixed = [replace(one, target=f"P{(i * i) % 6 + 1}") for i, one in enumerate(seen)]
    with pytest.raises(DidNotConverge, match="contradict"):
        find_hole_center(recording, mixed, reference)
