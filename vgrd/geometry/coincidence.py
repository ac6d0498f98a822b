"""Points on one line, equal poses: samples that tell nothing new."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from vgrd.geometry.pose import Array, Pose

_ONE_POINT_MM = 1e-9  # spread of points that are all one, which is a line too


def are_in_line(points: Array, share: float) -> bool:
    """Whether points (n, k) spread beside a line by at most `share` of their spread along it."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= share * max(float(spread[0]), _ONE_POINT_MM))


def equal_poses(poses: Sequence[Pose], mm: float, rad: float) -> NDArray[np.bool_]:
    """Matrix (n, n) of which poses are equal: origins within `mm`, entries of the rotation within `rad`."""
    t = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    equal = np.eye(len(t), dtype=bool)
    if len(t) < 2:
        return equal
    i, j = KDTree(t).query_pairs(mm, output_type="ndarray").T
    alike = np.linalg.norm(t[i] - t[j], axis=1) < mm
    alike &= np.abs(R[i] - R[j]).max(axis=(1, 2), initial=0.0) < rad
    equal[i[alike], j[alike]] = equal[j[alike], i[alike]] = True
    return equal


@dataclass(frozen=True, slots=True)
class Difference:
    """From where on two measured poses differ: chi-square of 6, and mm or rad that matter."""

    squared: float
    mm: float
    rad: float

    def is_between(self, pose: Pose, other: Pose, covariance: Array) -> bool:
        """Whether noise, (6, 6) of both together (left tangent), does not explain the two."""
        mm, rad = pose.distance(other)
        xi = (pose @ other.inverse()).log()
        squared = float(xi @ np.linalg.solve(covariance, xi))
        return squared > self.squared and (mm > self.mm or rad > self.rad)
