"""Slips in a recording that samples by themselves do not contradict: sizes, units, conventions."""

import sys

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from vgrd import cli
from vgrd.commands import solving
from vgrd.errors import CalibrationError
from vgrd.geometry import Pose
from vgrd.geometry.rotation_formats import RotationFormat
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


def told(path):
    """What the user reads, whether a solution came out or not."""
    try:
        solution = solve_dataset(path)
    except CalibrationError as error:
        return str(error)
    assert solution.ok is False
    return " ".join(messages(solution).values())


def in_other_unit(recording, factor):
    recording.seen = [Pose(p.rotation, p.translation * factor) for p in recording.seen]
    return recording


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000.0, "metres beside millimetres"),
        (1e-3, "metres beside millimetres"),
        (0.1, "centimetres beside millimetres"),
        (25.4, "inches beside millimetres"),
        (1.7, "measure the target too"),
    ],
)
def test_lengths_of_the_camera_in_another_unit_are_named(tmp_path, make_recording, factor, words):
    recording = in_other_unit(noisy(make_recording(count=10)), factor)
    said = told(recording.write_matrices(tmp_path))
    assert "But for the unit of length the samples agree" in said
    assert words in said


def with_quaternions(path, seen, order):
    """The dataset with camera_from_target as quaternions that are said to be xyzw."""
    lines, poses = [], iter(seen)
    for line in path.read_text().splitlines():
        if line.startswith("camera_from_target"):
            pose = next(poses)
            numbers = [*pose.translation * 1e-3, *Rotation.from_matrix(pose.rotation).as_quat()]
            line = f"camera_from_target = {[float(v) for v in np.take(numbers, order)]}"
        lines.append(line)
    head = '[camera_poses]\nrotation = "quaternion-xyzw"\n'
    text = "\n".join(lines)
    start = text.index("[[sample]]")
    path.write_text(text[:start] + head + text[start:] + "\n")
    return path


WXYZ = [0, 1, 2, 6, 3, 4, 5]


def test_the_order_of_the_cameras_quaternions_is_named(tmp_path, recording):
    path = with_quaternions(recording.write_matrices(tmp_path), recording.seen, WXYZ)
    said = told(path)
    assert "rotation = quaternion-xyzw, mount = eye-to-hand" in said
    assert "camera_poses.rotation = quaternion-wxyz" in said


def test_quaternions_of_both_sides_in_the_other_order_are_named(tmp_path, recording):
    path = recording.write_matrices(tmp_path, rotation=RotationFormat.QUATERNION_WXYZ)
    path.write_text(path.read_text().replace("quaternion-wxyz", "quaternion-xyzw"))
    said = told(with_quaternions(path, recording.seen, WXYZ))
    assert "or quaternion-wxyz, mount = eye-to-hand" in said
    assert "camera_poses.rotation = quaternion-wxyz" in said


def test_matrices_keep_their_name_and_inverted_poses_are_thought_of(tmp_path, recording):
    recording.seen = [pose.inverse() for pose in recording.seen]
    matrices = [Pose(p.rotation, p.translation * 1e-3).matrix() for p in recording.robot]
    path = recording.write_matrices(tmp_path)
    text = path.read_text().replace('rotation = "quaternion-xyzw"', 'rotation = "matrix"')
    rows = iter(matrices)
    text = "\n".join(
        f"pose = {next(rows).ravel().tolist()}" if line.startswith("pose =") else line
        for line in text.splitlines()
    )
    path.write_text(text)
    said = told(path)
    assert "rotation = matrix" in said
    assert "quaternion" not in said
    assert "camera_from_target as target_from_camera" in said


def test_samples_that_agree_as_written_bring_no_other_reading(tmp_path, make_recording):
    recording = make_recording(count=6)
    recording.robot = [
        Pose(Rotation.from_rotvec([0, 0, 0.2 * i]).as_matrix(), [400, 0, 300]) for i in range(6)
    ]
    recording.seen = [
        recording.X.inverse() @ pose @ recording.Y @ Pose.from_rotvec([0, 0, 1e-4 * (-1) ** i])
        for i, pose in enumerate(recording.robot)
    ]
    said = told(recording.write_matrices(tmp_path))
    assert "without moving across it" in said
    assert "Paired" not in said
    assert "Read as" not in said


def printed(monkeypatch, capsys, *arguments):
    """What `vgrd solve` prints, both streams."""
    monkeypatch.setattr(sys, "argv", ["vgrd", "solve", *arguments])
    monkeypatch.setattr(solving, "console", Console(width=300))
    with pytest.raises(SystemExit):
        cli.main()
    return "".join(capsys.readouterr())


def test_the_first_line_says_why_a_calibration_is_not_to_be_used(
    tmp_path, make_recording, monkeypatch, capsys
):
    recording = in_other_unit(noisy(make_recording(count=8)), 1000.0)
    out = printed(monkeypatch, capsys, str(recording.write_matrices(tmp_path)))
    first = out.splitlines()[0]
    assert first.startswith("not to be used: the samples contradict each other")
    assert "metres beside millimetres" in first
    assert "e+0" not in out


@pytest.mark.parametrize("tolerance", ["-1", "0", "nan", "inf"])
def test_what_is_no_tolerance_is_refused(tmp_path, recording, monkeypatch, capsys, tolerance):
    path = recording.write_matrices(tmp_path)
    out = printed(monkeypatch, capsys, str(path), "--tolerance-mm", tolerance)
    assert f"--tolerance-mm: {tolerance} is no tolerance" in out


def test_a_camera_that_was_bumped_half_way_is_told_as_scatter(tmp_path, make_recording):
    recording = noisy(make_recording(count=16))
    bump = Pose.from_rotvec([0.008, -0.006, 0.004], [7.0, -5.0, 5.0])
    half = len(recording.seen) // 2
    recording.seen = recording.seen[:half] + [bump @ pose for pose in recording.seen[half:]]
    solution = solve_dataset(recording.write_matrices(tmp_path))
    said = messages(solution)["samples_scatter"]
    assert "times the scatter assumed" in said
    assert "moved" in said


def test_a_good_recording_scatters_as_assumed(tmp_path, make_recording):
    recording = noisy(make_recording(count=16), sigma_mm=0.5)
    assert "samples_scatter" not in messages(solve_dataset(recording.write_matrices(tmp_path)))


def test_poses_of_a_board_taken_half_a_turn_round_are_named_once(tmp_path, make_recording):
    recording = noisy(make_recording(count=12))
    turned = Pose(np.diag([-1.0, -1.0, 1.0]), [125.0, 100.0, 0.0])
    recording.seen[4] = recording.seen[4] @ turned
    findings = solve_dataset(recording.write_matrices(tmp_path)).verdict.findings
    (own,) = [found for found in findings if "sample 4:" in found.message]
    assert own.code == "sample_rejected"
    assert "half a turn round" in own.message
