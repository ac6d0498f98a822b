"""Programs of robots, Kalibr's target files, cameras without a size: all are read, and nothing is lost in silence."""

import re

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import ConfigError, InputError
from vgrd.importing import import_files
from vgrd.solving.datasets import load_dataset
from vgrd.vision.print.boards import Chessboard, CircleGrid
from vgrd.vision.print.targets import AprilGrid

KALIBR = "target_type: 'aprilgrid'\ntagCols: 5\ntagRows: 4\ntagSize: 0.028\ntagSpacing: 0.3\n"
CHESS = (
    "target_type: checkerboard\ntargetCols: 9\ntargetRows: 6\n"
    "rowSpacingMeters: 0.02\ncolSpacingMeters: 0.02\n"
)
CIRCLES = "target_type: circlegrid\ntargetCols: 7\ntargetRows: 5\nspacingMeters: 0.022\n"
CAMERA = "camera_matrix: [1400, 0, 640, 0, 1400, 480, 0, 0, 1]\ndist_coeffs: [0.1, 0, 0, 0, 0]\n"
SIZED = CAMERA + "image_width: 1280\nimage_height: 960\n"
COUNT = 5


@pytest.fixture
def places():
    """Places (n, 3), mm, and rotations of the flange."""
    rng = np.random.default_rng(3)
    return rng.uniform(200, 600, (COUNT, 3)), Rotation.from_rotvec(rng.normal(0, 1, (COUNT, 3)))


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i in range(COUNT):
        cv2.imwrite(str(folder / f"{i}.png"), np.full((30, 40), 20 * i, np.uint8))
    return folder


def listed(values):
    return ",".join(f"{value:.9f}" for value in values)


def ur(place, turn):
    return f"movel(p[{listed([*place / 1000, *turn.as_rotvec()])}], a=1.2)"


def kuka(place, turn):
    numbers = [*place, *turn.as_euler("ZYX", degrees=True)]
    words = ",".join(f"{key} {value:.9f}" for key, value in zip("XYZABC", numbers, strict=True))
    return f"DECL E6POS XP={{{words},S 2,T 35}}"


def abb(place, turn):
    quaternion = listed(turn.as_quat(scalar_first=True))
    return f"CONST robtarget p:=[[{listed(place)}],[{quaternion}],[0,0,0,0],[9E9,9E9,9E9,9E9]];"


def table(places):
    rows = [listed([*place, *turn.as_rotvec()]) for place, turn in zip(*places, strict=True)]
    return "\n".join(["x [mm],y [mm],z [mm],rotvec_0,rotvec_1,rotvec_2", *rows, ""])


def imported(tmp_path, *files, **said):
    found = import_files(files, said, tmp_path)
    path = tmp_path / "imported.toml"
    path.write_text(found.text)
    return path, " | ".join(found.told)


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


def check(dataset, places):
    for sample, place, turn in zip(dataset.samples, *places, strict=True):
        np.testing.assert_allclose(sample.base_from_wrist.translation, place, atol=1e-5)
        np.testing.assert_allclose(sample.base_from_wrist.rotation, turn.as_matrix(), atol=1e-6)


@pytest.mark.parametrize(
    ("write", "name"), [(ur, "ur.script"), (kuka, "kuka.dat"), (abb, "abb.mod"), (ur, "ur.txt")]
)
def test_poses_of_programs_are_read(tmp_path, places, pictures, write, name):
    lines = ["! written by hand", *(write(*pose) for pose in zip(*places, strict=True)), "END", ""]
    program = written(tmp_path, name, "\n".join(lines))
    camera, board = written(tmp_path, "c.yaml", SIZED), written(tmp_path, "b.yaml", KALIBR)
    path, told = imported(tmp_path, program, pictures, camera, board)
    check(load_dataset(path), places)
    assert f"{program}: {COUNT} " in told
    assert "it has to be the flange" in told


@pytest.mark.parametrize(
    ("text", "target"),
    [
        (KALIBR, AprilGrid("36h11_border2", 5, 4, 28.0, 8.4)),
        (CHESS, Chessboard(9, 6, 20.0)),
        (CIRCLES, CircleGrid(7, 5, 22.0)),
    ],
)
def test_kalibrs_target_file_is_the_target(tmp_path, places, pictures, text, target):
    files = [
        written(tmp_path, "t.csv", table(places)),
        pictures,
        written(tmp_path, "c.yaml", SIZED),
    ]
    path, told = imported(tmp_path, *files, written(tmp_path, "target.yaml", text))
    found = load_dataset(path).target
    assert type(found) is type(target)
    assert (found.columns, found.rows) == (target.columns, target.rows)
    if isinstance(target, AprilGrid):
        assert found.gap_mm == pytest.approx(target.gap_mm)
    else:
        assert found == target
    assert "still missing" not in told


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (KALIBR.replace("tagSize: 0.028\n", ""), "tagSize: None, a number above 0"),
        (KALIBR.replace("tagCols: 5", "tagCols: 5.5"), "tagCols: 5.5, a whole number"),
        (KALIBR.replace("aprilgrid", "assembly"), "target_type 'assembly' is unknown"),
        (CHESS.replace("colSpacingMeters: 0.02", "colSpacingMeters: 0.03"), "squares are needed"),
        (CIRCLES + "asymmetricGrid: true\n", "asymmetricGrid"),
    ],
)
def test_a_fault_of_a_target_file_is_named(tmp_path, text, message):
    path = written(tmp_path, "target.yaml", text)
    with pytest.raises(InputError, match=re.escape(message)) as told:
        import_files([path], {}, tmp_path)
    assert str(path) in str(told.value)


def test_what_is_missing_or_not_used_is_told(tmp_path, places, pictures):
    poses = written(tmp_path, "t.csv", table(places))
    note = written(tmp_path, "note.yaml", "speed: 3\nforce: 4\n")
    path, told = imported(tmp_path, poses, pictures, note)
    assert "still missing: the target; name a board file or Kalibr's target file" in told
    assert "still missing: the camera; name its camera file" in told
    assert f"{note}: not used" in told
    assert "still missing" in path.read_text()
    boards = [written(tmp_path, name, KALIBR) for name in ("a.yaml", "b.yaml")]
    with pytest.raises(InputError, match="is a second board"):
        import_files([poses, pictures, *boards], {}, tmp_path)
    cameras = [written(tmp_path, name, SIZED) for name in ("c.yaml", "d.yaml")]
    with pytest.raises(InputError, match="is a second camera"):
        import_files([poses, pictures, *cameras], {}, tmp_path)


def test_the_size_of_the_pictures_completes_a_camera_file(tmp_path, places):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i in range(COUNT):
        cv2.imwrite(str(folder / f"{i}.png"), np.zeros((960, 1280), np.uint8))
    files = [
        written(tmp_path, "t.csv", table(places)),
        folder,
        written(tmp_path, "b.yaml", KALIBR),
    ]
    path, _ = imported(tmp_path, *files, written(tmp_path, "c.yaml", CAMERA))
    assert load_dataset(path).camera.size_px == (1280, 960)


def test_an_empty_cell_is_named_by_line_and_column(tmp_path, places):
    lines = table(places).splitlines()
    cells = lines[2].split(",")
    lines[2] = ",".join([cells[0], "", *cells[2:]])
    path = written(tmp_path, "t.csv", "\n".join(lines))
    with pytest.raises(InputError, match=re.escape("line 3, column 'y [mm]': the cell is empty")):
        import_files([path], {}, tmp_path)


@pytest.mark.parametrize("head", ["# recorded 2024\n# robot: UR5\n", "# recorded, with care\n\n"])
def test_comments_above_the_header_are_skipped(tmp_path, places, pictures, head):
    files = [pictures, written(tmp_path, "b.yaml", KALIBR), written(tmp_path, "c.yaml", SIZED)]
    for text in (table(places), f"# {table(places)}"):
        path, _ = imported(tmp_path, written(tmp_path, "t.csv", head + text), *files)
        check(load_dataset(path), places)


def test_a_table_where_a_dataset_is_needed_is_told_with_the_command(tmp_path, places):
    path = written(tmp_path, "t.csv", table(places))
    with pytest.raises(ConfigError, match=re.escape(f"vgrd import {path} makes a DATASET.toml")):
        load_dataset(path)


def test_the_option_that_chooses_a_camera_is_named(tmp_path):
    path = written(tmp_path, "c.yaml", "left: {K: [9, 9, 1, 1]}\nright: {K: [9, 9, 1, 1]}\n")
    with pytest.raises(InputError, match=re.escape("--as camera_name=NAME of vgrd import")):
        import_files([path], {}, tmp_path)
