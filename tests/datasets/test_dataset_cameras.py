"""A dataset names its camera file, or holds what `vgrd camera` writes."""

import json

import cv2
import numpy as np
import pytest

from vgrd.errors import ConfigError
from vgrd.solving.datasets import load_dataset, solve_dataset
from vgrd.vision.intrinsics.camera_files import camera_toml

CAMERAS = {
    "left": {"K": [[1, 0, 1], [0, 1, 1], [0, 0, 1]], "size": [2, 2]},
    "right": {"K": [[1400.0, 0, 630], [0, 1405.0, 470], [0, 0, 1]], "size": [1260, 940]},
}


def with_camera(path, lines):
    """The dataset with another [camera] table."""
    text = path.read_text()
    start, end = text.index("[camera]"), text.index("[poses]")
    path.write_text(text[:start] + lines + text[end:])
    return path


def test_the_camera_file_is_named_from_the_datasets_folder(tmp_path, recording):
    path = recording.write_points(tmp_path)
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "cameras.json").write_text(json.dumps(CAMERAS))
    with_camera(path, '[camera]\nfile = "rig/cameras.json"\nname = "right"\nrefine = true\n')
    dataset = load_dataset(path)
    np.testing.assert_array_equal(dataset.camera.matrix, recording.camera.matrix)
    assert dataset.refine


def test_what_vgrd_camera_writes_is_pasted_as_it_is(tmp_path, recording):
    path = with_camera(recording.write_points(tmp_path), camera_toml(recording.camera))
    camera = load_dataset(path).camera
    np.testing.assert_array_equal(camera.matrix, recording.camera.matrix)
    assert camera.size_px == (1260, 940)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('file = "cameras.json"', "several cameras: left, right; choose with --camera-name, or name"),
        ('file = "cameras.json"\nname = "up"', "holds no camera named 'up'; its cameras: left, right"),
        ('file = "none.yaml"', "none.yaml: no such file"),
        ('file = "."', "cannot be read: it is a folder"),
        ('file = "cameras.json"\nmatrix = [1, 1, 1, 1]', "keep one of them"),
        ('matrix = [1, 1, 1, 1]\nname = "left"', "name 'left' is of a camera in a file"),
        ("refine = true", "matrix is missing: add matrix = [fx, fy, cx, cy], or file"),
        ("matrix = [1e308, 1e308, 640, 480]", "matrix: fx = 1e+308 is no focal length (10 to 1e+06 px)"),
        ("matrix = [1.4, 1.4, 640, 480]", "fx = 1.4 is no focal length (10 to 1e+06 px): in mm, or as a share"),
        ("matrix = [1400, 1400, 640, 480]\ndistortion = [5e9, 1, 1, 1]", "distortion: [5e+09, 1, 1, 1] has no ray"),
        ("matrix = [1, 1, 1, 1]\nsize_px = [0, 3]", "camera.size_px.0: Input should be greater"),
    ],
)  # fmt: skip
def test_a_fault_of_the_camera_is_named(tmp_path, recording, lines, message):
    (tmp_path / "cameras.json").write_text(json.dumps(CAMERAS))
    path = with_camera(recording.write_points(tmp_path), f"[camera]\n{lines}\n")
    with pytest.raises(ConfigError) as told:
        load_dataset(path)
    (fault,) = told.value.faults
    assert message in fault


def with_pictures(folder, recording, sizes, lines):
    """A dataset of blank pictures (width, height)."""
    for number, (width, height) in enumerate(sizes):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((height, width), 128, np.uint8))
    seen = [f'image = "{number}.png"' for number in range(len(sizes))]
    target = ('[target]\ntype = "chessboard"\ncolumns = 9\nrows = 6\nsquare_mm = 20.0',)
    return with_camera(recording.write(folder, seen, target=target), lines)


def test_a_picture_of_another_size_than_the_camera_file_is_named(tmp_path, recording):
    (tmp_path / "cameras.json").write_text(json.dumps(CAMERAS))
    lines = '[camera]\nfile = "cameras.json"\nname = "right"\n'
    sizes = [(1260, 940)] * 7 + [(630, 470)]
    with pytest.raises(ConfigError) as told:
        solve_dataset(with_pictures(tmp_path, recording, sizes, lines))
    (fault,) = told.value.faults
    assert "'7'" in fault
    assert "has 630 x 470 px, the camera has 1260 x 940: give the camera file" in fault


def test_a_camera_file_without_a_size_takes_that_of_the_pictures(tmp_path, recording):
    (tmp_path / "camera.json").write_text(json.dumps({"K": CAMERAS["right"]["K"]}))
    path = with_pictures(
        tmp_path, recording, [(1260, 940)] * 8, '[camera]\nfile = "camera.json"\n'
    )
    assert load_dataset(path).camera.size_px == (1260, 940)
