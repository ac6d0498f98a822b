"""What uncertain intrinsics mean in mm: the error of a point beside tag B, seen from tag A."""

from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.vision.print.codes import square_corners

_HALF_SPAN_MM, _LEVER_MM = 60.0, 60.0  # guesses: tags 120 mm apart, target 60 from B
_SPAN_SHARE = 0.3  # of the picture's height, where that is less: both tags lie in it
_TILT_RAD = np.radians(20.0)  # a guess: tags at work about face the camera
_TRIALS, _SEED = 60, 20  # a guess: of the mean one digit matters; any: the same at each run
_ORDER = [3, 4, 5, 0, 1, 2]  # OpenCV's columns of rotation and translation as (v, w)


@dataclass(frozen=True, slots=True)
class Effect:
    """1 sigma of an expected coordinate because of the intrinsics alone: rms in the plane of tag A, and along z."""

    distance_mm: float
    tag_mm: float
    xy_mm: float
    z_mm: float


def effect_on_coordinates(
    camera: CameraModel, covariance: Array, distance_mm: float, tag_mm: float
) -> Effect:
    """Propagate the covariance (4 + k, 4 + k) through tags with perfect corners, averaged over their poses."""
    rng = np.random.default_rng(_SEED)
    focal = float(camera.matrix[1, 1])
    half_span = min(_HALF_SPAN_MM, _SPAN_SHARE * camera.size_px[1] / focal * distance_mm)
    squares = np.zeros(3)
    for _ in range(_TRIALS):
        angle, direction = rng.uniform(0, 2 * np.pi, 2)
        offset = half_span * np.array([np.cos(angle), np.sin(angle), 0.0])
        sight = np.array([0.0, 0.0, distance_mm])
        a, b = (_tilted(rng, sight + sign * offset) for sign in (1, -1))
        target = b @ (_LEVER_MM * np.array([np.cos(direction), np.sin(direction), 0.0]))
        drift = _pose_drift(camera, len(covariance), b, tag_mm)
        drift -= _pose_drift(camera, len(covariance), a, tag_mm)
        J = a.rotation.T @ np.hstack([np.eye(3), -hat(target)]) @ drift
        squares += np.diag(J @ covariance @ J.T)
    x, y, z = squares / _TRIALS
    return Effect(distance_mm, tag_mm, float(np.sqrt(x + y)), float(np.sqrt(z)))


def _tilted(rng: np.random.Generator, place: Array) -> Pose:
    axis, turn = rng.uniform(0, 2 * np.pi, 2)
    tilt = rng.uniform(0, _TILT_RAD) * np.array([np.cos(axis), np.sin(axis), 0.0])
    tilted = Pose.from_rotvec(tilt).rotation @ Pose.from_rotvec([0, 0, turn]).rotation
    return Pose(tilted, place)


def _pose_drift(camera: CameraModel, unknowns: int, pose: Pose, tag_mm: float) -> Array:
    """Change (6, 4 + k) of a tag's estimated pose, left tangent, with the intrinsics."""
    zero = np.zeros(3)
    distortion = camera.distortion
    _, D = cv2.projectPoints(pose @ square_corners(tag_mm), zero, zero, camera.matrix, distortion)
    return -np.linalg.pinv(D[:, _ORDER]) @ D[:, 6 : 6 + unknowns]
