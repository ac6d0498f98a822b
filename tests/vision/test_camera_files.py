"""Camera files of others are read as they were meant, and ours are read by OpenCV."""

import json
import re

import cv2
import numpy as np
import pytest
import yaml

from vgrd.errors import InputError
from vgrd.geometry.camera import CameraModel
from vgrd.vision.intrinsics.camera_files import Kind, read_camera, write_camera

K = np.array([[1352.02747, 0, 789.67065], [0, 1356.14287, 627.2995], [0, 0, 1]])
SIZE = (1600, 1200)
D = {
    0: [],
    4: [-0.08, 0.1, 2e-4, -1e-4],
    5: [-0.08, 0.1, 2e-4, -1e-4, 0.02],
    8: [-0.08, 0.1, 2e-4, -1e-4, 0.02, 0.01, -0.02, 0.003],
}
ROS = """\
image_width: 1600
image_height: 1200
camera_name: mako/left
camera_matrix:
  rows: 3
  cols: 3
  data: [1352.02747, 0, 789.67065,
         0, 1356.14287, 627.2995, 0, 0, 1]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {data}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""


def assert_same(camera, distortion, size=SIZE):
    np.testing.assert_allclose(camera.matrix, K)
    np.testing.assert_allclose(camera.distortion, distortion)
    assert camera.size_px == size


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
@pytest.mark.parametrize("count", [4, 5, 8])
def test_what_opencv_writes_is_read_exactly(tmp_path, suffix, count):
    path = tmp_path / f"camera{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sun 22 Nov 2026")
    storage.write("image_Width", SIZE[0])
    storage.write("image_Height", SIZE[1])
    storage.write("Camera_Matrix", K)
    storage.write("Distortion_Coefficients", np.array(D[count])[:, None])
    storage.release()
    assert_same(read_camera(path), D[count])


@pytest.mark.parametrize(("model", "count"), [("plumb_bob", 5), ("rational_polynomial", 8)])
def test_ros_camera_info_is_read(tmp_path, model, count):
    path = tmp_path / "info.yaml"
    path.write_text(ROS.format(model=model, count=count, data=D[count]))
    assert_same(read_camera(path), D[count])


@pytest.mark.parametrize("kind", ["opencv", "ros", "toml"])
@pytest.mark.parametrize("count", sorted(D))
def test_what_we_write_we_read_to_the_last_digit(tmp_path, kind: Kind, count):
    path = tmp_path / ("camera.toml" if kind == "toml" else "camera.yaml")
    camera = CameraModel(K + np.diag([1e-11, 1e-12, 0]), np.array(D[count]), SIZE)
    write_camera(path, camera, kind)
    again = read_camera(path)
    np.testing.assert_array_equal(again.matrix, camera.matrix)
    padded = np.zeros(8)
    padded[: len(D[count])] = D[count]
    np.testing.assert_array_equal(np.append(again.distortion, np.zeros(8))[:8], padded)
    assert again.size_px == SIZE


def test_our_ros_file_is_yaml_with_the_keys_of_camera_info(tmp_path):
    path = tmp_path / "info.yaml"
    write_camera(path, CameraModel(K, np.array(D[4]), SIZE), "ros", "left")
    data = yaml.safe_load(path.read_text())
    assert data["distortion_model"] == "plumb_bob"
    assert data["distortion_coefficients"]["data"] == [*D[4], 0]
    assert data["projection_matrix"]["cols"] == 4
    assert data["camera_name"] == "left"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("kalibr.yaml", "cam0: {distortion_model: radtan, intrinsics: [1352.02747, 1356.14287, "
         f"789.67065, 627.2995], resolution: [1600, 1200], distortion_coeffs: {D[4]}}}"),
        ("echo.yaml", f"width: 1600\nheight: 1200\nK: {K.ravel().tolist()}\nD: {D[4]}\n"),
        ("plain.json", json.dumps({"K": K.tolist(), "dist": D[4], "image_size": SIZE})),
        ("cell.toml", "[cell]\nname='a'\n[camera]\ndriver='aravis'\nmatrix=[1352.02747, 1356.14287, "
         f"789.67065, 627.2995]\ndistortion={D[4]}\nsize_px=[1600, 1200]\n"),
    ],
)  # fmt: skip
def test_other_common_forms_are_read(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert_same(read_camera(tmp_path / name), D[4])


@pytest.mark.parametrize("count", [12, 14])
def test_thin_prism_and_tilt_are_expressed_within_a_fiftieth_of_a_pixel(tmp_path, count):
    tail = [1e-5, -2e-5, 3e-5, 1e-5, 1e-4, -1e-4][: count - 8]
    distortion = np.array([*D[5], 0, 0, 0, *tail])
    path = tmp_path / "camera.yaml"
    path.write_text(ROS.format(model="rational_polynomial", count=count, data=distortion.tolist()))
    camera = read_camera(path)
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.5, -0.4, 1], [0.5, 0.4, 1.0001], (300, 3))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, distortion)[0][:, 0]
    inside = ((expected > 0) & (expected < SIZE)).all(1)
    np.testing.assert_allclose(camera.project(points)[inside], expected[inside], atol=0.02)


def test_zeros_after_the_eighth_number_are_nothing(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS.format(model="plumb_bob", count=14, data=[*D[8], 0, 0, 0, 0, 0, 0]))
    assert_same(read_camera(path), D[8])


def test_the_size_of_the_picture_is_used_where_the_file_tells_none(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(f"K: {K.ravel().tolist()}\nD: []\n")
    assert_same(read_camera(path, (640, 480)), [], (640, 480))
    with pytest.raises(InputError, match="add image_width and image_height"):
        read_camera(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ROS.format(model="equidistant", count=4, data=D[4]), "'equidistant' is not known here"),
        ("%YAML:1.0\n---\nfisheye_model: 1\ncamera_matrix: [1,1,1,1]\n", "'fisheye' is not known"),
        (ROS.format(model="plumb_bob", count=6, data=[1, 2, 3, 4, 5, 6]), "distortion has 6"),
        ("cam0: {K: [1, 1, 1, 1]}\ncam1: {K: [1, 1, 1, 1]}\n", "several cameras: cam0, cam1"),
        ("hello: world\n", "holds no camera matrix"),
        ("just words", "holds no camera"),
        ("a: [1,\n", "not valid"),
        ("%YAML:1.0\n---\na: [1,\n", "not valid"),
        ("K: [1, 2]\nwidth: 4\nheight: 3\n", "has 2 numbers"),
        ("K: [-1, 1, 1, 1]\nwidth: 4\nheight: 3\n", "fx, fy > 0"),
        ("K: [a, 1, 1, 1]\nwidth: 4\nheight: 3\n", "numbers are needed"),
        ("K: [1e308, 1e308, 1e308, 1e308]\nimage_size: [640, 480]\n", "cx = 1e+308 px lies far outside"),
        ("K: [1.23, 615.6, 318, 241]\nimage_size: [640, 480]\n",
         "K: fx = 1.23 is no focal length of a picture 640 px wide (64 to 64000 px): in mm, or as a share"),
        ("K: [615.6, 123, 318, 241]\nimage_size: [640, 480]\n", "fx = 615.6 and fy = 123 px differ"),
        ("K: [615.6, 615.6, 318, 241]\nD: [5e9, 1, 1, 1]\nimage_size: [640, 480]\n",
         "D: [5e+09, 1, 1, 1] has no ray for pixels half-way"),
        ("K: [9, 9, 1, 1]\nimage_size: [4.5, 3]\n", "two whole numbers"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_told_with_the_files_name(tmp_path, text, message):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(message)) as told:
        read_camera(path)
    assert str(path) in str(told.value)
