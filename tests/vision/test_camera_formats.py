"""Camera files of many programs are read as those programs mean them, or refused with the key named."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.vision.intrinsics.camera_files import read_camera

CASES = Path(__file__).parents[3] / "shared" / "data" / "cases" / "cameras"
F = (615.3, 615.6)
C = (318.2, 241.7)
K = [615.3, 0.0, 318.2, 0.0, 615.6, 241.7, 0.0, 0.0, 1.0]
D = [0.05, -0.12, 0.001, -0.0005, 0.03]
SIZE = (640, 480)


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


def assert_is(camera, distortion=(), size=SIZE):
    np.testing.assert_allclose(camera.matrix, np.reshape(K, (3, 3)))
    np.testing.assert_allclose(camera.distortion, distortion)
    assert camera.size_px == size


FORMS = {
    "ros1 echo": ("a.yaml", f"header:\n  seq: 3\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
        f"D: {D}\nK: {K}\nR: [1.0, 0, 0, 0, 1, 0, 0, 0, 1]\nP: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n"
        "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  height: 0\n  do_rectify: False\n---\n"),
    "ros2 echo, two messages": ("a.yaml", 2 * (f"height: 480\nwidth: 640\nd: {D}\nk: {K}\n---\n")),
    "kalibr": ("a.yaml", f"cam0:\n  camera_model: pinhole\n  intrinsics: [{F[0]}, {F[1]}, {C[0]}, {C[1]}]\n"
        f"  distortion_model: radtan\n  distortion_coeffs: {D}\n  resolution: [640, 480]\n"
        "  T_cam_imu: [[1, 0], [0, 1]]\n  timeshift_cam_imu: 0.1\n  rostopic: /fisheye/image\n"),
    "realsense": ("a.json", json.dumps({"width": 640, "height": 480, "fx": F[0], "fy": F[1], "ppx": C[0],
        "ppy": C[1], "model": "distortion.brown_conrady", "coeffs": D})),
    "orb-slam": ("a.yaml", "%YAML:1.0\n---\nCamera.type: \"PinHole\"\nCamera.fx: 615.3\nCamera.fy: 615.6\n"
        "Camera.cx: 318.2\nCamera.cy: 241.7\nCamera.k1: 0.05\nCamera.k2: -0.12\nCamera.p1: 0.001\n"
        "Camera.p2: -0.0005\nCamera.k3: 0.03\nCamera.width: 640\nCamera.height: 480\nCamera.fps: 30.0\n"
        "Camera.bf: 40.0\nORBextractor.nFeatures: 1000\n"),
    "camodocal": ("a.yaml", "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: c\nimage_width: 640\n"
        "image_height: 480\ndistortion_parameters:\n   k1: 0.05\n   k2: -0.12\n   p1: 0.001\n   p2: -0.0005\n"
        "   k3: 0.03\nprojection_parameters:\n   fx: 615.3\n   fy: 615.6\n   cx: 318.2\n   cy: 241.7\n"),
    "zivid": ("a.yml", "__version__: 2\nCameraIntrinsics:\n  CameraMatrix: {CX: 318.2, CY: 241.7, FX: 615.3, "
        "FY: 615.6}\n  Distortion: {K1: 0.05, K2: -0.12, K3: 0.03, P1: 0.001, P2: -0.0005}\n"),
    "own names": ("a.yaml", f"camera_matrix: {K}\ndist_coeff: [{D}]\nreprojection_error: 0.06\n"
        "image_width: 640\nimage_height: 480\n"),
    "distortion beside the numbers": ("a.json", json.dumps({"intrinsics": {"fx": F[0], "fy": F[1],
        "cx": C[0], "cy": C[1]}, "distortion": dict(zip(("k1", "k2", "p1", "p2", "k3"), D, strict=True)),
        "resolution": {"width": 640, "height": 480}})),
    "with a mark of byte order": ("a.json", "\ufeff" + json.dumps({"K": K, "D": D, "size": SIZE})),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_the_file_is_read_as_its_program_means_it(tmp_path, form):
    assert_is(read_camera(written(tmp_path, *FORMS[form]), SIZE), D)


def test_what_tells_nothing_of_the_lens_does_no_harm(tmp_path):
    text = (
        f"K: {K}\nD: null\nwidth: 640\nheight: 480\nlens: Fujinon HF12\nmodel_name: acA1300\n"
        "camera_id: 3\nfocal_length_mm: 12.0\nper_view_errors: [0.1, 0.2]\nboard_width: 9\n"
        "flags: 0\nrvecs: [[1, 2, 3]]\nnew_camera_matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
    )
    assert_is(read_camera(written(tmp_path, "a.yaml", text)))


def test_open3d_writes_column_by_column(tmp_path):
    flat = np.reshape(K, (3, 3)).T.ravel().tolist()
    text = json.dumps({"width": 640, "height": 480, "intrinsic_matrix": flat})
    assert_is(read_camera(written(tmp_path, "a.json", text)))
    inside = json.dumps({"class_name": "PinholeCameraParameters", "extrinsic": [1.0] * 16,
                         "intrinsic": json.loads(text), "version_major": 1})  # fmt: skip
    assert_is(read_camera(written(tmp_path, "b.json", inside)))
    other = json.dumps({"width": 640, "height": 480, "K": flat})
    with pytest.raises(InputError, match="K: is written column by column"):
        read_camera(written(tmp_path, "c.json", other))


def test_an_npz_of_the_usual_names_is_read(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, mtx=np.reshape(K, (3, 3)), dist=[D], ret=0.3, rvecs=np.zeros((3, 3, 1)))
    assert_is(read_camera(path, SIZE), D)
    with pytest.raises(InputError, match=r"does not tell the picture's size: .*--size-px"):
        read_camera(path)


def test_utf_16_as_powershell_writes_it_is_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(FORMS["ros1 echo"][1], encoding="utf-16")
    assert_is(read_camera(path), D)


def test_of_several_cameras_one_is_chosen_by_name(tmp_path):
    one = "camera_model: pinhole, intrinsics: [615.3, 615.6, 318.2, 241.7], resolution: [640, 480]"
    text = f"cam0: {{{one}, distortion_coeffs: [1, 2, 3, 4]}}\ncam1: {{{one}, distortion_coeffs: {D}}}\n"
    path = written(tmp_path, "chain.yaml", text)
    assert_is(read_camera(path, name="cam1"), D)
    with pytest.raises(
        InputError, match=r"several cameras: cam0, cam1; choose with --camera-name"
    ):
        read_camera(path)
    with pytest.raises(InputError, match=r"no camera named 'cam2'; its cameras: cam0, cam1"):
        read_camera(path, name="cam2")


def test_a_stereo_file_holds_two_cameras(tmp_path):
    other = [600.0, 0, 300, 0, 600, 200, 0, 0, 1]
    text = json.dumps({"M1": other, "D1": [0.1] * 5, "M2": K, "D2": D, "image_size": SIZE, "R": K})
    path = written(tmp_path, "stereo.json", text)
    assert_is(read_camera(path, name="M2"), D)
    with pytest.raises(InputError, match="several cameras: M1, M2"):
        read_camera(path)


def test_a_binned_region_of_the_sensor_keeps_rays_on_their_pixels(tmp_path):
    text = (
        f"height: 480\nwidth: 640\nD: {D}\nK: {K}\nbinning_x: 2\nbinning_y: 2\n"
        "roi: {x_offset: 40, y_offset: 20, width: 400, height: 300, do_rectify: false}\n"
    )
    camera = read_camera(written(tmp_path, "a.yaml", text))
    assert camera.size_px == (200, 150)
    points = np.array([[0.05, -0.03, 1.0], [-0.2, 0.1, 1.2]])
    whole, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.reshape(K, (3, 3)), np.array(D)
    )
    corner = whole[:, 0] + 0.5 - (40, 20)  # counted from the region's rim
    np.testing.assert_allclose(camera.project(points), corner / 2 - 0.5, atol=1e-9)


@pytest.mark.parametrize("model", ["inverse_brown_conrady", "modified_brown_conrady"])
def test_realsense_lenses_are_expressed_as_librealsense_projects(tmp_path, model):
    small = [0.05, -0.08, 4e-4, -3e-4, 0.02]
    text = json.dumps({"width": 640, "height": 480, "fx": F[0], "fy": F[1], "ppx": C[0], "ppy": C[1],
                       "model": model, "coeffs": small})  # fmt: skip
    camera = read_camera(written(tmp_path, "a.json", text))
    rng = np.random.default_rng(1)
    ray_or_pixel = rng.uniform((-0.4, -0.3), (0.4, 0.3), (200, 2))
    x, y = ray_or_pixel.T
    k1, k2, p1, p2, k3 = small
    r2 = x**2 + y**2
    f = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    if model.startswith("inverse"):  # rs2_deproject_pixel_to_point
        rays = np.column_stack([x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                                y * f + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)])  # fmt: skip
        pixels = ray_or_pixel * F + C
    else:  # rs2_project_point_to_pixel
        rays = ray_or_pixel
        x, y = x * f, y * f
        pixels = np.column_stack([x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                                  y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)]) * F + C  # fmt: skip
    inside = ((pixels > 0) & (pixels < SIZE)).all(1)
    found = camera.project(np.column_stack([rays, np.ones(len(rays))]))
    np.testing.assert_allclose(found[inside], pixels[inside], atol=0.03)


HEAD = f"camera_matrix: {K}\nimage_width: 640\nimage_height: 480\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + f"dist_numbers: {D}\n", "key 'dist_numbers' is not understood"),
        (HEAD + "radial_distortion: [0.1, 0.2]\n", "key 'radial_distortion' is not understood"),
        (HEAD + "kappa: 0.1\n", "key 'kappa' is not understood"),
        (HEAD + "distortion: {k1: 0.1, k9: 0.2}\n", "distortion.k9: is not understood"),
        (HEAD + f"D: {D}\nk1: 0.1\n", "tells its distortion twice: D and k1"),
        (f"cam: {{K: {K}, size: [640, 480]}}\nlens: {{k1: 0.1}}\n", "key 'lens.k1' is not understood"),
        (HEAD + "camera_model: omni\n", "'omni' is not known here (camera_model)"),
        ("%YAML:1.0\n---\nCamera.type: \"KannalaBrandt8\"\nCamera1.fx: 1.0\nCamera1.fy: 1.0\n"
         "Camera1.cx: 1.0\nCamera1.cy: 1.0\n", "Camera.type"),
        (f"camera_matrix: {K}\nimage_size: [480, 640]\n"
         .replace("318.2", "518.2"), "are width and height swapped"),
        (f"K: {K}\nD: {D}\n---\nK: {[9.0, *K[1:]]}\nD: {D}\n", "2 messages that differ"),
        ("fx: 1\nfy: 1\n", "lacks cx, cy"),
        ('<?xml version="1.0"?>\n<calibration><f>3</f></calibration>', "XML of another program (<calibration>)"),
        ("a: &a [*a]\n", "not valid"),
        ("", "is empty"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_named(tmp_path, text, message):
    path = written(tmp_path, "a.yaml", text)
    with pytest.raises(InputError, match=re.escape(message)) as told:
        read_camera(path, SIZE if "size" not in text else None)
    assert str(told.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n\0\0\0", "it is a PNG picture"),
        (b"\x80\x04\x95\x10\0", "it is a Python pickle"),
        (b"PK\x03\x04 nothing of it", "a ZIP archive but no NPZ"),
        (b"K: [1]\nname: \xe9t\xe9\n", "byte 0xe9 in line 2 is no UTF-8; save the file as UTF-8"),
    ],
)
def test_a_file_that_is_no_text_is_told_as_what_it_is(tmp_path, content, message):
    path = tmp_path / "a.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message)):
        read_camera(path)


def test_the_cases_of_others_are_read_right_or_refused_with_the_key():
    if not CASES.is_dir():
        pytest.skip(f"{CASES} is not there: it is no part of the repository")
    plain = [0.05, -0.12, 0.001, -0.0005, 0]
    for name, numbers in (
        ("c07_ros1_echo.yaml", plain), ("c08_ros2_echo.yaml", plain), ("c32_camera.npz", plain),
        ("c10_realsense.json", [0] * 5), ("c11_open3d.json", []),
        ("c34_dist_coeff.yaml", [-0.2843, 0.0913, 0.0011, -0.0004, 0]),
        ("c34_distortion_coefficient.yaml", [-0.2843, 0.0913, 0.0011, -0.0004, 0]),
    ):  # fmt: skip
        assert_is(read_camera(CASES / name, SIZE), numbers)
    zivid = read_camera(CASES / "c21_zivid.yml", (1944, 1200))
    np.testing.assert_allclose(zivid.distortion, [-0.0859, 0.1241, 0.000351, -0.000262, -0.0291])
    assert read_camera(CASES / "c30_camera_info_binned.yaml").size_px == (1280, 960)
    second = read_camera(CASES / "c01_kalibr_stereo.yaml", name="cam1")
    np.testing.assert_allclose(second.distortion, [-0.230, 0.0788, 9.2e-05, -0.00052])
