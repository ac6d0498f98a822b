"""Poses of a planar target from its four corners and their covariance: both solutions, weighed.

The corners of a photometric fit carry all that the pixels tell; a pose that fits them best by their
covariance is the pose that fits the pixels best. Eight numbers for six unknowns: the cost of a true
pose is chi-square with two degrees of freedom.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import whitener

_STEPS = 12
_STILL = 1e-6  # chi-square
_SAME_RAD = np.radians(0.01)


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPose:
    """camera_from_target, mm; cost: chi-square of its corners; covariance (6, 6), left tangent (v, w)."""

    pose: Pose
    cost: float
    covariance: Array


def planar_poses(
    camera: CameraModel, corners_in_target: Array, corners_px: Array, covariance: Array
) -> list[PlanarPose]:
    """All poses, best first: two, or one where both run into the same minimum. Empty when none is in front.

    corners_in_target: (4, 3) with z = 0, mm; corners_px (4, 2); covariance (8, 8) px^2.
    """
    W = whitener(covariance)
    found: list[PlanarPose] = []
    _, rotvecs, translations, _ = cv2.solvePnPGeneric(
        corners_in_target, corners_px, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    for rotvec, translation in zip(rotvecs, translations, strict=True):
        if not (np.isfinite(rotvec).all() and translation[2, 0] > 0):
            continue
        start = Pose.from_rotvec(rotvec[:, 0], translation[:, 0])
        candidate = _refined(camera, corners_in_target, corners_px, W, start)
        if candidate is not None and not any(_same(candidate, other) for other in found):
            found.append(candidate)
    return sorted(found, key=lambda pose: pose.cost)


def _same(one: PlanarPose, other: PlanarPose) -> bool:
    return bool(one.pose.distance(other.pose)[1] < _SAME_RAD)


def _refined(
    camera: CameraModel, corners: Array, corners_px: Array, W: Array, pose: Pose
) -> PlanarPose | None:
    """Damped Gauss-Newton; None when it ends behind the camera."""
    damping, (r, J) = 0.0, _linearized(camera, corners, corners_px, W, pose)
    cost = float(r @ r)
    for _ in range(_STEPS):
        scale = 1 / np.linalg.norm(J, axis=0)
        A = (J * scale).T @ (J * scale)
        step = scale * np.linalg.solve(A + damping * np.eye(6), scale * (J.T @ r))
        trial = Pose.exp(step) @ pose
        r_new, J_new = _linearized(camera, corners, corners_px, W, trial)
        trial_cost = float(r_new @ r_new)
        if not np.isfinite(trial_cost):
            return None
        if trial_cost <= cost:
            gain = cost - trial_cost
            pose, r, J, cost, damping = trial, r_new, J_new, trial_cost, damping / 10
            if gain < _STILL * (1 + cost):
                break
        else:
            damping = max(10 * damping, 1e-9)
    spread = np.linalg.inv(np.linalg.qr(J).R)
    return PlanarPose(pose, cost, spread @ spread.T)


def _linearized(
    camera: CameraModel, corners: Array, corners_px: Array, W: Array, pose: Pose
) -> tuple[Array, Array]:
    """Whitened residuals (8,) and the derivative (8, 6) of the corners by a left perturbation."""
    points = pose.apply(corners)
    pixels, by_point = camera.linearize(points)
    J = np.concatenate([by_point, -by_point @ hat(points)], axis=2).reshape(8, 6)
    return W @ (corners_px - pixels).ravel(), W @ J
