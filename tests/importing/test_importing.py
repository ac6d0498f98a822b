"""`vgrd import`: recordings of other programs become datasets, and what is assumed is told."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.importing import import_files
from vgrd.model import Mount
from vgrd.solving.datasets import load_dataset, solve_dataset
from vgrd.vision.print.boards import Chessboard

DATA = Path(__file__).parents[3] / "shared" / "data"
BASE_FROM_CAMERA = Pose.from_rotvec([2.1, -0.5, 0.3], [850, 120, 680])
WRIST_FROM_TARGET = Pose.from_rotvec([0.2, 2.8, -0.4], [20, -35, 140])
WRIST_FROM_CAMERA = Pose.from_rotvec([0.1, -0.1, 1.3], [45, -60, 95])
BASE_FROM_TARGET = Pose.from_rotvec([3.0, 0.2, 0.1], [620, 90, 15])


def recording(count=9, seed=5, *, on_arm=False):
    """base_from_wrist and camera_from_target of a fixed camera, or of one on the arm."""
    rng = np.random.default_rng(seed)
    robot, seen = [], []
    for _ in range(count):
        turn = Pose.from_rotvec(rng.normal(0, 0.4, 3))
        target = Pose(np.eye(3), [*rng.uniform(-70, 70, 2), rng.uniform(450, 650)]) @ turn
        seen.append(target)
        robot.append(
            BASE_FROM_TARGET @ target.inverse() @ WRIST_FROM_CAMERA.inverse()
            if on_arm
            else BASE_FROM_CAMERA @ target @ WRIST_FROM_TARGET.inverse()
        )
    return robot, seen


def quaternion(pose):
    return Rotation.from_matrix(pose.rotation).as_quat().tolist()


def message(pose):
    """geometry_msgs/Transform, metres."""
    x, y, z = (pose.translation / 1000).tolist()
    qx, qy, qz, qw = quaternion(pose)
    return {
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": qx, "y": qy, "z": qz, "w": qw},
    }


def imported(tmp_path, *files, **said):
    """The imported dataset as `vgrd solve` reads it, and what was told."""
    found = import_files(files, said, tmp_path)
    path = tmp_path / "imported.toml"
    path.write_text(found.text)
    return load_dataset(path), " | ".join(found.told)


def check(dataset, robot, seen, *, on_arm=False):
    """Every pose is the one that was written, and the mount is the right one."""
    assert dataset.mount is (Mount.EYE_IN_HAND if on_arm else Mount.EYE_TO_HAND)
    for sample, flange, target in zip(dataset.samples, robot, seen, strict=True):
        for found, true in ((sample.base_from_wrist, flange), (sample.source, target)):
            mm, rad = found.distance(true)
            assert mm < 1e-3
            assert rad < 1e-6


@pytest.mark.parametrize("on_arm", [False, True])
def test_samples_of_easy_handeye2(tmp_path, on_arm):
    robot, seen = recording(on_arm=on_arm)
    pairs = zip(robot, seen, strict=True)
    samples = [{"robot": message(r), "tracking": message(s)} for r, s in pairs]
    path = tmp_path / "samples.yaml"
    path.write_text(yaml.safe_dump({"samples": samples}))
    dataset, told = imported(tmp_path, path)
    check(dataset, robot, seen, on_arm=on_arm)
    assert f"mount = {'eye-in-hand' if on_arm else 'eye-to-hand'}: so the samples agree" in told
    assert "lengths in m: coordinates reach" in told
    if not on_arm:
        solution = solve_dataset(tmp_path / "imported.toml")
        mm, rad = solution.mount_from_camera.distance(BASE_FROM_CAMERA)
        assert mm < 0.1
        assert rad < 1e-3


def test_easy_handeyes_inverted_robot_of_a_fixed_camera(tmp_path):
    robot, seen = recording()
    pairs = zip(robot, seen, strict=True)
    samples = [{"robot": message(r.inverse()), "tracking": message(s)} for r, s in pairs]
    path = tmp_path / "samples.yaml"
    path.write_text(yaml.safe_dump({"samples": samples}))
    dataset, told = imported(tmp_path, path, mount="eye-to-hand")
    check(dataset, robot, seen)
    assert "taken as wrist_from_base and written inverted: so the samples agree" in told


def test_samples_of_moveit(tmp_path):
    robot, seen = recording()
    entries = [
        {"effector_wrt_world": r.matrix().ravel().tolist(), "object_wrt_sensor": s.matrix().ravel().tolist()}
        for r, s in zip(robot, seen, strict=True)
    ]  # fmt: skip
    path = tmp_path / "samples.yaml"
    path.write_text(yaml.safe_dump(entries))
    dataset, told = imported(tmp_path, path)
    check(dataset, robot, seen)
    assert "robot: effector_wrt_world; lengths in mm" in told


def test_arrays_of_opencvs_names(tmp_path):
    robot, seen = recording(on_arm=True)
    path = tmp_path / "samples.npz"
    np.savez(
        path,
        R_gripper2base=[r.rotation for r in robot],
        t_gripper2base=[r.translation[:, None] for r in robot],
        rvecs=[s.rotvec()[:, None] for s in seen],
        tvecs=[s.translation[:, None] / 1000 for s in seen],
        mtx=np.eye(3),
    )
    dataset, told = imported(tmp_path, path)
    check(dataset, robot, seen, on_arm=True)
    assert (
        "camera: tvecs, rvecs; lengths in m" in told
        or "camera: rvecs, tvecs; lengths in m" in told
    )


def test_a_name_that_maps_the_other_way_is_inverted(tmp_path):
    robot, seen = recording(on_arm=True)
    path = tmp_path / "samples.json"
    rows = [
        {
            "base2gripper": r.inverse().matrix().tolist(),
            "cam2target": s.inverse().matrix().tolist(),
        }
        for r, s in zip(robot, seen, strict=True)
    ]
    path.write_text(json.dumps(rows))
    dataset, told = imported(tmp_path, path)
    check(dataset, robot, seen, on_arm=True)
    assert "wrist_from_base and written inverted: their name says so" in told
    assert "the camera's poses are written inverted" in told


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        (lambda p: p.rotvec(), "rotvec"),
        (lambda p: Rotation.from_matrix(p.rotation).as_euler("xyz"), "rpy-fixed-xyz"),
        (lambda p: np.degrees(p.rotvec()), "rotvec-deg"),
        (lambda p: Rotation.from_matrix(p.rotation).as_euler("ZYX", degrees=True), "kuka-abc-deg"),
        (lambda p: Rotation.from_matrix(p.rotation).as_euler("xyz", degrees=True), "rpy-fixed-xyz-deg"),
        (lambda p: Rotation.from_matrix(p.rotation).as_quat(scalar_first=True), "quaternion-wxyz"),
    ],
)  # fmt: skip
def test_the_rotation_format_is_the_one_that_fits(tmp_path, turn, expected):
    lines = []
    robot, seen = recording()
    for r, s in zip(robot, seen, strict=True):
        numbers = turn(r).tolist()
        names = ["rx", "ry", "rz"] if len(numbers) == 3 else [f"quat_{i}" for i in range(4)]
        header = [
            "x",
            "y",
            "z",
            *names,
            "cam_x",
            "cam_y",
            "cam_z",
            "cam_qx",
            "cam_qy",
            "cam_qz",
            "cam_qw",
        ]
        lines.append([*r.translation, *numbers, *(s.translation / 1000), *quaternion(s)])
    path = tmp_path / "table.csv"
    path.write_text("\n".join([",".join(header), *(",".join(map(str, row)) for row in lines)]))
    dataset, told = imported(tmp_path, path)
    check(dataset, robot, seen)
    assert f"robot: rotation = {expected}: so the samples agree" in told


def test_pictures_a_table_a_camera_file_and_a_board(tmp_path):
    K = np.array([[900.0, 0, 500], [0, 900, 400], [0, 0, 1]])
    robot, _ = recording(count=11)
    (tmp_path / "shots").mkdir()
    for i in range(11):
        cv2.imwrite(str(tmp_path / "shots" / f"shot{i + 1}.png"), np.zeros((8, 10), np.uint8))
    rows = ["X [mm];Y [mm];Z [mm];A;B;C"]
    for pose in robot:
        abc = Rotation.from_matrix(pose.rotation).as_euler("ZYX", degrees=True)
        rows.append(";".join(f"{v:.6f}".replace(".", ",") for v in (*pose.translation, *abc)))
    (tmp_path / "robot.csv").write_text("\n".join(rows), encoding="utf-16")
    info = {
        "image_width": 1000,
        "image_height": 800,
        "camera_matrix": {"data": K.ravel().tolist()},
    }
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(info))
    board = 'type = "chessboard"\ncolumns = 7\nrows = 5\nsquare_mm = 20\n'
    (tmp_path / "board.toml").write_text(f"[target]\n{board}")
    names = ("robot.csv", "shots", "camera.yaml", "board.toml")
    dataset, told = imported(tmp_path, *(tmp_path / name for name in names))
    for sample, pose in zip(dataset.samples, robot, strict=True):
        assert sample.base_from_wrist.distance(pose)[0] < 1e-5
    np.testing.assert_array_equal(dataset.camera.matrix, K)
    assert dataset.target == Chessboard(7, 5, 20)
    assert [s.source.name for s in dataset.samples] == [f"shot{i}.png" for i in range(1, 12)]
    assert "11 pictures in natural order, shot1.png to shot11.png" in told
    assert "robot: rotation = kuka-abc-deg: by names and sizes" in told
    assert "mount = eye-to-hand: assumed, nothing tells it" in told
    (tmp_path / "shots" / "shot4.png").unlink()
    with pytest.raises(InputError, match="10 pictures for 11 poses"):
        imported(tmp_path, *(tmp_path / name for name in names))


@pytest.mark.parametrize("suffix", [".xml", ".yaml"])
def test_matrices_in_a_storage_of_opencv(tmp_path, suffix):
    robot, seen = recording(count=11)
    path = tmp_path / f"samples{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for i, (r, s) in enumerate(zip(robot, seen, strict=True)):
        storage.write(f"robot_{i}", r.matrix())
        storage.write(f"camera_{i}", s.matrix())
    storage.release()
    dataset, _ = imported(tmp_path, path)
    check(dataset, robot, seen)


def test_trajectories_and_lists_in_cells(tmp_path):
    robot, seen = recording()
    rows = [[1.5 * i, *(r.translation / 1000), *quaternion(r)] for i, r in enumerate(robot)]
    np.savetxt(tmp_path / "robot.txt", rows)
    lines = ["rvec;tvec"]
    for s in seen:
        lines.append(";".join(str(list(map(float, v))) for v in (s.rotvec(), s.translation)))
    (tmp_path / "camera.csv").write_text("\n".join(lines))
    dataset, told = imported(tmp_path, tmp_path / "robot.txt", tmp_path / "camera.csv")
    check(dataset, robot, seen)
    assert "7 numbers a row" in told or "numbers a row; lengths in m" in told


def test_columns_of_rostopic_echo(tmp_path):
    robot, seen = recording()
    names = [f"field.pose.position.{c}" for c in "xyz"] + [
        f"field.pose.orientation.{c}" for c in "xyzw"
    ]
    lines = [",".join(["%time", "field.header.seq", "field.header.frame_id", *names])]
    for i, r in enumerate(robot):
        values = [*(r.translation / 1000), *quaternion(r)]
        lines.append(",".join([f"{i}", f"{i}", "base", *map(str, values)]))
    (tmp_path / "robot.csv").write_text("\n".join(lines))
    np.savez(tmp_path / "target.npz", board_poses=[s.matrix() for s in seen])
    dataset, _ = imported(tmp_path, tmp_path / "robot.csv", tmp_path / "target.npz")
    check(dataset, robot, seen)


def test_a_folder_of_files_with_a_pose_each(tmp_path):
    folder = tmp_path / "poses"
    folder.mkdir()
    robot, seen = recording(count=11)
    for i, pose in enumerate(robot):
        np.savetxt(folder / f"{i}.txt", pose.matrix())
    np.savez(
        tmp_path / "cam.npz", rvecs=[s.rotvec() for s in seen], tvecs=[s.translation for s in seen]
    )
    dataset, told = imported(tmp_path, folder, tmp_path / "cam.npz")
    check(dataset, robot, seen)
    assert "11 files with one pose each, 0.txt to 10.txt in natural order" in told


def test_places_of_a_3d_camera_become_points(tmp_path):
    robot, _ = recording()
    rows = ["flange_x,flange_y,flange_z,camera_x,camera_y,camera_z"]
    for pose in robot:
        place = BASE_FROM_CAMERA.inverse() @ pose.translation
        rows.append(",".join(map(str, (*pose.translation, *place))))
    (tmp_path / "ball.csv").write_text("\n".join(rows))
    found = import_files([tmp_path / "ball.csv"], {}, tmp_path)
    assert found.kind == "point_in_camera"
    assert "the wrist is taken as never turned" in " ".join(found.told)
    (tmp_path / "d.toml").write_text(found.text)
    assert len(load_dataset(tmp_path / "d.toml").samples) == 9


def test_what_is_said_overrides(tmp_path):
    rows = [
        {"robot": message(r), "tracking": message(s)} for r, s in zip(*recording(), strict=True)
    ]
    path = tmp_path / "samples.json"
    path.write_text(json.dumps({"samples": rows}))
    found = import_files([path], {"unit": "mm", "mount": "eye-in-hand"}, tmp_path)
    assert 'unit = "mm"' in found.text
    assert "mount = eye-in-hand: as --as says" in found.told
    assert any("lengths in mm: as --as says" in sentence for sentence in found.told)


@pytest.mark.parametrize(
    ("said", "message_"),
    [
        ({"mont": "eye-in-hand"}, "'mont' is unknown, did you mean 'mount'"),
        ({"unit": "cm"}, "'cm' is unknown"),
        ({"rotation": "rpy"}, "'rpy' is unknown"),
    ],
)
def test_what_is_said_wrongly_is_told(tmp_path, said, message_):
    with pytest.raises(InputError, match=re.escape(message_)):
        import_files([tmp_path / "a.csv"], said, tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message_"),
    [
        ("run.bag", b"#ROSBAG V2.0", "is a ROS bag: write the poses with `rostopic echo"),
        ("a.xlsx", b"PK\x03\x04", "is a spreadsheet: save it as CSV"),
        ("a.pkl", b"\x80\x04", "is a Python pickle"),
        ("robot.urdf", b"<robot/>", "is a robot description"),
        ("a.csv", b"time,temperature\n1,2\n2,3\n3,4\n", "no poses of the robot are there"),
        ("a.csv", b"1,2,3,0,0\n2,2,3,0,0\n", "its 5 columns have no names: begin with a line"),
        ("a.csv", b"cam_x,cam_y,cam_z\n1,2,3\n1,2,4\n2,2,3\n", "only the camera's side is there"),
        ("a.csv", b"x,y,z,rx,ry,rz\n1,2,3,0,0,0\n", "1 samples are there, at least 3"),
        ("a.csv", b"x,y,z,rx,ry,rz\n1,2,nan,0,0,0\n", "line 2, column 'z': nan is not finite"),
        ("a.toml", b'mount = "eye-in-hand"\n[[sample]]\n', "is a dataset or a file of touches already"),
        ("a.toml", b"[cell]\n", "holds neither [target] nor [camera]"),
        ("a.txt", b"\x89PNG\r\n", "is a PNG picture: a table as CSV"),
        ("c.yaml", b"K: [1, 0, 1, 0, 1, 1, 0, 0, 1]\ndist_x: [1]\n", "key 'dist_x' is not understood"),
    ],
)  # fmt: skip
def test_files_of_no_use_are_refused_by_what_they_are(tmp_path, name, content, message_):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message_)):
        import_files([tmp_path / name], {}, tmp_path)


def test_the_pairs_of_moveits_own_test_as_they_are(tmp_path):
    path = DATA / "moveit-pairs" / "pose_samples.json"
    if not path.is_file():
        pytest.skip(f"{path} is not there: it is no part of the repository")
    dataset, told = imported(tmp_path, path)
    assert len(dataset.samples) == 50
    assert "mount = eye-to-hand: so the samples agree" in told


def test_the_recording_of_ros_industrial_as_it_is(tmp_path):
    folder = DATA / "ros-industrial-charuco"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there: it is no part of the repository")
    found = import_files([folder / "poses", folder / "images"], {}, tmp_path)
    assert found.count == 16
    assert any("quaternion-xyzw" in sentence for sentence in found.told)
