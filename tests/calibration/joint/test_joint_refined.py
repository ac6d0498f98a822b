from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import FINE
from fakes.world.simulation import Simulation
from vgrd.calibration.joint.camera_corrections import FOCAL, TAG_A, TAG_B, PriorSigmas
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.joint.rows import as_refined, linearize
from vgrd.geometry import Pose, exp_rotation, log_rotation
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import pose_from_points
from vgrd.model import ArmModel

EXACT = ArmModel()
SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
SIZES = PriorSigmas(tag_a_mm=0.1, tag_b_mm=0.1)
EVERYTHING = replace(SIZES, focal_px=30.0, center_px=15.0, k1=0.03)


class Misjudged(Simulation):
    """Tags are printed larger than the cell file says, and the camera is another one."""

    def __init__(self, seed, *, larger=(1.0, 1.0), moved=(0, 0, 0, 0, 0, 0), **options):
        super().__init__(seed, **options)
        self.larger = larger
        facts = self.facts()
        self.assumed = CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px)
        self.camera = self.assumed.with_intrinsics(self.assumed.intrinsics() + moved)

    def _see(self, spec, truth):
        seen = super()._see(spec, truth)
        corners = SQUARE * spec.size_mm
        at = seen.camera_from_tag @ (corners * self.larger[spec.id])
        found = pose_from_points(
            corners, self.camera.project(at), self.assumed, seen.camera_from_tag
        )
        return replace(seen, camera_from_tag=found.camera_from_target)


def taught(seed, **options):
    sim = Misjudged(seed, touch_sigma_mm=0.02, **options)
    wrists = [sim.wrist()] * 4 + [sim.wrist(0.4) for _ in range(4)]
    return sim, sim.record(wrists=wrists)


def worst_miss(sim, result):
    misses = []
    for _ in range(6):
        request = sim.request()
        expected = expected_by_joint(result, request.target, request.seen)
        misses.append(np.linalg.norm(sim.miss(request, expected.base_from_wrist)))
    return max(misses)


def refined_mm(result, tag):
    corrections = result.refined
    column = result.layout.refined_columns.start + list(corrections.corrections.sigmas).index(tag)
    sigma = np.sqrt(result.covariance[column, column]) * corrections.corrections.sigmas[tag]
    return corrections.corrections.size_mm(tag, corrections.values), sigma


def test_tags_printed_large_are_found_by_the_robots_motion_and_the_coordinate_is_right():
    sim, recording = taught(3, larger=(1.002, 1.002))
    held = calibrate_joint(recording, arm=EXACT, find_noise=False)
    result = calibrate_joint(recording, arm=EXACT, refine=SIZES, find_noise=False)
    size, sigma = refined_mm(result, TAG_A)
    assert size == pytest.approx(25.05, abs=3 * sigma)
    assert sigma < 0.002
    assert refined_mm(result, TAG_B)[0] == pytest.approx(
        25.05, abs=3 * refined_mm(result, TAG_B)[1]
    )
    assert worst_miss(sim, held) > 0.1
    assert worst_miss(sim, result) < 0.05
    assert result.noise_scale == pytest.approx(1, abs=0.15)


def test_a_camera_that_is_not_as_assumed_is_found():
    moved = np.array([20.0, 20.0, 8.0, -5.0, 0.02, 0.0])
    sim, recording = taught(4, moved=moved)
    result = calibrate_joint(recording, arm=EXACT, refine=EVERYTHING, find_noise=False)
    camera = result.refined.corrections.camera_at(result.refined.values)
    off = np.abs(camera.intrinsics() - sim.camera.intrinsics())
    assert (off <= [5, 5, 3, 3, 1e-3, 0]).all()
    assert worst_miss(sim, result) < 0.05
    assert worst_miss(sim, calibrate_joint(recording, arm=EXACT, find_noise=False)) > 0.2


def test_refining_what_was_right_changes_little_and_says_how_much():
    sim, recording = taught(5)
    result = calibrate_joint(recording, arm=EXACT, refine=EVERYTHING, find_noise=False)
    part = result.layout.refined_columns
    sigmas = np.sqrt(np.diag(result.covariance)[part])
    assert (sigmas <= 1 + 1e-9).all()
    assert (np.abs(result.state.refined) < 4 * sigmas).all()
    assert worst_miss(sim, result) < 0.06
    assert not result.undetermined.size


def test_a_corrected_tag_is_the_one_that_would_have_been_measured():
    sim, recording = taught(6, larger=(1.003, 0.998), moved=(15, 15, 4, 3, 0.01, 0), vision=FINE)
    result = calibrate_joint(recording, arm=EXACT, refine=EVERYTHING, find_noise=False)
    values = np.zeros(6)
    sigmas = result.refined.corrections.sigmas
    truth = {TAG_A: 0.075, TAG_B: -0.05, FOCAL: 15.0, "cx": 4.0, "cy": 3.0, "k1": 0.01}
    for i, (name, sigma) in enumerate(sigmas.items()):
        values[i] = truth[name] / sigma
    tag = sim.observe(sim.standing, 0.7).tag_b
    corrected = replace(result.refined, values=values).corrected(tag, TAG_B)
    camera_from_base = sim.base_from_camera.inverse()
    there = camera_from_base @ sim.base_from_object(0.7) @ sim.object_from_tag_b
    mm, rad = corrected.camera_from_tag.distance(there)
    assert mm < 0.02
    assert rad < 2e-4
    assert tag.camera_from_tag.distance(there)[0] > 0.5


def test_derivatives_by_the_refined_numbers_are_true():
    _, recording = taught(7)
    result = calibrate_joint(recording, arm=EXACT, refine=EVERYTHING, find_noise=False)
    tag, corrections, h = recording.spins[2].tag_b, result.refined, 1e-4
    by = corrections.tangent(corrections.corrected(tag, TAG_B).camera_from_tag, TAG_B)
    for i in range(by.shape[1]):
        step = h * np.eye(by.shape[1])[i]
        ends = [
            replace(corrections, values=corrections.values + s * step)
            .corrected(tag, TAG_B)
            .camera_from_tag
            for s in (1, -1)
        ]
        turn = ends[0].rotation @ ends[1].rotation.T
        shift = ends[0].translation - turn @ ends[1].translation
        numeric = np.concatenate([shift, log_rotation(turn)]) / (2 * h)
        np.testing.assert_allclose(by[:, i], numeric, atol=1e-6 + 1e-4 * np.abs(numeric).max())


def test_rows_follow_the_refined_numbers_as_pictures_do():
    """Cost at a moved state: linear in place, and with the pictures corrected anew."""
    _, recording = taught(8, vision=FINE)  # derivatives are those at the poses without their noise
    result = calibrate_joint(recording, arm=EXACT, refine=EVERYTHING, find_noise=False)
    J = linearize(result.state, result.data, result.layout)[1]
    raw = calibrate_joint(recording, arm=EXACT, find_noise=False).data
    raw = replace(raw, corrections=result.data.corrections)
    for i in range(result.layout.refined):
        step = np.zeros(result.layout.size)
        step[result.layout.refined_columns.start + i] = 1e-4
        ends = []
        for s in (1, -1):
            state = result.state.retract(s * step, result.layout)
            r = linearize(state, as_refined(state, raw, result.layout), result.layout)[0]
            ends.append(r @ r)
        r = linearize(result.state, result.data, result.layout)[0]
        gradient = 2 * r @ J[:, result.layout.refined_columns.start + i]
        scale = np.linalg.norm(J[:, result.layout.refined_columns.start + i])
        assert gradient == pytest.approx((ends[0] - ends[1]) / 2e-4, abs=2e-2 * scale)


def rounded(pose, mm, rad):
    turn = np.round(log_rotation(pose.rotation) / rad) * rad
    return Pose(exp_rotation(turn), np.round(pose.translation / mm) * mm)


def test_rounded_poses_are_what_the_model_of_rounding_says():
    mm, rad = 0.2, np.radians(0.02)
    sim = Simulation(9, vision=FINE, touch_sigma_mm=0.02)
    recording = sim.record(wrists=[sim.wrist(0.4) for _ in range(10)], looks=20)
    looks = [
        replace(s, base_from_wrist=rounded(s.base_from_wrist, mm, rad)) for s in recording.looks
    ]
    touches = []
    for touch in recording.touches:
        pose = rounded(touch.base_from_wrist, mm, rad)
        seen = replace(touch.observation, base_from_wrist=pose)
        touches.append(replace(touch, base_from_wrist=pose, observation=seen))
    recording = replace(recording, looks=tuple(looks), touches=tuple(touches))
    known = calibrate_joint(
        recording, arm=ArmModel(quantum_mm=mm, quantum_rad=rad), find_noise=False
    )
    ignored = calibrate_joint(recording, arm=EXACT, robust=False, find_noise=False)
    assert known.noise_scale == pytest.approx(1, abs=0.15)
    assert ignored.noise_scale > 3
    error = known.state.tcp_in_wrist - sim.tcp_in_wrist
    assert error @ np.linalg.solve(known.covariance[12:15, 12:15], error) < 16


def test_the_deviations_of_an_arm_have_the_variances_that_it_states():
    arm = ArmModel(0.03, 0.15, quantum_mm=0.1, quantum_rad=1e-3)
    H = arm.cholesky_factor(np.array([[0.0, 0, 0], [100.0, 0, 0]]))
    both = H @ H.T
    np.testing.assert_allclose(np.diag(both)[:6], arm.variances(), rtol=1e-6)
    shared = 0.15**2 * np.exp(-0.5 * (100 / 200) ** 2)
    assert both[0, 6] == pytest.approx(shared)
    assert arm.rounding()[0] == pytest.approx(0.1 / np.sqrt(12))
