"""Intrinsics with the board's points as unknowns against OpenCV's calibrateCamera on the same points.

12 MP, f 12766 px, 13 x 9 points of 10 mm, 20 pictures, 0.005 px noise, points printed 0.01 mm off
(vision at the noise limit, board from a good printer). Errors are rms over the runs.
"""

import cv2
import numpy as np

from tests.benchmarks.harness import Row
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.intrinsics.estimate import calibrate_intrinsics
from vgrd.vision.intrinsics.fit import BoardView

RUNS, PICTURES = 8, 20
NOISE_PX, PRINT_MM = 0.005, 0.01
SIZE = (4024, 3036)
CAMERA = CameraModel(
    np.array([[12766.0, 0, 2032], [0, 12779, 1503], [0, 0, 1]]),
    np.array([-0.08, 0.1, 2e-4, -1e-4]),
    SIZE,
)
TRUTH = np.concatenate([CAMERA.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], CAMERA.distortion])


def rows() -> list[Row]:
    """Focal length and principal point against OpenCV's, and the covariance."""
    y, x = np.divmod(np.arange(13 * 9), 13)
    board = 10.0 * np.column_stack([x - 6.0, y - 4.0, 0.0 * x])
    ours, theirs, squares = [], [], []
    for seed in range(RUNS):
        views = simulated(board, seed)
        found = calibrate_intrinsics(board, views, SIZE)
        K = found.camera.matrix
        error = np.append(K[[0, 1, 0, 1], [0, 1, 2, 2]], found.camera.distortion) - TRUTH
        ours.append(error[:4])
        squares.append(error @ np.linalg.solve(found.covariance, error) / len(error))
        theirs.append(opencv(board, views) - TRUTH[:4])
    (f, c), (f_cv, c_cv) = spread(ours), spread(theirs)
    note = f"f {f:.3f} against {f_cv:.2f} px, centre {c:.3f} against {c_cv:.2f} px"
    nees = float(np.mean(squares))
    return [
        Row.at_least("intrinsics_focal_vs_opencv", f_cv / f, "x", 20, note),
        Row.at_least("intrinsics_centre_vs_opencv", c_cv / c, "x", 20),
        Row.at_most("intrinsics_nees_over_dimension", nees, "", 1.5, f"{RUNS} runs of 8 numbers"),
    ]


def spread(errors: list[Array]) -> tuple[float, float]:
    """Rms errors of the focal lengths and of the principal point, px."""
    squares = np.mean(np.square(errors), axis=0)
    return float(np.sqrt(squares[:2].mean())), float(np.sqrt(squares[2:].mean()))


def simulated(board: Array, seed: int) -> list[BoardView]:
    """Pictures of the board as printed, tilted by 5 to 35 degrees, more than half of it in view."""
    rng = np.random.default_rng(seed)
    real = board + rng.normal(0, PRINT_MM, board.shape)
    views: list[BoardView] = []
    while len(views) < PICTURES:
        axis, yaw = rng.uniform(0, 2 * np.pi, 2)
        tilt = np.radians(rng.uniform(5, 35)) * np.array([np.cos(axis), np.sin(axis), 0])
        R = Pose.from_rotvec(tilt).rotation @ Pose.from_rotvec([0, 0, yaw]).rotation
        place = rng.uniform(0.25, 0.75, 2) * SIZE
        sight = np.append((place - CAMERA.matrix[:2, 2]) / 12766, 1.0)
        pixels = CAMERA.project(Pose(R, rng.uniform(558, 642) * sight) @ real)
        inside = ((pixels > 3) & (pixels < np.array(SIZE) - 4)).all(1)
        if inside.mean() > 0.5:
            noisy = pixels[inside] + rng.normal(0, NOISE_PX, (int(inside.sum()), 2))
            views.append(BoardView(f"{len(views)}", np.flatnonzero(inside), noisy))
    return views


def opencv(board: Array, views: list[BoardView]) -> Array:
    """fx, fy, cx, cy of calibrateCamera, which believes the board."""
    points = [board[view.ids].astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32)[:, None] for view in views]
    K = cv2.calibrateCamera(points, pixels, SIZE, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3)[
        1
    ]
    return np.asarray(K, np.float64)[[0, 1, 0, 1], [0, 1, 2, 2]]
