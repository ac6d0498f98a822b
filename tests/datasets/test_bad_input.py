"""Every fault of a dataset is named with key and remedy, all at once, before anything is solved."""

import pytest

from vgrd.errors import ConfigError
from vgrd.geometry import Pose
from vgrd.solving.datasets import load_dataset


def faults(path):
    """The faults of a dataset, each a line."""
    with pytest.raises(ConfigError) as caught:
        load_dataset(path)
    assert str(path) in str(caught.value)
    return caught.value.faults


def with_text(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('mount = "eye-to-hand"', 'mount = "eye-to-hands"', "did you mean 'eye-to-hand'"),
        ('mount = "eye-to-hand"', "", "mount: is missing"),
        (
            "refine = false",
            "refined = false",
            "camera.refined: unknown key, did you mean 'refine'",
        ),
        ("refine = false", 'refine = "no"', "camera.refine: Input should be a valid boolean"),
        ("refine = false", "distortion = [1, 2, 3]", "camera: distortion has 3 numbers"),
        ("matrix = [1400.0", "matrix = [-1400.0", "camera: a camera matrix is"),
        ("matrix = [1400.0, ", "matrix = [", "camera.matrix: List should have at least 4 items"),
        ("matrix = [1400.0", "matrix = [nan", "camera.matrix.0: Input should be a finite number"),
        ('unit = "m"', 'unit = "cm"', "poses.unit: 'cm' is unknown"),
        ('unit = "m"', 'unit = "mm"', "poses.unit: in mm no flange is more than"),
        ('unit = "m"\n', "", "poses.unit: is missing, add it"),
        ("[poses]", "[pose]", "pose: unknown key, did you mean 'poses'"),
        ('"quaternion-xyzw"', '"quaternion-xzyw"', "did you mean 'quaternion-xyzw'"),
        ('"quaternion-xyzw"', '"rotvec"', r"'0'.pose: a pose with rotation rotvec has 6 numbers"),
        ('points = "2.csv"', 'points = "22.csv"', r"sample[2] '2'.points: no such file"),
        ('points = "2.csv"', 'point = "2.csv"', r"sample[2] '2'.point: unknown key, did you mean"),
        ('points = "2.csv"', "", r"sample[2] '2': needs exactly one of image, points"),
        ('points = "2.csv"', 'points = "2.csv"\nimage = "2.csv"', "has image and points"),
        ('points = "2.csv"', 'image = "2.csv"', "target: is missing; samples with an image need"),
        ('name = "3"', 'name = "2"', "the name '2' is given 2 times"),
        ('name = "3"\n', "", "sample[3].name: is missing, add it"),
        ("[[sample]]", "[[sampel]]", "sampel: unknown key, did you mean 'sample'"),
        ('mount = "eye-to-hand"', "mount = ", "not valid TOML"),
    ],
)
def test_a_fault_is_named_with_its_key_and_the_remedy(tmp_path, recording, old, new, message):
    path = with_text(recording.write_points(tmp_path), old, new)
    assert any(message in fault for fault in faults(path)), faults(path)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('type = "charucco"', "target.type: 'charucco' is unknown, did you mean 'charuco'"),
        ("columns = 5", "target.type: None is unknown; known:"),
        (
            'type = "chessboard"\ncolumns = 5\nrows = 4\nsquare_m = 0.03',
            "target.square_m: unknown key, did you mean 'square_mm'",
        ),
        (
            'type = "chessboard"\ncolumns = 5\nrows = 4\nsquare_mm = 0.03',
            "target.square_mm: Input should be greater than or equal to 0.1",
        ),
        (
            'type = "charuco"\ncolumns = 5\nrows = 4\nsquare_mm = 20\nmarker_mm = 30\n'
            'dictionary = "6x6_250"',
            "target: marker_mm = 30 must be below square_mm = 20",
        ),
        ('type = "tag"\ndictionary = "36h10"\nid = 0\nsize_mm = 20', "did you mean '36h11'"),
        ('type = "circles"\ncolumns = 5.5\nrows = 4\nspacing_mm = 20', "a valid integer"),
    ],
)
def test_a_fault_of_the_target_is_named(tmp_path, recording, table, message):
    path = recording.write_points(tmp_path, target=("[target]", table))
    assert any(message in fault for fault in faults(path)), faults(path)


def test_all_faults_come_in_one_message(tmp_path, recording):
    path = recording.write_points(tmp_path)
    with_text(path, "refine", "refined")
    with_text(path, 'points = "1.csv"', 'points = "none.csv"')
    with_text(path, 'name = "3"', 'name = "2"')
    (tmp_path / "5.csv").write_text("x,y\n1,2\n")
    assert len(faults(path)) == 4


def test_one_pose_twice_is_named(tmp_path, recording):
    recording.robot[6] = recording.robot[1]
    assert any(
        "'1', '6' hold the same pose" in f for f in faults(recording.write_points(tmp_path))
    )


def test_equal_poses_of_all_samples_are_one_fault(tmp_path, recording):
    recording.robot = [recording.robot[0]] * recording.count
    (fault,) = faults(recording.write_points(tmp_path))
    assert "sample.pose: all 8 are equal: the robot was not read again" in fault


def test_a_camera_that_always_says_the_same_is_a_fault(tmp_path, recording):
    recording.seen = [recording.seen[0]] * recording.count
    (fault,) = faults(recording.write_matrices(tmp_path))
    assert "sample.camera_from_target: all 8 are equal: the camera" in fault


def test_fewer_than_three_samples_are_a_fault(tmp_path, make_recording):
    (fault,) = faults(make_recording(count=2).write_points(tmp_path))
    assert "sample: 2 given, at least 3 are needed" in fault


def test_more_samples_than_are_solved_are_a_fault_at_once(tmp_path, make_recording):
    recording = make_recording(count=3)
    path = recording.write_points(tmp_path, pixels=recording.pixels())
    head, _, samples = path.read_text().partition("[[sample]]")
    path.write_text(head + ("[[sample]]" + samples + "\n") * 700)
    with pytest.raises(ConfigError, match=r"sample: 2100 given, at most 1000.*keep one of 3"):
        load_dataset(path)


def test_millimetres_declared_as_metres_are_a_fault(tmp_path, recording):
    path = with_text(recording.write_points(tmp_path, unit="mm"), 'unit = "mm"', 'unit = "m"')
    assert any("is it mm?" in fault for fault in faults(path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "header must be x_mm,y_mm,z_mm,u_px,v_px, got []"),
        ("x_m,y_m,z_m,u_px,v_px\n0,0,0,1,1\n", "header must be x_mm"),
        ("x_mm,y_mm,z_mm,u_px,v_px\n0,0,0,1,one\n", "line 2: could not convert"),
        ("x_mm,y_mm,z_mm,u_px,v_px\n0,0,0,1\n", "line 2: 5 finite numbers are needed"),
        ("x_mm,y_mm,z_mm,u_px,v_px\n0,0,0,1,nan\n", "line 2: 5 finite numbers are needed"),
        ("x_mm,y_mm,z_mm,u_px,v_px\n0,0,0,1,1\n0.1,0,0,9,1\n", "are they in metres?"),
    ],
)
def test_a_fault_of_a_points_file_is_named_with_its_line(tmp_path, recording, text, message):
    path = recording.write_points(tmp_path)
    (tmp_path / "4.csv").write_text(text)
    (fault,) = faults(path)
    assert "sample[4] '4'.points" in fault
    assert "4.csv" in fault
    assert message in fault


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([1.0] * 15, "a matrix has 16 numbers, or 12 without its last row"),
        ([1.0] * 16, "the last row of a homogeneous matrix is 0 0 0 1"),
        ([2.0, 0, 0, 0, 0, 2.0, 0, 0, 0, 0, 2.0, 1, 0, 0, 0, 1], "not a rotation matrix"),
    ],
)
def test_a_matrix_that_is_no_motion_is_a_fault(tmp_path, recording, numbers, message):
    path = recording.write_matrices(tmp_path)
    lines = path.read_text().splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("camera_from_target"))
    lines[row] = f"camera_from_target = {numbers}"
    path.write_text("\n".join(lines))
    assert any(message in fault for fault in faults(path)), faults(path)


def test_refining_without_pixels_is_a_fault(tmp_path, recording):
    (fault,) = faults(recording.write_matrices(tmp_path, refine=True))
    assert "camera.refine" in fault


def test_matrices_and_points_do_not_mix(tmp_path, recording):
    path = recording.write_matrices(tmp_path)
    lines = path.read_text().splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("camera_from_target"))
    other = tmp_path / "points"
    other.mkdir()
    recording.write_points(other)
    lines[row] = 'points = "points/0.csv"'
    path.write_text("\n".join(lines))
    assert any("cannot be mixed" in fault for fault in faults(path))


def test_a_missing_camera_is_a_fault_where_pixels_need_one(tmp_path, recording):
    path = recording.write_points(tmp_path)
    text = path.read_text()
    start, end = text.index("[camera]"), text.index("[poses]")
    path.write_text(text[:start] + text[end:])
    (fault,) = faults(path)
    assert "camera: is missing" in fault


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    assert "no such file" in faults(tmp_path / "none.toml")[0]
    assert "cannot be read" in faults(tmp_path)[0]


def test_a_good_dataset_is_read_as_it_is_written(tmp_path, recording):
    dataset = load_dataset(recording.write_points(tmp_path))
    assert len(dataset.samples) == recording.count
    first = dataset.samples[0].base_from_wrist
    assert isinstance(first, Pose)
    assert first.distance(recording.robot[0])[0] < 1e-9
