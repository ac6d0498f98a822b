"""Both poses of a tag: each is a minimum, and almost frontal ones are told apart or are one."""

import numpy as np
from scipy.optimize import least_squares

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


def cost_of_normal(R: np.ndarray, near: Pose, seen: np.ndarray, sigma_px: float) -> float:
    """Least chi-square of a pose whose normal is that of R."""

    def residuals(free: np.ndarray) -> np.ndarray:
        spun = R @ Pose.from_rotvec((0, 0, free[3])).rotation
        at = Pose(spun, near.translation + free[:3])
        return (CAMERA.project(at.apply(CORNERS)) - seen).ravel() / sigma_px

    return 2 * float(least_squares(residuals, np.zeros(4), x_scale=(1, 1, 1, 1e-2)).cost)


def test_a_lone_pose_excludes_its_mirror_or_its_covariance_holds_it():
    rng, sigma_px, lone = np.random.default_rng(7), 0.007, 0
    for _ in range(200):
        lean, spin = np.radians(rng.uniform(0.2, 3)), rng.uniform(-np.pi, np.pi)
        R = (Pose.from_rotvec((lean, 0, 0)) @ Pose.from_rotvec((0, 0, spin))).rotation
        true = Pose(R, np.array([20.0, 10, 1500]))
        seen = CAMERA.project(true.apply(CORNERS)) + rng.normal(0, sigma_px, (4, 2))
        best, *others = planar_poses(CAMERA, CORNERS, seen, sigma_px**2 * np.eye(8))
        if others:
            continue
        lone += 1
        sight = best.pose.translation / np.linalg.norm(best.pose.translation)
        half_turn = 2 * np.outer(sight, sight) - np.eye(3)
        R = half_turn @ best.pose.rotation @ np.diag([-1.0, -1, 1])
        turn = Pose(R @ best.pose.rotation.T, np.zeros(3)).log()[3:]
        if turn @ np.linalg.solve(best.covariance[3:, 3:], turn) > 25:
            assert cost_of_normal(R, best.pose, seen, sigma_px) - best.cost > 25
    assert lone > 0
