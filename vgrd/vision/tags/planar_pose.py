"""Poses of a planar target from its four corners and their covariance: both solutions, weighed.

The corners of a photometric fit carry all that the pixels tell; a pose that fits them best by their
covariance is the pose that fits the pixels best. Eight numbers for six unknowns: the cost of a true
pose is chi-square with two degrees of freedom.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.geometry import Array, Pose, nearest_rotation
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import sqrt_information
from vgrd.geometry.pose import exp_rotation
from vgrd.geometry.print_size import corners_by_size
from vgrd.vision.images.compiling import compiled
from vgrd.vision.images.warp import lens_vector, project, slopes

_STEPS = 60  # at most: a slow descent that ended early was taken for a second pose
_STILL = 1e-6  # of (1 + chi-square); a thousandth of a sigma
_UNDAMPED = 1e-9  # a step with more damping is short for that alone: it shows no minimum
_RIDGE = 1e-15  # on the diagonal of unit columns: rounding, but a singular matrix becomes solvable
_SAME_RAD = np.radians(0.01)  # of two descents into one minimum; a guess: two lie degrees apart
MOST_MISFIT_PX = 0.5  # rms beyond which no pose fits; a guess: a bent tag leaves more
_SURPRISING = 9.21  # chi-square of two degrees of freedom: one true print in a hundred
LEAST_TILT_DEG = 10.0  # a guess: foreshortening, 1 - cos, is 1.5 % there and hardly tells a tilt
_BRANCH_MARGIN = 25.0  # chi-square by which the second solution must be worse: 5 sigma
_SHELF_STEPS = 3  # for four numbers, nearly linear: the third moves the cost by less than 0.01


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPose:
    """camera_from_target, mm; cost: chi-square of its corners; covariance (6, 6), left tangent (v, w).

    misfit: chi-square, of two degrees of freedom, of what no error of the target's size explains.
    """

    pose: Pose
    cost: float
    covariance: Array
    misfit: float

    @property
    def inflation(self) -> float:
        """The misfit per degree of freedom (8 numbers less 6 unknowns); 1 where chance explains it."""
        return self.misfit / 2 if self.misfit > _SURPRISING else 1.0

    @property
    def inflated_covariance(self) -> Array:
        """The covariance (6, 6) times the inflation; errors of the print's size are not in it."""
        return self.covariance * self.inflation

    @property
    def tilt_deg(self) -> float:
        """Angle between the target's normal and the line of sight to its origin."""
        sight = self.pose.translation / np.linalg.norm(self.pose.translation)
        cosine = abs(float(sight @ self.pose.rotation[:, 2]))
        return float(np.degrees(np.arccos(min(cosine, 1.0))))

    def misfit_px(self, camera: CameraModel, corners_in_target: Array, corners_px: Array) -> float:
        """Root mean square of the corners' residuals: the target's (4, 3), projected, less those seen (4, 2)."""
        residuals = camera.project(self.pose @ corners_in_target) - corners_px
        return float(np.sqrt(np.mean(residuals**2)))


def is_ambiguous(poses: Sequence[PlanarPose]) -> bool:
    """Whether two poses explain the picture; poses as `planar_poses` gives them."""
    if len(poses) < 2:
        return False
    best, other = poses[:2]
    return other.cost - best.cost < _BRANCH_MARGIN * max(best.cost / 2, 1.0)


def planar_poses(
    camera: CameraModel,
    corners_in_target: Array,
    corners_px: Array,
    covariance: Array,
    size: float = 0.0,
) -> list[PlanarPose]:
    """Both poses, best first; one where the picture shows one, none where none is in front.

    Of a small, nearly frontal target the mirrored tilt may be no minimum, and fit nearly as well; it is
    listed where the covariance of the best pose excludes it.

    corners_in_target: (4, 3) with z = 0, mm; corners_px (4, 2); covariance (8, 8) px^2. size:
    standard deviation of the target's size in x and in y, as a share of it: no such error is in the
    poses' covariances, since all pictures of one print share it.
    """
    W = sqrt_information(covariance)
    poses: list[PlanarPose] = []
    _, rotvecs, translations, _ = cv2.solvePnPGeneric(
        corners_in_target, corners_px, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    for rotvec, translation in zip(rotvecs, translations, strict=True):
        if not (np.isfinite(rotvec).all() and translation[2, 0] > 0):
            continue
        start = Pose.from_rotvec(rotvec[:, 0], translation[:, 0])
        candidate = _refined(camera, corners_in_target, corners_px, W, start, size)
        if candidate is not None and not any(_same(candidate, other) for other in poses):
            poses.append(candidate)
    if len(poses) == 1:
        poses += _shelf(camera, corners_in_target, corners_px, W, poses[0])
    return sorted(poses, key=lambda pose: pose.cost)


def _shelf(
    camera: CameraModel, corners: Array, corners_px: Array, W: Array, best: PlanarPose
) -> list[PlanarPose]:
    """The pose of mirrored tilt, where the picture leaves it open and the best pose's covariance does not."""
    sight = best.pose.translation / np.linalg.norm(best.pose.translation)
    normal = best.pose.rotation[:, 2]
    cosine = float(normal @ sight)
    axis = np.cross(normal, sight) * np.sign(cosine)
    turn = 2 * np.arctan2(np.linalg.norm(axis), abs(cosine)) * axis
    turn /= max(float(np.linalg.norm(axis)), 1e-12)  # a frontal one is its own mirror
    if turn @ np.linalg.solve(best.covariance[3:, 3:], turn) < _BRANCH_MARGIN:
        return []
    R, t, cost = _level_fit(
        lens_vector(camera),
        corners,
        corners_px,
        W,
        exp_rotation(turn) @ best.pose.rotation,
        best.pose.translation.copy(),
    )
    other = PlanarPose(Pose(nearest_rotation(R), t), cost, best.covariance, best.misfit)
    return [other] if is_ambiguous([best, other]) else []


def _same(pose: PlanarPose, other: PlanarPose) -> bool:
    return bool(pose.pose.distance(other.pose)[1] < _SAME_RAD)


def _refined(
    camera: CameraModel, corners: Array, corners_px: Array, W: Array, start: Pose, size: float
) -> PlanarPose | None:
    """Damped Gauss-Newton; None when it ends behind the camera."""
    R, t, cost, J = _descend(
        lens_vector(camera),
        corners,
        corners_px,
        W,
        start.rotation.copy(),
        start.translation.copy(),
    )
    if not (np.isfinite(cost) and t[2] > 0):
        return None
    spread = np.linalg.inv(np.linalg.qr(J).R)
    pose = Pose(nearest_rotation(R), t)
    left_over = np.linalg.svd(J)[0][:, 6:].T
    by_size = size * left_over @ W @ corners_by_size(camera, corners, pose)
    r = left_over @ W @ (corners_px - camera.project(pose @ corners)).ravel()
    misfit = float(r @ np.linalg.solve(np.eye(2) + by_size @ by_size.T, r))
    return PlanarPose(pose, cost, spread @ spread.T, misfit)


@compiled
def _linearized(
    lens: Array, corners: Array, corners_px: Array, W: Array, R: Array, t: Array
) -> tuple[Array, Array]:
    """Whitened residuals (8,) and the derivative (8, 6) of the corners by a left perturbation."""
    r, J = np.empty(8), np.empty((8, 6))
    for i in range(4):
        x, y, z = R @ corners[i] + t
        u, v = project(lens, x / z, y / z)
        a, b, c, d = slopes(lens, x / z, y / z)
        r[2 * i], r[2 * i + 1] = corners_px[i, 0] - u, corners_px[i, 1] - v
        for row, (p, q) in enumerate(((a, b), (c, d))):
            gx, gy = p / z, q / z
            gz = -(gx * x + gy * y) / z
            k = 2 * i + row
            J[k, 0], J[k, 1], J[k, 2] = gx, gy, gz
            J[k, 3], J[k, 4], J[k, 5] = gz * y - gy * z, gx * z - gz * x, gy * x - gx * y
    return W @ r, W @ J


@compiled
def _rotation_by(w: Array) -> Array:
    """Rotation (3, 3) by a vector."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    K = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    sine, versine = 1.0, 0.5
    if angle > 1e-8:  # below, the series differs by 1e-17
        sine, versine = math.sin(angle) / angle, 2 * (math.sin(angle / 2) / angle) ** 2
    return np.asarray(np.eye(3) + K * sine + K @ K * versine)


@compiled
def _level_fit(
    lens: Array, corners: Array, corners_px: Array, W: Array, R: Array, t: Array
) -> tuple[Array, Array, float]:
    """Rotation, translation and cost of the best pose whose normal is that of R."""
    for _ in range(_SHELF_STEPS):
        r, J = _linearized(lens, corners, corners_px, W, R, t)
        level = np.empty((8, 4))
        level[:, :3] = J[:, :3]
        level[:, 3] = J[:, 3] * R[0, 2] + J[:, 4] * R[1, 2] + J[:, 5] * R[2, 2]
        scale = 1 / np.sqrt(np.sum(level * level, axis=0))
        scaled = level * scale
        step = scale * np.linalg.solve(scaled.T @ scaled + _RIDGE * np.eye(4), scaled.T @ r)
        turn = _rotation_by(step[3] * R[:, 2])
        R, t = turn @ R, turn @ t + step[:3]
    r, _ = _linearized(lens, corners, corners_px, W, R, t)
    return R, t, float(r @ r)


@compiled
def _descend(
    lens: Array, corners: Array, corners_px: Array, W: Array, R: Array, t: Array
) -> tuple[Array, Array, float, Array]:
    """Rotation, translation, cost and the whitened derivative at the minimum; infinite cost if lost."""
    damping = 0.0
    r, J = _linearized(lens, corners, corners_px, W, R, t)
    cost = float(r @ r)
    for _ in range(_STEPS):
        scale = 1 / np.sqrt(np.sum(J * J, axis=0))
        scaled = J * scale
        A = scaled.T @ scaled + (damping + _RIDGE) * np.eye(6)
        step = scale * np.linalg.solve(A, scaled.T @ r)
        turn = _rotation_by(step[3:])
        R_new, t_new = turn @ R, turn @ t + step[:3]
        r_new, J_new = _linearized(lens, corners, corners_px, W, R_new, t_new)
        trial = float(r_new @ r_new)
        is_last = damping <= _UNDAMPED and abs(cost - trial) < _STILL * (1 + cost)
        if trial <= cost:
            R, t, r, J, cost = R_new, t_new, r_new, J_new, trial
            damping /= 10
        else:
            damping = max(10 * damping, _UNDAMPED)
        if is_last:
            break
    return R, t, cost, J
