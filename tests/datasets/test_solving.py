"""Datasets with known truth, solved."""

import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.console import Console

from vgrd import cli
from vgrd.commands import solving
from vgrd.errors import CalibrationError, ConfigError, NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.model import Mount
from vgrd.solving.datasets import fit_dataset, load_dataset, solve_dataset
from vgrd.solving.datasets.half_turns import turn_alike
from vgrd.vision.print.boards import BoardObservation

GRID = np.array([(25.0 * x, 25.0 * y, 0.0) for y in range(5) for x in range(6)])
MOUNTS = pytest.mark.parametrize("mount", list(Mount))
KEYS = {
    Mount.EYE_TO_HAND: ("base_from_camera", "wrist_from_target"),
    Mount.EYE_IN_HAND: ("wrist_from_camera", "base_from_target"),
}


def off(result, recording):
    """(mm, rad) that the two transforms of the JSON miss the truth by, the worse of both."""
    truth = zip(KEYS[recording.mount], (recording.X, recording.Y), strict=True)
    misses = [Pose.from_matrix(result[key]).distance(pose) for key, pose in truth]
    return max(mm for mm, _ in misses), max(rad for _, rad in misses)


def codes(solution):
    return [finding.code for finding in solution.verdict.findings]


@MOUNTS
def test_exact_points_give_the_true_transforms(tmp_path, make_recording, plain, mount):
    recording = make_recording(mount)
    result = plain(solve_dataset(recording.write_points(tmp_path)))
    mm, rad = off(result, recording)
    assert mm < 1e-3
    assert rad < 1e-6
    assert result["verdict"] == {"ok": None, "tolerance_mm": None, "findings": []}
    assert result["leave_one_out"]["mm"] < 1e-3
    assert result["target_scale"]["value"] == pytest.approx(1, abs=1e-5)


@MOUNTS
@pytest.mark.parametrize("unit", ["m", "mm"])
def test_exact_matrices_give_the_true_transforms(tmp_path, make_recording, plain, mount, unit):
    recording = make_recording(mount)
    result = plain(solve_dataset(recording.write_matrices(tmp_path, unit=unit)))
    mm, rad = off(result, recording)
    assert mm < 1e-3
    assert rad < 1e-6
    assert result["leave_one_out"]["px"] is None
    assert result["intrinsics"] is None
    assert result["target_scale"]["value"] == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize(
    "rotation", [RotationFormat.ROTVEC, RotationFormat.KUKA_ABC_DEG, RotationFormat.FANUC_WPR_DEG]
)
def test_poses_are_read_in_any_rotation_format(tmp_path, recording, plain, rotation):
    path = recording.write_matrices(tmp_path, rotation=rotation)
    assert off(plain(solve_dataset(path)), recording)[0] < 1e-3


def test_the_json_holds_exactly_the_promised_keys(tmp_path, recording, plain):
    result = plain(solve_dataset(recording.write_points(tmp_path)))
    assert set(result) == {
        "base_from_camera",
        "wrist_from_target",
        "leave_one_out",
        "quality",
        "covariance",
        "levels",
        "samples",
        "target_scale",
        "intrinsics",
        "verdict",
    }
    assert set(result["leave_one_out"]) == {"deg", "mm", "px"}
    assert set(result["samples"][0]) == {"name", "used", "reason", "px", "deg", "mm"}
    assert np.shape(result["base_from_camera"]) == (4, 4)


def test_pixel_noise_shows_in_leave_one_out_as_large_as_it_is(tmp_path, recording, plain):
    path = recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.3))
    result = plain(solve_dataset(path))
    assert off(result, recording)[0] < 1.0
    assert 0.3 < result["leave_one_out"]["px"] < 0.9
    assert 0.05 < result["leave_one_out"]["mm"] < 1.0


def test_refining_finds_the_true_intrinsics(tmp_path, make_recording, plain):
    true = CameraModel(
        np.array([[1420.0, 0, 640], [0, 1425.0, 478], [0, 0, 1]]), [-0.1, 0.05, 0, 0], (1260, 940)
    )
    recording = make_recording(count=10, camera=true)
    path = recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.05), refine=True)
    result = plain(solve_dataset(path))
    assert result["intrinsics"]["refined"]
    assert result["intrinsics"]["matrix"] == pytest.approx([1420, 1425, 640, 478], abs=3)
    assert result["intrinsics"]["distortion"][0] == pytest.approx(-0.1, abs=0.02)
    assert off(result, recording)[0] < 2.0


def test_wrong_intrinsics_are_refined_where_there_is_no_doubt_and_that_is_said(
    tmp_path, make_recording
):
    true = CameraModel(
        np.array([[1420.0, 0, 640], [0, 1425.0, 478], [0, 0, 1]]), [-0.1, 0.05, 0, 0], (1260, 940)
    )
    recording = make_recording(count=10, camera=true)
    path = recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.05))
    solution = solve_dataset(path)
    assert "intrinsics_doubtful" in codes(solution)
    assert solution.refined
    assert solution.camera is not None
    assert solution.camera.intrinsics()[:4] == pytest.approx([1420, 1425, 640, 478], abs=3)
    assert solution.as_given is not None
    assert solution.as_given.leave_one_out.mm > 2 * solution.leave_one_out.mm
    assert fit_dataset(replace(load_dataset(path), refine=True)).as_given is None
    poses = solution.to_json()["as_given"]
    for name, pose in (
        ("base_from_camera", solution.as_given.mount_from_camera),
        ("wrist_from_target", solution.as_given.mount_from_target),
    ):
        np.testing.assert_array_equal(poses[name], pose.matrix())
    assert any("intrinsics as given" in row for row in solution.summary_rows())


def test_right_intrinsics_stay_as_given(tmp_path, recording):
    solution = solve_dataset(
        recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.5))
    )
    assert not solution.refined
    assert solution.as_given is None
    assert "as_given" not in solution.to_json()
    assert "intrinsics_doubtful" not in codes(solution)


def test_only_a_tolerance_makes_it_ok(tmp_path, recording):
    path = recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.3))
    solution = solve_dataset(path)
    assert solution.ok is None
    assert "no tolerance given" in dict(solution.summary_rows())["verdict"]
    within = solution.quality.mm
    assert solve_dataset(path, tolerance_mm=1.1 * within).ok
    refused = solve_dataset(path, tolerance_mm=0.9 * within)
    assert refused.ok is False
    assert codes(refused)[0] == "tolerance_exceeded"


def test_the_noise_that_was_drawn_is_found_and_told(tmp_path, make_recording):
    recording = make_recording(count=20)
    rng = np.random.default_rng(5)
    recording.robot = [
        pose @ Pose.from_rotvec(2e-3 * rng.normal(size=3), 2.0 * rng.normal(size=3))
        for pose in recording.robot
    ]
    solution = solve_dataset(
        recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.3))
    )
    found = {level.name: level.found for level in solution.levels}
    assert found["pixels"] == pytest.approx(0.3, rel=0.1)
    assert found["arm's position"] == pytest.approx(2.0, rel=0.5)
    assert found["arm's turn"] == pytest.approx(2e-3, rel=0.5)
    misses = [
        solution.mount_from_camera.inverse() @ pose @ solution.mount_from_target
        for pose in recording.robot
    ]
    off = [a.distance(b)[0] for a, b in zip(misses, recording.seen, strict=True)]
    assert np.quantile(off, 0.9) < solution.quality.mm < 3 * np.max(off)


@pytest.mark.parametrize("kind", ["points", "matrices"])
def test_a_target_of_the_wrong_size_is_measured_by_the_robot(tmp_path, recording, kind):
    if kind == "points":
        path = recording.write_points(tmp_path, pixels=recording.pixels(scale=1.01))
    else:
        recording.seen = [Pose(p.rotation, p.translation / 1.01) for p in recording.seen]
        path = recording.write_matrices(tmp_path)
    solution = solve_dataset(path)
    assert solution.target_scale.value == pytest.approx(1.01, abs=2e-3)
    assert "target_size" in codes(solution)


@pytest.mark.parametrize("kind", ["points", "matrices"])
def test_a_sample_paired_with_a_wrong_pose_is_left_out_and_named(
    tmp_path, make_recording, plain, kind
):
    recording = make_recording(count=9)
    recording.robot[4] = Pose.from_rotvec([0.1, 0.2, 0], [30, 40, 10]) @ recording.robot[4]
    write = recording.write_points if kind == "points" else recording.write_matrices
    solution = solve_dataset(write(tmp_path))
    result = plain(solution)
    assert [sample["name"] for sample in result["samples"] if not sample["used"]] == ["4"]
    assert "off" in result["samples"][4]["reason"]
    assert result["samples"][4]["mm"] > 20
    assert result["leave_one_out"]["mm"] > 20 / 9
    assert "sample_rejected" in codes(solution)
    assert off(result, recording)[0] < 0.5


def hints(path):
    """What the user reads, whether a solution came out or not."""
    try:
        solution = solve_dataset(path)
    except CalibrationError as error:
        return str(error)
    assert not solution.verdict.ok
    return " ".join(finding.message for finding in solution.verdict.findings)


def test_a_wrong_rotation_format_is_recognised_and_the_right_one_named(tmp_path, recording):
    path = recording.write_points(tmp_path, rotation=RotationFormat.KUKA_ABC_DEG)
    path.write_text(path.read_text().replace("kuka-abc-deg", "fanuc-wpr-deg"))
    assert "rotation = kuka-abc-deg or epson-uvw-deg, mount = eye-to-hand" in hints(path)


def test_a_wrong_mount_is_recognised(tmp_path, recording):
    path = recording.write_matrices(tmp_path, mount=Mount.EYE_IN_HAND)
    assert "rotation = quaternion-xyzw, mount = eye-to-hand, the samples agree" in hints(path)


def test_a_wrist_that_never_turns_is_refused_with_the_missing_motion(tmp_path, recording):
    recording.robot = [Pose(recording.robot[0].rotation, p.translation) for p in recording.robot]
    with pytest.raises(NotObservable, match="turn it by"):
        solve_dataset(recording.write_matrices(tmp_path))


def test_three_samples_give_no_leave_one_out_and_say_so(tmp_path, make_recording, plain):
    solution = solve_dataset(make_recording(count=3).write_points(tmp_path))
    assert plain(solution)["leave_one_out"] == {"deg": None, "mm": None, "px": None}
    assert "no_leave_one_out" in codes(solution)


def test_progress_counts_up_to_the_end(tmp_path, recording):
    calls = []
    solve_dataset(recording.write_matrices(tmp_path), lambda *call: calls.append(call))
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1]
    assert calls == sorted(calls)


def test_the_command_prints_the_transforms_with_their_units(
    tmp_path, recording, capsys, monkeypatch
):
    path = recording.write_points(tmp_path)
    monkeypatch.setattr(sys, "argv", ["vgrd", "solve", str(path)])
    monkeypatch.setattr(solving, "console", Console(width=200))
    with pytest.raises(SystemExit):
        cli.main()
    out = capsys.readouterr().out
    x, y, z = recording.X.translation
    assert f"{x:.2f} {y:.2f} {z:.2f} mm" in out
    for what in ("base_from_camera", "leave-one-out", "8 of 8 used", "verdict"):
        assert what in out


def test_the_summary_names_units(tmp_path, recording):
    rows = dict(solve_dataset(recording.write_points(tmp_path)).summary_rows())
    assert "deg" in rows["leave-one-out"]
    assert "mm" in rows["leave-one-out"]
    assert rows["samples"] == "8 of 8 used"


CHARUCO = (
    "[target]",
    'type = "charuco"',
    "columns = 6",
    "rows = 5",
    "square_mm = 25.0",
    "marker_mm = 18.0",
    'dictionary = "5x5_100"',
)


def picture(recording, camera_from_target, px_per_mm=8):
    """The board as the camera sees it; the drawing's (0, 0) pixel corner is the target's origin."""
    board = cv2.aruco.CharucoBoard(
        (6, 5), 25.0, 18.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    margin = 20 * px_per_mm
    drawing = cv2.copyMakeBorder(
        board.generateImage((150 * px_per_mm, 125 * px_per_mm)),
        *[margin] * 4,
        cv2.BORDER_CONSTANT,
        value=255,
    )
    shift = (0.5 - margin - 0.5) / px_per_mm
    mm_from_drawing = np.array(
        [
            [1 / px_per_mm, 0, shift + 0.5 / px_per_mm],
            [0, 1 / px_per_mm, shift + 0.5 / px_per_mm],
            [0, 0, 1],
        ]
    )
    plane = np.column_stack([camera_from_target.rotation[:, :2], camera_from_target.translation])
    homography = recording.camera.matrix @ plane @ mm_from_drawing
    seen = cv2.warpPerspective(
        drawing, homography, (1260, 940), flags=cv2.INTER_AREA, borderValue=170
    )
    return cv2.GaussianBlur(seen, (0, 0), 0.7)


def test_pictures_give_the_true_transforms_and_an_empty_one_is_named(tmp_path, recording, plain):
    for number, pose in enumerate(recording.seen):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture(recording, pose))
    cv2.imwrite(str(tmp_path / "2.png"), np.full((940, 1260), 120, np.uint8))
    lines = [f'image = "{number}.png"' for number in range(recording.count)]
    result = plain(solve_dataset(recording.write(tmp_path, lines, target=CHARUCO)))
    assert off(result, recording)[0] < 1.0
    assert [s["name"] for s in result["samples"] if not s["used"]] == ["2"]
    assert "0 of 20 corners" in result["samples"][2]["reason"]
    assert result["samples"][2]["mm"] is None
    assert result["verdict"]["findings"][0]["code"] == "target_not_seen"


def test_pictures_that_cannot_be_read_are_all_named(tmp_path, recording):
    for number in range(recording.count):
        (tmp_path / f"{number}.png").write_bytes(b"no picture")
    lines = [f'image = "{number}.png"' for number in range(recording.count)]
    path = recording.write(tmp_path, lines, target=CHARUCO)
    with pytest.raises(ConfigError) as caught:
        solve_dataset(path)
    assert len(caught.value.faults) == recording.count


def test_a_target_seen_too_rarely_is_refused_with_all_reasons(tmp_path, recording):
    for number in range(recording.count):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((94, 126), 120, np.uint8))
    lines = [f'image = "{number}.png"' for number in range(recording.count)]
    path = recording.write(tmp_path, lines, target=CHARUCO)
    with pytest.raises(
        TooFewObservations, match=r"seen in 0 of 8 samples.*8 samples \(0, 1, 2.*7\): no usable"
    ):
        solve_dataset(path)


def test_points_on_a_line_leave_their_sample_out(tmp_path, recording, plain):
    path = recording.write_points(tmp_path)
    lines = (tmp_path / "5.csv").read_text().splitlines()
    (tmp_path / "5.csv").write_text("\n".join(lines[:7]) + "\n")
    result = plain(solve_dataset(path))
    assert not result["samples"][5]["used"]
    assert "one line" in result["samples"][5]["reason"]
    assert result["leave_one_out"]["mm"] < 1e-3


CIRCLES = ("[target]", 'type = "circles"', "columns = 6", "rows = 5", "spacing_mm = 25.0")


def circles(camera, camera_from_target):
    """Picture of dark discs of 8 mm radius."""
    picture = np.full((940, 1260), 235, np.uint8)
    rim = 8 * np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 60)])
    for centre in GRID:
        outline = np.round(camera.project(camera_from_target @ (centre + rim)) * 256)
        cv2.fillPoly(picture, [outline.astype(np.int32)], 20, cv2.LINE_AA, shift=8)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def test_pictures_of_a_circle_grid_give_the_true_transforms(tmp_path, recording, plain):
    for number, pose in enumerate(recording.seen):
        cv2.imwrite(str(tmp_path / f"{number}.png"), circles(recording.camera, pose))
    lines = [f'image = "{number}.png"' for number in range(recording.count)]
    result = plain(solve_dataset(recording.write(tmp_path, lines, target=CIRCLES)))
    assert Pose.from_matrix(result["base_from_camera"]).distance(recording.X)[0] < 1.0


def test_a_grid_without_direction_is_turned_as_the_robot_says(make_recording):
    recording = make_recording(count=12)
    reversed_ones = np.random.default_rng(1).random(12) < 0.5
    seen = [
        BoardObservation(GRID, uv[::-1] if turned else uv, len(GRID))
        for uv, turned in zip(recording.pixels(), reversed_ones, strict=True)
    ]
    turned = turn_alike(recording.robot, seen, recording.camera)
    alike = [
        np.array_equal(board.pixels, uv)
        for board, uv in zip(turned, recording.pixels(), strict=True)
    ]
    assert 0 < reversed_ones.sum() < 12
    assert all(alike) or not any(alike)


def test_a_single_tag_is_enough(tmp_path, make_recording, plain):
    recording = make_recording(count=12)
    corners = np.array([(0, 0, 0), (60, 0, 0), (60, 60, 0), (0, 60, 0)], dtype=float)
    rng = np.random.default_rng(0)
    pixels = [
        recording.camera.project(pose @ corners) + rng.normal(0, 0.05, (4, 2))
        for pose in recording.seen
    ]
    path = recording.write_points(tmp_path, pixels=pixels, points=corners)
    assert off(plain(solve_dataset(path)), recording)[0] < 2.0
