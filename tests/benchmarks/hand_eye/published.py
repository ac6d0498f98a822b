"""Recordings of others: those in `../shared/data`, and any DATASET.toml that is named.

Those in the folder are read here, without the reader of the product; a DATASET.toml that is named may have any
of its forms (`vgrd import` writes one of easy_handeye2's or moveit's samples), and is read by the product.
"""

import csv
import json
import tomllib
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tests.benchmarks.hand_eye.recordings import Recorded, matrix
from vgrd.errors import TagNotSeen
from vgrd.model import Mount
from vgrd.solving.datasets import load_dataset
from vgrd.solving.datasets.looking import observe
from vgrd.vision.print.boards import BoardObservation

DATA = Path(__file__).parents[4] / "shared" / "data"


def of_others(folder: Path = DATA) -> list[Recorded]:
    """The recordings in a folder; none where it is not there."""
    found = [_with_points(path.parent) for path in sorted(folder.glob("*/dataset.toml"))]
    for name, read in (
        ("ros-industrial-charuco", _charuco),
        ("moveit-pairs", _moveit),
        ("cases/hand-eye/pairs-mixed-units.toml", _mixed_units),
    ):
        if (folder / name).exists():
            found.append(read(folder / name))
    return found


def of_dataset(path: Path) -> Recorded:
    """A recording in the product's format; samples whose target is not seen are none."""
    dataset = load_dataset(path)
    flange, points, pixels, seen = [], [], [], []
    for sample in dataset.samples:
        try:
            shown = observe(sample, dataset.target)
        except TagNotSeen:
            continue
        flange.append(sample.base_from_wrist.matrix())
        if isinstance(shown, BoardObservation):
            points.append(np.ascontiguousarray(shown.points_in_target))
            pixels.append(np.ascontiguousarray(shown.pixels))
        else:
            seen.append(shown.matrix())
    in_hand, camera = dataset.mount is Mount.EYE_IN_HAND, dataset.camera
    name = path.parent.name if path.stem == "dataset" else path.stem
    if camera is None:
        return Recorded(name, in_hand, np.array(flange), seen=np.array(seen))
    d = camera.distortion if len(camera.distortion) else np.zeros(5)
    return Recorded(
        name, in_hand, np.array(flange), camera.matrix, d, tuple(points), tuple(pixels)
    )


def _with_points(folder: Path) -> Recorded:
    data = tomllib.loads((folder / "dataset.toml").read_text())
    flange, points, pixels = [], [], []
    for sample in data["sample"]:
        x = sample["pose"]
        flange.append(matrix(Rotation.from_quat(x[3:]).as_matrix(), 1e3 * np.array(x[:3])))
        with (folder / sample["points"]).open() as file:
            rows = np.array([[float(v) for v in row] for row in list(csv.reader(file))[1:] if row])
        points.append(np.ascontiguousarray(rows[:, :3]))
        pixels.append(np.ascontiguousarray(rows[:, 3:]))
    fx, fy, cx, cy = data["camera"]["matrix"]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    in_hand = data["mount"] == "eye-in-hand"
    d = np.array(data["camera"].get("distortion", []) or [0.0] * 5)
    return Recorded(folder.name, in_hand, np.array(flange), K, d, tuple(points), tuple(pixels))


def _charuco(folder: Path) -> Recorded:
    """Corners by cv2's own detector; pictures with fewer than 6 are no samples."""
    import yaml

    intrinsics = yaml.safe_load((folder / "cal_data.yaml").read_text())["intrinsics"]
    K = np.array(
        [
            [intrinsics["fx"], 0, intrinsics["cx"]],
            [0, intrinsics["fy"], intrinsics["cy"]],
            [0, 0, 1.0],
        ]
    )
    board = cv2.aruco.CharucoBoard(
        (5, 7),
        36.195,
        18.256,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250),
    )
    detector = cv2.aruco.CharucoDetector(board)
    corners_mm = np.asarray(board.getChessboardCorners(), dtype=np.float64)
    flange, points, pixels = [], [], []
    for path in sorted(folder.glob("images/*.png"), key=lambda path: int(path.stem)):
        found, ids, _, _ = detector.detectBoard(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        if ids is None or len(ids) < 6:
            continue
        pose = yaml.safe_load((folder / "poses" / f"{path.stem}.yaml").read_text())
        q = [pose[k] for k in ("qx", "qy", "qz", "qw")]
        t = 1e3 * np.array([pose[k] for k in ("x", "y", "z")])
        flange.append(matrix(Rotation.from_quat(q).as_matrix(), t))
        points.append(np.ascontiguousarray(corners_mm[ids.ravel()]))
        pixels.append(np.asarray(found, dtype=np.float64).reshape(-1, 2))
    return Recorded(
        "ros-industrial-charuco",
        in_hand=False,
        flange=np.array(flange),
        K=K,
        distortion=np.zeros(5),
        points=tuple(points),
        pixels=tuple(pixels),
    )


def _moveit(folder: Path) -> Recorded:
    pairs = np.array(json.loads((folder / "pose_samples.json").read_text()))
    pairs[:, :, :3, 3] *= 1e3
    return Recorded("moveit-pairs", in_hand=False, flange=pairs[:, 0], seen=pairs[:, 1])


def _mixed_units(path: Path) -> Recorded:
    """The robot's lengths in mm, the target's in m: a set of pairs, each side read in its own unit."""
    data = tomllib.loads(path.read_text())
    x = np.array([sample["pose"] for sample in data["sample"]])
    turns = Rotation.from_quat(x[:, 3:]).as_matrix()
    flange = np.array([matrix(R, t) for R, t in zip(turns, x[:, :3], strict=True)])
    seen = np.array([sample["camera_from_target"] for sample in data["sample"]]).reshape(-1, 4, 4)
    seen[:, :3, 3] *= 1e3
    return Recorded("pairs-mixed-units", data["mount"] == "eye-in-hand", flange, seen=seen)
