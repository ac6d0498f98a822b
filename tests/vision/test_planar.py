"""Both poses of a tag: each is a minimum, and almost frontal ones are told apart or are one."""

import numpy as np

from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.print.codes import square_corners
from vgrd.vision.tags.planar_pose import is_ambiguous, planar_poses

SIGMA_PX = 0.0015
CORNERS = square_corners(10.0)
CAMERA = CameraModel(
    np.array([[12766.0, 0, 2012], [0, 12766.0, 1518], [0, 0, 1]]),
    np.array([-0.05, 0.1, 0, 0]),
    (4024, 3036),
)
COVARIANCE = SIGMA_PX**2 * np.eye(8)


def almost_frontal(rng: np.random.Generator) -> Pose:
    lean = np.append(rng.normal(0, np.radians(1.2), 2), rng.uniform(-np.pi, np.pi))
    return Pose.from_rotvec(lean, (rng.uniform(-80, 80), rng.uniform(-60, 60), 600.0))


def decrement(pose: Pose, seen: np.ndarray) -> float:
    """By how much a Gauss-Newton step would lower the chi-square of a pose."""

    def residuals(at: Pose) -> np.ndarray:
        return (CAMERA.project(at.apply(CORNERS)) - seen).ravel() / SIGMA_PX

    steps = np.diag([1e-4] * 3 + [1e-6] * 3)
    J = np.array(
        [
            (residuals(Pose.exp(s) @ pose) - residuals(Pose.exp(-s) @ pose)) / (2 * s.sum())
            for s in steps
        ]
    ).T
    Q, _ = np.linalg.qr(J)
    return float(np.sum((Q.T @ residuals(pose)) ** 2))


def test_every_pose_is_a_minimum_and_the_best_one_is_near_the_truth():
    rng = np.random.default_rng(4)
    for _ in range(300):
        true = almost_frontal(rng)
        seen = CAMERA.project(true.apply(CORNERS)) + rng.normal(0, SIGMA_PX, (4, 2))
        found = planar_poses(CAMERA, CORNERS, seen, COVARIANCE)
        assert max(decrement(one.pose, seen) for one in found) < 0.01
        if not is_ambiguous(found):
            turns = [one.pose.distance(true)[1] for one in found]
            assert turns == sorted(turns)
