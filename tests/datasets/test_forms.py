"""Poses and samples are read in the forms in which users have them."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.documents.natural_order import natural_order
from vgrd.documents.sheets import read_sheet
from vgrd.errors import ConfigError, InputError
from vgrd.solving.datasets import load_dataset, solve_dataset


def dataset(tmp_path, head, samples):
    path = tmp_path / "dataset.toml"
    path.write_text("\n".join(['mount = "eye-to-hand"', *head, *samples]) + "\n")
    return path


def matrix(pose, per_mm):
    M = pose.matrix()
    M[:3, 3] *= per_mm
    return M


def same(found, poses):
    for one, other in zip(found, poses, strict=True):
        mm, rad = one.distance(other)
        assert mm < 1e-3
        assert rad < 1e-6


def read(path, recording):
    loaded = load_dataset(path)
    same([s.base_from_wrist for s in loaded.samples], recording.robot)
    same([s.source for s in loaded.samples], recording.seen)
    return loaded


def test_matrices_row_by_row_and_column_by_column_with_units_of_their_own(tmp_path, recording):
    samples = []
    for i, (robot, seen) in enumerate(zip(recording.robot, recording.seen, strict=True)):
        samples += [
            "[[sample]]",
            f'name = "{i}"',
            f"pose = {matrix(robot, 1.0).tolist()}",
            f"camera_from_target = {matrix(seen, 1e-3).T.ravel().tolist()}",
        ]
    head = ["[poses]", 'unit = "mm"', 'rotation = "matrix"', "[camera_poses]", 'unit = "m"']
    path = dataset(tmp_path, [*head, 'rotation = "matrix-columns"'], samples)
    read(path, recording)
    assert solve_dataset(path).verdict.ok
    with pytest.raises(ConfigError, match='column by column: say rotation = "matrix-columns"'):
        load_dataset(dataset(tmp_path, head, samples))


def test_rvec_and_tvec_of_opencv(tmp_path, recording):
    samples = []
    for i, (robot, seen) in enumerate(zip(recording.robot, recording.seen, strict=True)):
        samples += [
            "[[sample]]",
            f'name = "{i}"',
            f"pose = {[*robot.translation.tolist(), *robot.rotvec().tolist()]}",
            f"rvec = {seen.rotvec().tolist()}",
            f"tvec = {[[x] for x in seen.translation.tolist()]}",
        ]
    head = ["[poses]", 'unit = "mm"', 'rotation = "rotvec"']
    path = dataset(tmp_path, head, samples)
    read(path, recording)
    path.write_text(path.read_text().replace("rvec =", "# rvec =", 1))
    with pytest.raises(ConfigError, match="rvec and tvec belong together"):
        load_dataset(path)


HEAD = ["[poses]", 'unit = "m"', 'rotation = "quaternion-wxyz"', "[samples]"]
COLUMNS = [
    'pose = ["x", "y", "z", "qw", "qx", "qy", "qz"]',
    'rvec = ["r1", "r2", "r3"]',
    'tvec = ["t1", "t2", "t3"]',
]


def rows_of(recording):
    for robot, seen in zip(recording.robot, recording.seen, strict=True):
        x, y, z, w = Rotation.from_matrix(robot.rotation).as_quat().tolist()
        yield [*(robot.translation / 1000).tolist(), w, x, y, z,
               *seen.rotvec().tolist(), *(seen.translation / 1000).tolist()]  # fmt: skip


NAMES = ["x", "y", "z", "qw", "qx", "qy", "qz", "r1", "r2", "r3", "t1", "t2", "t3"]


@pytest.mark.parametrize("kind", ["csv", "semicolons", "spaces", "json", "columns", "npz"])
def test_a_table_of_columns_is_read(tmp_path, recording, kind):
    rows = list(rows_of(recording))
    name = {"json": "t.json", "columns": "t.json", "npz": "t.npz"}.get(kind, "t.csv")
    file = tmp_path / name
    if kind == "csv":
        file.write_text("\n".join(",".join(map(str, row)) for row in [NAMES, *rows]))
    elif kind == "semicolons":  # as a German spreadsheet writes it
        lines = [";".join(NAMES)] + [
            ";".join(f"{v:.9f}".replace(".", ",") for v in r) for r in rows
        ]
        file.write_text("\r\n".join(lines), encoding="utf-8-sig")
    elif kind == "spaces":
        np.savetxt(file, rows, header=" ".join(NAMES))
    elif kind == "json":
        entries = [dict(zip(NAMES, row, strict=True)) for row in rows]
        file.write_text(json.dumps({"note": "a", "samples": entries}))
    elif kind == "columns":
        columns = zip(NAMES, np.transpose(rows).tolist(), strict=True)
        file.write_text(json.dumps(dict(columns)))
    else:
        np.savez(
            file, **dict(zip(NAMES, np.transpose(rows), strict=True)), camera_matrix=np.eye(3)
        )
    path = dataset(tmp_path, [*HEAD, f'table = "{name}"', *COLUMNS], [])
    read(path, recording)


def test_pictures_are_paired_in_natural_order(tmp_path, make_recording):
    recording = make_recording(count=11)
    path = recording.write_points(tmp_path)
    text = path.read_text()
    for i in range(11):
        text = text.replace(f'points = "{i}.csv"', "")
    path.write_text(text.replace("[poses]", '[samples]\npoints = "*.csv"\n[poses]', 1))
    loaded = load_dataset(path)
    for sample, uv in zip(loaded.samples, recording.pixels(), strict=True):
        np.testing.assert_allclose(sample.source.pixels, uv, atol=1e-4)
    (tmp_path / "3.csv").unlink()
    with pytest.raises(
        ConfigError, match=r"10 files \(0.csv to 10.csv in natural order\) for 11 "
    ):
        load_dataset(path)


def test_numbers_in_names_are_numbers():
    names = ["img10.png", "img2.png", "img1.png", "b", "img2b.png", "10", "9"]
    assert natural_order(names) == [
        "9",
        "10",
        "b",
        "img1.png",
        "img2.png",
        "img2b.png",
        "img10.png",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,2\n3\n", "line 3: has 1 cells, the header 2"),
        ("x,x\n1,2\n", "column 'x' is there twice"),
        ("", "is empty"),
        ("x,y\n", "holds no rows"),
        ("<a/>", "is XML"),
        ('{"a": [1, 2', "not valid JSON"),
        ("[" * 2000, "nested too deeply"),
    ],
)
def test_a_table_that_cannot_be_read_is_told(tmp_path, text, message):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as told:
        read_sheet(path)
    assert str(told.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (['table = "t.csv"', 'pose = ["x", "yy"]'], "samples: no column 'yy', did you mean 'y'"),
        (['table = "t.csv"'], r"samples: pose is missing: .* columns: x, y"),
        (['table = "t.csv"', 'pose = ["x", "y"]'], r"t.csv line 3, pose: nan is not finite"),
        (['table = "u.csv"', 'pose = ["x", "y"]'], "u.csv: no such file"),
        (['tabel = "t.csv"'], "samples.tabel: unknown key, did you mean 'table'"),
        (['images = "*.png"'], r"images '\*.png': no such file"),
        (['images = "/etc/*"'], "is no pattern below the dataset's folder"),
    ],
)
def test_a_fault_of_the_table_is_named(tmp_path, lines, message):
    (tmp_path / "t.csv").write_text("x,y\n1,2\nnan,3\n")
    with pytest.raises(ConfigError, match=message):
        load_dataset(dataset(tmp_path, [*HEAD, *lines], []))
