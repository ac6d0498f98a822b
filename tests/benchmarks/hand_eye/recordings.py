"""Recordings for the judge of hand-eye: those of others beside the checkout, and drawn ones of every kind.

The drawing uses numpy, scipy and cv2 only: nothing of the solver that is judged.
"""

import csv
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
DATA = Path(__file__).parents[4] / "shared" / "data"


@dataclass(frozen=True)
class Recorded:
    """flange: (n, 4, 4) base_from_wrist as the robot said; mm.

    With pictures: K (3, 3), distortion, points and pixels of each. Without: seen (n, 4, 4).
    """

    name: str
    in_hand: bool
    flange: Array
    K: Array | None = None
    distortion: Array | None = None
    points: tuple[Array, ...] = ()
    pixels: tuple[Array, ...] = ()
    seen: Array | None = None

    def __len__(self) -> int:
        return len(self.flange)

    def own(self, index: int, K: Array | None = None, distortion: Array | None = None) -> Array:
        """camera_from_target (4, 4) of a sample by itself: cv2's PnP, refined by cv2."""
        if self.seen is not None:
            return np.asarray(self.seen[index])
        K = self.K if K is None else K
        d = self.distortion if distortion is None else distortion
        points, pixels = self.points[index], self.pixels[index]
        _, turn, shift = cv2.solvePnP(points, pixels, K, d)
        turn, shift = cv2.solvePnPRefineLM(points, pixels, K, d, turn, shift)
        return matrix(cv2.Rodrigues(turn)[0], shift.ravel())


def matrix(R: Array, t: Array) -> Array:
    """(4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def of_others() -> list[Recorded]:
    """The recordings in `../shared/data`; none where that folder is not there."""
    found = []
    for name in ("visp-eye-in-hand", "ros-industrial-dots"):
        if (DATA / name).is_dir():
            found.append(_with_points(name, DATA / name))
    if (DATA / "ros-industrial-charuco").is_dir():
        found.append(_charuco(DATA / "ros-industrial-charuco"))
    if (DATA / "moveit-pairs").is_dir():
        found.append(_moveit(DATA / "moveit-pairs"))
    return found


def _with_points(name: str, folder: Path) -> Recorded:
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
    return Recorded(name, in_hand, np.array(flange), K, d, tuple(points), tuple(pixels))


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


@dataclass(frozen=True)
class Drawn:
    """How a recording is drawn. arm: mm and degrees per axis; turns: degrees of tilt, one sigma.

    outliers: so many flange poses belong to another moment; size: of the target over the stated one;
    focal: of the camera over the stated one; pairs: mm and degrees of the target's pose where only that is told.
    """

    name: str
    count: int
    arm: tuple[float, float]
    px: float = 0.3
    in_hand: bool = False
    turns: float = 20.0
    away_mm: tuple[float, float] = (450.0, 800.0)
    corners: tuple[int, int, float] = (8, 6, 25.0)
    outliers: int = 0
    size: float = 1.0
    focal: float = 1.0
    pairs: tuple[float, float] | None = None


DRAWN = (
    Drawn("fine arm, 30", 30, (0.02, 0.01), 0.1),
    Drawn("fine arm, rough pixels, 8", 8, (0.05, 0.01), 2.0, in_hand=True),
    Drawn("industrial arm, 15", 15, (0.3, 0.03), 0.3, in_hand=True),
    Drawn("positions 2 mm, 20", 20, (2.0, 0.05), 0.3),
    Drawn("positions 10 mm, 25", 25, (10.0, 0.3), 1.0),
    Drawn("turns 1 degree, 12", 12, (0.5, 1.0), 0.2, in_hand=True),
    Drawn("rough all over, 6", 6, (2.0, 0.5), 1.0),
    Drawn("pixels 5, 40", 40, (0.1, 0.02), 5.0, in_hand=True, away_mm=(300, 500)),
    Drawn("small tilts, 20", 20, (0.2, 0.05), 0.3, turns=7.0),
    Drawn("two of 16 belong elsewhere", 16, (0.3, 0.03), 0.3, outliers=2),
    Drawn("target 1 % larger, 18", 18, (0.2, 0.03), 0.3, in_hand=True, size=1.01),
    Drawn("focal length 1 % off, 16", 16, (0.5, 0.05), 0.3, focal=1.01),
    Drawn("one small tag, 14", 14, (0.2, 0.03), 0.2, corners=(2, 2, 60.0)),
    Drawn("pairs, 20", 20, (0.5, 0.05), pairs=(1.0, 0.3)),
    Drawn("pairs in the hand, 10", 10, (0.05, 0.3), pairs=(0.3, 0.1), in_hand=True),
    Drawn("pairs, one of 12 elsewhere", 12, (0.3, 0.05), pairs=(0.5, 0.1), outliers=1),
)


def draw(kind: Drawn, seed: int) -> Recorded:
    """One recording of a kind."""
    rng = np.random.default_rng(seed)
    columns, rows, pitch = kind.corners
    board = np.array([(pitch * x, pitch * y, 0.0) for y in range(rows) for x in range(columns)])
    held = matrix(Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 120, 3))
    fixed = matrix(Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 900, 3))
    K = np.array([[1180.0, 0, 655], [0, 1184.0, 470], [0, 0, 1]])
    flange, views = [], []
    for _ in range(kind.count):
        tilt = Rotation.from_rotvec(np.radians(kind.turns) * rng.normal(size=3)).as_matrix()
        middle = np.array([*rng.uniform(-70, 70, 2), rng.uniform(*kind.away_mm)])
        seen = matrix(tilt, middle - tilt @ board.mean(axis=0))
        # eye-to-hand: fixed is the camera in the base; in the hand: held is the camera in the wrist
        true = (
            fixed @ np.linalg.inv(held @ seen)
            if kind.in_hand
            else fixed @ seen @ np.linalg.inv(held)
        )
        flange.append(_shaken(true, *kind.arm, rng))
        views.append(seen)
    for index in rng.choice(kind.count, kind.outliers, replace=False):
        flange[index] = _shaken(flange[index], 40.0, 4.0, rng)
    if kind.pairs is not None:
        told = np.array([_shaken(seen, *kind.pairs, rng) for seen in views])
        return Recorded(kind.name, kind.in_hand, np.array(flange), seen=told)
    pixels = tuple(_pictured(board * kind.size, seen, K, kind.px, rng) for seen in views)
    stated = K * np.array([[kind.focal], [kind.focal], [1.0]])
    stated[:2, 2] = K[:2, 2]
    points = (board,) * kind.count
    return Recorded(kind.name, kind.in_hand, np.array(flange), stated, np.zeros(5), points, pixels)


def _shaken(pose: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """The pose moved in its own frame."""
    turn = Rotation.from_rotvec(np.radians(deg) * rng.normal(size=3)).as_matrix()
    return pose @ matrix(turn, mm * rng.normal(size=3))


def _pictured(points: Array, seen: Array, K: Array, px: float, rng: np.random.Generator) -> Array:
    turn, shift = cv2.Rodrigues(seen[:3, :3])[0], seen[:3, 3]
    exact = cv2.projectPoints(points, turn, shift, K, np.zeros(5))[0].reshape(-1, 2)
    return np.asarray(exact + px * rng.normal(size=exact.shape))
