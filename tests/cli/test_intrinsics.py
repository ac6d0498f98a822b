"""`vgrd intrinsics`: from drawn and from real pictures to camera files; `vgrd camera` converts them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.intrinsics.camera_files import read_camera
from vgrd.vision.print.boards import Charuco
from vgrd.vision.print.sheet import MM_PER_INCH, pixels
from vgrd.vision.print.targets import TagGrid, target_sheet

REAL = Path(__file__).parents[3] / "shared" / "data" / "ros-industrial-charuco" / "images"
SIZE = (900, 700)
K = np.array([[1300.0, 0, 460], [0, 1304, 345], [0, 0, 1]])
CAMERA = CameraModel(K, np.zeros(0), SIZE)
CHARUCO = Charuco(7, 5, 30.0, 22.0, "5x5_100")
TAGS = TagGrid("36h11", 4, 3, 40.0, 10.0)
DPI = 200


def pictures(folder, target, count=6):
    """Pictures of the printed target at known poses, drawn with an anti-aliased warp."""
    sheet = target_sheet(target, "bare")
    paper = pixels(sheet, DPI)
    rim = np.array([sheet.rasters[0].x_mm, sheet.rasters[0].y_mm])
    mm_from_px = np.diag([MM_PER_INCH / DPI, MM_PER_INCH / DPI, 1])
    mm_from_px[:2, 2] = 0.5 * MM_PER_INCH / DPI - rim
    rng = np.random.default_rng(3)
    size = np.array([sheet.width_mm, sheet.height_mm]) - 2 * rim
    folder.mkdir()
    for i in range(count):
        axis = 2 * np.pi * i / count
        tilt = 0.55 * np.array([np.cos(axis), np.sin(axis), 0])
        R = (
            Pose.from_rotvec(tilt).rotation
            @ Pose.from_rotvec([0, 0, rng.uniform(-0.4, 0.4)]).rotation
        )
        centre = np.array([*rng.uniform(-25, 25, 2), rng.uniform(430, 480)])
        pose = Pose(R, centre - R @ np.append(size / 2, 0))
        H = K @ np.column_stack([R[:, :2], pose.translation]) @ mm_from_px
        fine = np.array([[3, 0, 1], [0, 3, 1], [0, 0, 1.0]]) @ H
        large = cv2.warpPerspective(
            paper, fine, (3 * SIZE[0], 3 * SIZE[1]), flags=cv2.INTER_AREA, borderValue=235
        )
        drawn = cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
        drawn = cv2.GaussianBlur(drawn, (0, 0), 0.6).astype(float)
        noisy = 20 + 0.8 * drawn + rng.normal(0, 1.5, drawn.shape)
        cv2.imwrite(str(folder / f"{i}.png"), np.rint(noisy).clip(0, 255).astype(np.uint8))


def check(result, sigmas=6.0):
    sigma = result["sigma"]
    for name, value, truth in zip(
        ("fx", "fy", "cx", "cy"), result["matrix"], K[[0, 1, 0, 1], [0, 1, 2, 2]], strict=True
    ):
        assert abs(value - truth) < sigmas * sigma[name]
        assert sigma[name] < 0.01 * truth


def test_a_charuco_board_gives_the_camera_in_three_files_and_a_picture(vgrd, tmp_path):
    pictures(tmp_path / "in", CHARUCO)
    cv2.imwrite(str(tmp_path / "in" / "empty.png"), np.full((700, 900), 90, np.uint8))
    cv2.imwrite(
        str(tmp_path / "in" / "other.png"), cv2.imread(str(tmp_path / "in" / "0.png"))[:600]
    )
    (tmp_path / "in" / "broken.jpg").write_bytes(b"no picture")
    out = tmp_path / "out"
    words = ("--squares", "7x5", "--out", out, "--distortion", 0, "--json", "-")
    result = vgrd("intrinsics", tmp_path / "in", *words).result
    check(result)
    reasons = {p["name"]: p["reason"] for p in result["pictures"] if not p["used"]}
    assert set(reasons) == {"empty.png", "other.png", "broken.jpg"}
    assert "most have 900 x 700" in reasons["other.png"]
    assert result["effect"]["z_mm"] > 0
    for name in ("camera.yaml", "camera_info.yaml", "camera.toml"):
        found = read_camera(out / name)
        np.testing.assert_allclose(found.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], result["matrix"])
        assert found.size_px == SIZE
    assert cv2.imread(str(out / "coverage.png")).shape == (933, 1200, 3)


def test_a_board_of_tags_in_a_file_does_as_well(vgrd, tmp_path):
    pictures(tmp_path / "in", TAGS)
    board = tmp_path / "board.toml"
    board.write_text(
        '[target]\ntype = "tags"\ndictionary = "36h11"\ncolumns = 4\nrows = 3\n'
        "size_mm = 40.0\ngap_mm = 10.0\n"
    )
    report = tmp_path / "report.json"
    words = ("--distortion", 0, "--out", tmp_path / "out", "--json", report)
    done = vgrd("intrinsics", tmp_path / "in", "--board", board, *words)
    assert done.code == 0, done.err
    assert "held_out" in done.out
    assert "1 sigma" in done.out
    check(json.loads(report.read_text()))


def test_published_pictures_of_a_real_board_fit_to_a_twentieth_of_a_pixel(vgrd, tmp_path):
    if not REAL.is_dir():
        pytest.skip(f"{REAL} is not there: it is no part of the repository")
    board = ("--squares", "5x7", "--square-mm", 36.195, "--marker-mm", 18.256)
    words = ("--dictionary", "6x6_250", "--out", tmp_path, "--json", "-")
    result = vgrd("intrinsics", REAL, *board, *words).result
    assert [p["name"] for p in result["pictures"] if not p["used"]] == ["2.png"]
    assert result["rms_px"] < 0.06
    assert result["held_out_px"] < 0.08
    fx, fy, *_ = result["matrix"]
    assert abs(fx / fy - 1) < 3 * (result["sigma"]["fx"] + result["sigma"]["fy"]) / fx
    assert {finding["code"] for finding in result["findings"]} >= {"coverage"}


def test_what_cannot_be_calibrated_is_told_with_the_remedy(vgrd, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    bad = tmp_path / "bad.toml"
    bad.write_text('type = "tags"\ndictionary = "36h11"\ncolums = 4\n')
    for words, code, message in (
        ((tmp_path / "none",), 65, "no such folder"),
        ((empty,), 65, "holds no pictures"),
        ((empty, "--board", "dots"), 65, "ends with .toml"),
        ((empty, "--board", bad), 78, "target.colums: unknown key, did you mean 'columns'"),
        ((empty, "--print-mm", 0), 65, "positive number"),
    ):
        done = vgrd("intrinsics", *words, "--out", tmp_path / "out")
        assert done.code == code
        assert message in done.err
    cv2.imwrite(str(empty / "a.png"), np.full((700, 900), 90, np.uint8))
    done = vgrd("intrinsics", empty, "--out", tmp_path / "out")
    assert "a.png: no usable charuco board" in done.err


def test_camera_files_are_shown_and_converted(vgrd, tmp_path):
    source = tmp_path / "camera.toml"
    source.write_text("matrix = [1300, 1304, 460, 345]\ndistortion = []\nsize_px = [900, 700]\n")
    for name, words in (("a.yaml", ()), ("b.yaml", ("--ros",)), ("c.json", ()), ("d.toml", ())):
        done = vgrd("camera", source, "--out", tmp_path / name, *words, "--json", "-")
        assert done.result["matrix"] == [1300, 1304, 460, 345]
        np.testing.assert_array_equal(read_camera(tmp_path / name).matrix, K)
    assert "camera_name: b" in (tmp_path / "b.yaml").read_text()
    assert vgrd("camera", tmp_path / "none.yaml").code == 65
