"""Holes that the pictures show beside the target count as observations of the hand-eye."""

import numpy as np
import pytest

from vgrd.errors import ConfigError
from vgrd.geometry import Pose
from vgrd.model import Mount
from vgrd.solving.datasets import load_dataset, solve_dataset

MOUNTS = pytest.mark.parametrize("mount", list(Mount))
SMALL = np.array([(0.0, 0, 0), (24, 0, 0), (24, 24, 0), (0, 24, 0)])
HOLES = {"h1": (90.0, -40.0, 0.0), "h2": (-70.0, 50.0, 8.0), "h3": (40.0, 95.0, -5.0)}


def write(recording, folder, *, given=(), holes=HOLES, sigma_px=0.0, seed=1, seen_in=99):
    """A small tag and the holes, in every sample or in the first `seen_in`; `given`: known places."""
    rng = np.random.default_rng(seed)
    pixels, lines = [], []
    for i, pose in enumerate(recording.seen):
        pixels.append(recording.camera.project(pose @ SMALL) + rng.normal(0, sigma_px, (4, 2)))
        shown = {}
        for name, at in holes.items():
            uv = recording.camera.project(pose @ np.array([at]))[0] + rng.normal(0, sigma_px, 2)
            shown[name] = uv.tolist()
        cut = {} if i >= seen_in else shown
        lines.append("features = {" + ", ".join(f"{n} = {uv}" for n, uv in cut.items()) + "}")
    path = recording.write_points(folder, pixels=pixels, points=SMALL)
    text = path.read_text()
    for i, line in enumerate(lines):
        text = text.replace(f'points = "{i}.csv"', f'points = "{i}.csv"\n{line}')
    for name, at in holes.items():
        place = f"\npoint_mm = {list(at)}" if name in given else ""
        text += f'[[feature]]\nname = "{name}"{place}\n'
    path.write_text(text)
    return path


def rms_off(make_recording, folder, **options):
    """Rms error, mm, of the camera's place over seeds, 0.1 px noise."""
    squares = []
    for seed in (0, 3):
        recording = make_recording(seed=seed)
        solution = solve_dataset(write(recording, folder, sigma_px=0.1, seed=seed, **options))
        squares.append(solution.mount_from_camera.distance(recording.X)[0] ** 2)
    return float(np.sqrt(np.mean(squares)))


@MOUNTS
def test_holes_of_unknown_place_are_found_along_with_the_transforms(
    tmp_path, make_recording, plain, mount
):
    recording = make_recording(mount)
    solution = solve_dataset(write(recording, tmp_path, given=["h2"]))
    result = plain(solution)
    assert set(result["features"]) == set(HOLES)
    for name, at in result["features"].items():
        np.testing.assert_allclose(at, HOLES[name], atol=1e-2)
    assert solution.mount_from_camera.distance(recording.X)[0] < 1e-2
    assert solution.mount_from_target.distance(recording.Y)[1] < 1e-5
    assert "feature h1" in dict(solution.summary_rows())
    assert result["target_scale"]["value"] == pytest.approx(1, abs=1e-4)


def test_holes_improve_the_hand_eye_of_a_small_tag_known_places_most(tmp_path, make_recording):
    none = rms_off(make_recording, tmp_path, holes={})
    unknown = rms_off(make_recording, tmp_path)
    known = rms_off(make_recording, tmp_path, given=list(HOLES))
    assert unknown < none
    assert known < none


def test_a_sample_whose_pose_is_wrong_does_not_spoil_the_holes(tmp_path, make_recording):
    recording = make_recording(count=7)
    recording.robot[4] = Pose.from_rotvec([0.1, 0.2, 0], [30, 40, 10]) @ recording.robot[4]
    solution = solve_dataset(write(recording, tmp_path))
    assert [s.name for s in solution.samples if not s.used] == ["4"]
    np.testing.assert_allclose(solution.features["h1"], HOLES["h1"], atol=0.1)


def test_a_hole_that_is_left_in_one_sample_does_not_stop_the_others(tmp_path, make_recording):
    recording = make_recording()
    solution = solve_dataset(write(recording, tmp_path, seen_in=2))
    assert solution.mount_from_camera.distance(recording.X)[0] < 0.1
    assert np.isfinite(solution.leave_one_out.mm)


CIRCLES = '[target]\ntype = "circles"\ncolumns = 2\nrows = 2\nspacing_mm = 24.0\n[poses]'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "h1"', 'name = "h2"', "feature: the name 'h2' is given twice"),
        ('name = "h1"', 'name = "h11"', "'0'.features: 'h1' is no feature, did you mean 'h11'"),
        ('name = "h1"', 'name = "h1"\npoint = [0, 0, 0]', "feature[0].point: unknown key"),
        ('name = "h1"', 'name = "h1"\npoint_mm = [0.0, 0.0]', "feature[0].point_mm: List should"),
        ("features = {h1 = [", "features = {h1 = [1.0, ", "'0'.features.h1: List should have"),
        ('name = "h1"', 'name = "h4"', "feature 'h4': seen in 0 samples and its place is not"),
        ("[poses]", CIRCLES, "feature 'h3'.point_mm: the target looks the same after a half turn"),
    ],
)
def test_faults_of_features_are_named_with_the_remedy(tmp_path, recording, old, new, message):
    path = write(recording, tmp_path, given=["h3"])
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_dataset(path)
    assert any(message in fault for fault in caught.value.faults), caught.value.faults


def test_pixels_beside_matrices_are_a_fault(tmp_path, recording):
    path = recording.write_matrices(tmp_path)
    text = path.read_text().replace("[[sample]]", '[[feature]]\nname = "a"\n[[sample]]', 1)
    text = text.replace('name = "0"', 'name = "0"\nfeatures = {a = [1.0, 2.0]}')
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_dataset(path)
    assert any("pixels need image or points" in fault for fault in caught.value.faults)
