"""What a printed square that is larger than stated does to the pose that is measured from it.

Every picture of one print errs by the same two shares of its size, in x and in y; how that moves the pose
depends on where it was seen from. So it is no noise of a picture: who measures one print in many
pictures takes the two as unknowns, who has one picture adds `print_covariance` to its own.
"""

import numpy as np

from vgrd.geometry.camera import CameraModel
from vgrd.geometry.pose import Array, Pose

_STEP = 1e-4  # of the size, and mm and rad of the pose, of central differences


def pose_by_size(camera: CameraModel, size_mm: float, camera_from_tag: Pose) -> Array:
    """Derivative (6, 2) of the measured pose (left tangent, mm and rad) by the print's size in x and y.

    By a share of the size: 0.001 is a print 0.1 % larger than stated. The four corners count alike: their
    covariance, as fits tell it, changes this by less than 1 % of what it is (tilts from 10 degrees on).
    """
    half = size_mm / 2
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    moves = []
    for axis in np.eye(6):
        ahead, behind = (
            camera.project(Pose.exp(sign * _STEP * axis) @ camera_from_tag @ corners)
            for sign in (1, -1)
        )
        moves.append((ahead - behind).ravel() / (2 * _STEP))
    J = np.column_stack(moves)
    G = corners_by_size(camera, corners, camera_from_tag)
    return np.asarray(np.linalg.lstsq(J, G, rcond=None)[0])


def corners_by_size(camera: CameraModel, corners: Array, camera_from_tag: Pose) -> Array:
    """Derivative (8, 2) of the corners (4, 3), px, by the print's size in x and y, as shares of it."""
    moves = []
    for axis in np.eye(3)[:2]:
        step = _STEP * corners * axis
        ahead = camera.project(camera_from_tag @ (corners + step))
        behind = camera.project(camera_from_tag @ (corners - step))
        moves.append((ahead - behind).ravel() / (2 * _STEP))
    return np.column_stack(moves)


def print_covariance(
    camera: CameraModel, size_mm: float, camera_from_tag: Pose, size: float
) -> Array:
    """What a print that is exact to `size` (a share, in x and in y) adds to the covariance (6, 6) of one picture.

    Its bend counts too: at a tilt of 20 degrees, a print off by 0.1 % moves the pose by 18 standard
    deviations of good pixels, and a straight line misses that by one of them.
    """
    slope = size * pose_by_size(camera, size_mm, camera_from_tag)
    total = slope @ slope.T
    for k in range(2):
        ahead, behind = (
            size
            * pose_by_size(camera, size_mm, Pose.exp(sign * slope[:, k]) @ camera_from_tag)[:, k]
            for sign in (1, -1)
        )
        bend = (ahead - behind) / 2
        total += np.outer(bend, bend)
    return np.asarray(total)
