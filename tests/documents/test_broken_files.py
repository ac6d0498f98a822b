"""Whatever a file holds, a reader takes it or says in one line which file, what is wrong; no traceback."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from vgrd.documents.sheets import read_sheet
from vgrd.documents.toml import read_toml
from vgrd.errors import CalibrationError, ConfigError, InputError
from vgrd.importing import import_files
from vgrd.solving.datasets import load_dataset
from vgrd.solving.datasets.boards import load_board
from vgrd.solving.touch_files import solve_touches
from vgrd.vision.images.pictures import read_picture
from vgrd.vision.intrinsics.camera_files import read_camera

K = [615.3, 0.0, 318.2, 0.0, 615.6, 241.7, 0.0, 0.0, 1.0]
CAMERA_YAML = (
    f"image_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: {K}}}\n"
)
OPENCV_YAML = (
    "%YAML:1.0\n---\nimage_width: 640\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    f"   data: {K}\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
    "   data: [ 0.1, 0., 0., 0., 0. ]\n"
)
CAMERA_JSON = json.dumps({"width": 640, "height": 480, "intrinsic_matrix": K, "coeffs": [0.0] * 5})
CAMERA_XML = '<?xml version="1.0"?>\n<opencv_storage><K>1</K></opencv_storage>'
TABLE = "x,y,z,qx,qy,qz,qw,file\n" + "\n".join(
    f"{i},2,{3 * i * i},0,0,0,1,{i}.png" for i in range(5)
)
ENTRIES = json.dumps([{"robot": {"translation": {"x": 1, "y": i, "z": i * i}}} for i in range(4)])
DATASET = (
    'mount = "eye-in-hand"\ntcp_in_wrist = [0, 0, 1]\n[poses]\nunit = "mm"\nrotation = "matrix"\n'
    '[samples]\ntable = "t.csv"\npose = ["x", "y"]\n[camera]\nmatrix = [600, 600, 320, 240]\n'
    '[target]\ntype = "aprilgrid"\ncolumns = 3\nrows = 3\nsize_mm = 20\nspacing = 0.3\n'
    '[[sample]]\nname = "0"\npose = [1, 2, 3]\nrvec = [0, 0, 1]\ntvec = [1, 2, 3]\n'
)
TOUCHES = (
    'kind = "fixed-point"\n[poses]\nunit = "mm"\nrotation = "rotvec"\n'
    + "".join(f'[[touch]]\nname = "{i}"\npose = [100, {i}, 3, 0.{i}, 0, 1]\n' for i in range(4))
)  # fmt: skip
READERS = {
    "camera.yaml": (lambda path: read_camera(path), [CAMERA_YAML, OPENCV_YAML]),
    "camera.json": (lambda path: read_camera(path), [CAMERA_JSON]),
    "camera.xml": (lambda path: read_camera(path), [CAMERA_XML]),
    "camera.npz": (lambda path: read_camera(path, (640, 480)), ["PK\x03\x04"]),
    "camera.toml": (lambda path: read_camera(path), ["[camera]\nmatrix = [1, 1, 1, 1]\n"]),
    "table.csv": (read_sheet, [TABLE]),
    "table.json": (read_sheet, [ENTRIES]),
    "table.yaml": (read_sheet, [CAMERA_YAML, ENTRIES]),
    "import.csv": (lambda path: import_files([path], {}, path.parent), [TABLE]),
    "import.json": (lambda path: import_files([path], {}, path.parent), [ENTRIES, CAMERA_JSON]),
    "import.yaml": (lambda path: import_files([path], {}, path.parent), [CAMERA_YAML, OPENCV_YAML]),
    "dataset.toml": (load_dataset, [DATASET]),
    "board.toml": (load_board, ['type = "charuco"\ncolumns = 5\nrows = 7\nsquare_mm = 20\n']),
    "touches.toml": (solve_touches, [TOUCHES]),
    "points.csv": (None, ["x_mm,y_mm,z_mm,u_px,v_px\n0,0,0,1,1\n9,9,9,2,2\n"]),
    "picture.png": (read_picture, ["\x89PNG\r\n\x1a\n"]),
}  # fmt: skip
JUNK = st.sampled_from(
    [b"nan", b"-inf", b"1e999", b"\0", b"\xff\xfe", b"\xe9", b"[", b"{", b"\"", b"---", b"&a [*a]", b"", b"\r",
     b"!!python/object:os.system", b"9" * 5000, b"[" * 3000, b"\t", b": ", b"<", b"true", b"null", "\u2028".encode()]
)  # fmt: skip


@st.composite
def broken(draw, texts):
    """A good file with something cut, doubled or put in."""
    data = draw(st.sampled_from(texts)).encode("latin-1")
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 12)))
        data = data[:start] + draw(st.one_of(JUNK, st.binary(max_size=6))) + data[end:]
    return data


def points_of(path):
    text = 'mount = "eye-in-hand"\n[poses]\nunit = "mm"\nrotation = "rotvec"\n[camera]\nmatrix = [9, 9, 9, 9]\n'
    for i in range(3):
        text += (
            f'[[sample]]\nname = "{i}"\npose = [100, {i}, 0, 0, 0, 0.{i}]\npoints = "points.csv"\n'
        )
    dataset = path.with_name("d.toml")
    dataset.write_text(text)
    load_dataset(dataset)


def faults_of(reader, path):
    """What the reader tells, sentence by sentence; nothing where it takes the file."""
    try:
        (reader or points_of)(path)
    except ConfigError as error:
        return [f"{error.source}: {fault}" for fault in error.faults]
    except InputError as error:
        return [str(error)]
    except CalibrationError:  # read, and not enough to solve
        return []
    return []


@pytest.mark.parametrize("name", READERS)
@settings(
    derandomize=True,
    max_examples=25,  # 400 in all; the slowest reader takes 0.2 s for one
    deadline=None,
    phases=[Phase.explicit, Phase.generate],  # shrinking takes minutes on a busy machine
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_a_broken_file_is_told(tmp_path, name, data):
    reader, texts = READERS[name]
    path = tmp_path / name
    path.write_bytes(data.draw(broken(texts)))
    for told in faults_of(reader, path):
        assert name in told or "d.toml" in told
        assert "\n" not in told
        assert len(told) < 1500, told


@pytest.mark.parametrize("name", READERS)
def test_a_folder_nothing_and_a_missing_file_are_told(tmp_path, name):
    reader, _ = READERS[name]
    reader = reader or points_of
    for path, word in ((tmp_path / "missing" / name, "no such"), (tmp_path / name, "")):
        path.parent.mkdir(exist_ok=True)
        if not word:
            path.write_bytes(b"")
        with pytest.raises((InputError, ConfigError)) as told:
            reader(path)
        assert name in str(told.value)
        assert word in str(told.value)
    (tmp_path / name).unlink()
    if name.startswith("import"):
        return  # a folder is a place of pictures there
    (tmp_path / name).mkdir()
    with pytest.raises((InputError, ConfigError)) as told:
        reader(tmp_path / name)
    assert name in str(told.value)


@pytest.mark.parametrize("name", ["camera.yaml", "table.csv", "dataset.toml"])
def test_a_file_that_is_far_too_large_is_told_before_it_is_read(tmp_path, name):
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(60_000_000)  # sparse: takes no room
    with pytest.raises((InputError, ConfigError), match="has 60 MB, at most 50 are read"):
        (READERS[name][0])(path)


def test_an_alias_that_multiplies_itself_is_told(tmp_path):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join([*lines, f"K: {K}"]))
    with pytest.raises(InputError, match=r"more than 1000000 values|nested too deeply"):
        read_camera(path, (4, 3))


def test_an_array_of_objects_is_told(tmp_path):
    path = tmp_path / "camera.npz"
    np.savez(path, mtx=np.array([{"a": 1}], dtype=object))
    for reader in (lambda file: read_camera(file, (4, 3)), read_sheet):
        with pytest.raises(InputError, match="no NPZ of plain numbers"):
            reader(path)


def test_the_text_is_read_in_the_encodings_of_windows(tmp_path):
    path = tmp_path / "a.toml"
    for encoding in ("utf-8-sig", "utf-16", "utf-32"):
        path.write_text('name = "\u00e9t\u00e9"\n', encoding=encoding)
        assert read_toml(path, "a list")["name"] == "\u00e9t\u00e9"
    path.write_bytes(b'a = 1\nname = "\xe9"\n')
    with pytest.raises(
        ConfigError, match="byte 0xe9 in line 2 is no UTF-8; save the file as UTF-8"
    ):
        read_toml(path, "a list")
    assert Path(path).exists()
