"""A recording for the judge of hand-eye: poses of the robot with what a camera saw; numpy and cv2 only."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
