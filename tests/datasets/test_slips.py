"""Slips in a recording that samples by themselves do not contradict: sizes, units, conventions."""

import numpy as np
import pytest

from vgrd.geometry import Pose
from vgrd.solving.datasets import solve_dataset


def messages(solution):
    """Findings by code; the last of each."""
    return {finding.code: finding.message for finding in solution.verdict.findings}


def noisy(recording, sigma_mm=0.2, seed=11):
    """The arm's places off by noise, as every arm's are."""
    rng = np.random.default_rng(seed)
    recording.robot = [
        Pose(pose.rotation, pose.translation + rng.normal(0, sigma_mm, 3))
        for pose in recording.robot
    ]
    return recording


def test_a_target_printed_larger_is_not_used_and_its_share_is_in_the_radius(
    tmp_path, make_recording
):
    recording = noisy(make_recording(count=12))
    path = recording.write_points(tmp_path, pixels=recording.pixels(scale=1.02, sigma_px=0.1))
    solution = solve_dataset(path, tolerance_mm=5)
    found = messages(solution)
    off_mm = solution.mount_from_camera.distance(recording.X)[0]
    assert off_mm > 8  # 2 % of half a metre
    assert solution.ok is False
    assert off_mm < solution.quality.mm < 3 * off_mm
    assert solution.quality.limits == "size of the target"
    assert {"target_size", "tolerance_exceeded"} <= set(found)
    assert solve_dataset(path).ok is False  # no tolerance is so large


def test_a_size_within_what_arms_err_by_is_refused_by_the_tolerance_alone(
    tmp_path, make_recording
):
    recording = noisy(make_recording(count=14), sigma_mm=0.05)
    path = recording.write_points(tmp_path, pixels=recording.pixels(scale=1.003, sigma_px=0.05))
    assert solve_dataset(path).ok is None
    assert solve_dataset(path, tolerance_mm=6).ok is True
    solution = solve_dataset(path, tolerance_mm=1.5)
    assert solution.ok is False
    assert "mm at" in messages(solution)["target_size"]


def test_the_right_size_adds_nothing(tmp_path, make_recording):
    recording = noisy(make_recording(count=12))
    solution = solve_dataset(
        recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.1))
    )
    assert solution.quality.size_mm == 0
    assert "target_size" not in messages(solution)


@pytest.mark.parametrize("pivot", [(0, 0, 0), (30, -10, 80)])
def test_a_head_that_only_turns_tells_no_size(tmp_path, make_recording, pivot):
    recording = make_recording("eye-in-hand", count=12)
    rng = np.random.default_rng(5)
    turns = [Pose.from_rotvec(rng.normal(0, 0.25, 3)) for _ in range(12)]
    point = Pose.from_rotvec([0, 0, 0], pivot)
    recording.robot = [point @ turn @ point.inverse() for turn in turns]
    to_target = Pose.from_rotvec([0.3, -0.2, 0.5], [800, 40, -20])
    recording.seen = [
        recording.X.inverse()
        @ pose.inverse()
        @ to_target
        @ Pose.from_rotvec(rng.normal(0, 5e-4, 3), rng.normal(0, 0.3, 3))
        for pose in recording.robot
    ]
    solution = solve_dataset(recording.write_matrices(tmp_path))
    assert np.isnan(solution.target_scale.value)
    assert "target_size" not in messages(solution)
