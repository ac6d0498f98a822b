"""Hand-eye by others: cv2's closed forms, reprojection error alone, levels of noise of poses (Nelder-Mead).

Each is a function of a recording and of the samples it may use; it returns (X, Y), (4, 4):
camera_from_target = X^-1 M Y, M = base_from_wrist for a fixed camera, its inverse for one in the hand.
"""

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

from tests.benchmarks.hand_eye.recordings import Array, Recorded, matrix

Poses = tuple[Array, Array]
Solver = Callable[[Recorded, Sequence[int]], Poses]
PAIR_MM, PAIR_RAD = 1.0, 2e-3  # how a pair's position and turn are weighed where nothing is known
LOW, HIGH = np.log([0.01, 0.005, 1e-5]), np.log([50, 50, 0.2])  # px, mm, rad
STARTS = np.log([[0.3, 1.0, 5e-3], [2.0, 0.1, 5e-4], [0.3, 3.0, 2e-2]])


def moves(recorded: Recorded, chosen: Sequence[int]) -> Array:
    """M of every sample."""
    H = recorded.flange[list(chosen)]
    return np.linalg.inv(H) if recorded.in_hand else H


def predicted(recorded: Recorded, poses: Poses, index: int) -> Array:
    """camera_from_target of a sample."""
    X, Y = poses
    return np.asarray(np.linalg.inv(X) @ moves(recorded, [index])[0] @ Y)


def _closed(flag: int) -> Solver:
    def solve(recorded: Recorded, chosen: Sequence[int]) -> Poses:
        M = moves(recorded, chosen)
        gripper = np.linalg.inv(M)  # a fixed camera is one in the hand of the moving base
        C = np.array([recorded.own(i) for i in chosen])
        R, t = cv2.calibrateHandEye(
            list(gripper[:, :3, :3]),
            list(gripper[:, :3, 3]),
            list(C[:, :3, :3]),
            list(C[:, :3, 3]),
            method=flag,
        )
        X = matrix(R, t.ravel())
        return X, middle(gripper @ X @ C)

    return solve


def _robot_world(flag: int) -> Solver:
    def solve(recorded: Recorded, chosen: Sequence[int]) -> Poses:
        M = moves(recorded, chosen)
        C = np.array([recorded.own(i) for i in chosen])
        R_Y, t_Y, R, t = cv2.calibrateRobotWorldHandEye(
            list(C[:, :3, :3]),
            list(C[:, :3, 3]),
            list(M[:, :3, :3]),
            list(M[:, :3, 3]),
            method=flag,
        )
        # cv2: A X = Z B with A = camera_from_target, X = target_from_base, Z = camera_from_gripper
        return np.linalg.inv(matrix(R, t.ravel())), np.linalg.inv(matrix(R_Y, t_Y.ravel()))

    return solve


def middle(poses: Array) -> Array:
    """Mean turn, median place."""
    R = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
    return matrix(R, np.median(poses[:, :3, 3], axis=0))


def reprojection(recorded: Recorded, chosen: Sequence[int]) -> Poses:
    """Least squares of pixels, robot believed; of pairs: of places and turns."""
    M = moves(recorded, chosen)
    own = np.array([recorded.own(i) for i in chosen])
    X0, Y0 = METHODS["park"](recorded, chosen)

    def residuals(step: Array) -> Array:
        X, Y = moved(X0, step[:6]), moved(Y0, step[6:])
        seen = np.linalg.inv(X) @ M @ Y
        if recorded.seen is not None:
            turn = Rotation.from_matrix(seen[:, :3, :3] @ own[:, :3, :3].transpose(0, 2, 1))
            shift = seen[:, :3, 3] - own[:, :3, 3]
            return np.concatenate([shift.ravel() / PAIR_MM, turn.as_rotvec().ravel() / PAIR_RAD])
        rows = []
        for T, i in zip(seen, chosen, strict=True):
            turn = cv2.Rodrigues(T[:3, :3])[0]
            uv = cv2.projectPoints(
                recorded.points[i], turn, T[:3, 3], recorded.K, recorded.distortion
            )[0]
            rows.append((uv.reshape(-1, 2) - recorded.pixels[i]).ravel())
        return np.concatenate(rows)

    step = least_squares(residuals, np.zeros(12), x_scale=[1, 1, 1, 1e-3, 1e-3, 1e-3] * 2).x
    return moved(X0, step[:6]), moved(Y0, step[6:])


def moved(T: Array, step: Array) -> Array:
    """exp(step) T, step (..., 6), translation not coupled."""
    out = np.array(T)
    R = Rotation.from_rotvec(step[3:]).as_matrix()
    out[:3, :3], out[:3, 3] = R @ T[:3, :3], R @ T[:3, 3] + step[:3]
    return out


def levels(recorded: Recorded, chosen: Sequence[int]) -> Poses:
    """Pixels, arm's places and turns as three levels; restricted likelihood over poses, Nelder-Mead."""
    M = moves(recorded, chosen)
    C = np.array([recorded.own(i) for i in chosen])
    P = np.array([_spread(recorded, i, T) for i, T in zip(chosen, C, strict=True)])
    start = METHODS["park"](recorded, chosen)
    best: list[tuple[float, Poses]] = []

    def cost(x: Array) -> float:
        near = best[0][1] if best else start
        try:
            value, poses = _weighted(M, C, P, recorded.in_hand, np.clip(x, LOW, HIGH), *near)
        except np.linalg.LinAlgError:
            return 1e9
        if not best or value < best[0][0]:
            best[:] = [(value, poses)]
        return value

    for first in STARTS:
        options = {"maxfev": 60, "xatol": 0.05, "fatol": 0.02}
        minimize(cost, first, method="Nelder-Mead", options=options)
    return best[0][1]


def _spread(recorded: Recorded, index: int, T: Array) -> Array:
    """(6, 6) covariance of a sample's own pose for a noise of 1: one pixel, or 1 mm and 2 mrad."""
    if recorded.seen is not None:
        A = np.eye(6)
        A[:3, 3:] = _hats(T[:3, 3])
        return np.asarray(A * np.square([PAIR_MM] * 3 + [PAIR_RAD] * 3) @ A.T)
    q = recorded.points[index] @ T[:3, :3].T + T[:3, 3]
    assert recorded.K is not None
    fx, fy = recorded.K[0, 0], recorded.K[1, 1]
    by_point = np.zeros((len(q), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 2] = fx / q[:, 2], -fx * q[:, 0] / q[:, 2] ** 2
    by_point[:, 1, 1], by_point[:, 1, 2] = fy / q[:, 2], -fy * q[:, 1] / q[:, 2] ** 2
    by_pose = np.concatenate([np.broadcast_to(np.eye(3), (len(q), 3, 3)), -_hats(q)], axis=2)
    J = (by_point @ by_pose).reshape(-1, 6)
    return np.asarray(np.linalg.inv(J.T @ J))


def _hats(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    return np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2)


def _carriers(T: Array) -> Array:
    """Adjoints (n, 6, 6)."""
    A = np.zeros((len(T), 6, 6))
    A[:, :3, :3] = A[:, 3:, 3:] = T[:, :3, :3]
    A[:, :3, 3:] = _hats(T[:, :3, 3]) @ T[:, :3, :3]
    return A


def _weighted(
    M: Array, C: Array, P: Array, in_hand: bool, x: Array, X: Array, Y: Array
) -> tuple[float, Poses]:
    px, mm, rad = np.exp(x)
    arm = np.diag([mm**2] * 3 + [rad**2] * 3)
    value = np.inf
    for _ in range(15):
        inverse = np.linalg.inv(X)
        turn = inverse @ M
        seen = turn @ Y
        rotation = seen[:, :3, :3] @ C[:, :3, :3].transpose(0, 2, 1)
        w = Rotation.from_matrix(rotation).as_rotvec()
        shift = seen[:, :3, 3] - np.einsum("nij,nj->ni", rotation, C[:, :3, 3])
        e = np.concatenate([shift, w], axis=1)
        by_X, by_Y = _carriers(inverse[None]), _carriers(turn)
        by_arm = by_X if in_hand else by_Y
        S = px**2 * P + by_arm @ arm @ by_arm.transpose(0, 2, 1)
        J = np.concatenate([np.broadcast_to(-by_X, by_Y.shape), by_Y], axis=2)
        A = np.einsum("nji,njk->ik", J, np.linalg.solve(S, J))
        weighted = np.linalg.solve(S, e[:, :, None])[:, :, 0]
        g = np.einsum("nji,nj->i", J, weighted)
        value = float(np.sum(e * weighted) + np.linalg.slogdet(S)[1].sum())
        value += float(np.linalg.slogdet(A)[1])
        step = -np.linalg.solve(A, g)
        X, Y = moved(X, step[:6]), moved(Y, step[6:])
        if np.abs(step).max() < 1e-4:
            break
    return value, (X, Y)


METHODS: Mapping[str, Solver] = {
    "tsai": _closed(cv2.CALIB_HAND_EYE_TSAI),
    "park": _closed(cv2.CALIB_HAND_EYE_PARK),
    "horaud": _closed(cv2.CALIB_HAND_EYE_HORAUD),
    "daniilidis": _closed(cv2.CALIB_HAND_EYE_DANIILIDIS),
    "shah": _robot_world(cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH),
    "li": _robot_world(cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI),
    "reprojection": reprojection,
    "levels": levels,
}
