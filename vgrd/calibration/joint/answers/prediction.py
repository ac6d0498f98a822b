"""An expected coordinate and the errors it consists of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A flange pose, position corrected by the arm's field, and the errors it consists of.

    J_unknowns (3, n): by the joint estimate; J_picture (3, 6): by the left tangent of tag B; J_arm
    (3, w): by the arm's deviation there, and before it, where tag A is used, in the picture;
    arm_covariance (w, w): of what is left of that. J_camera (3, c): by the noise of tag A and the
    camera's displacement, in sigmas. J_turn_*: the same for the orientation, rad. taught_from_camera:
    how the camera has moved, as estimated; fits_model: the object moved as it can.
    """

    base_from_wrist: Pose
    J_unknowns: Array
    J_picture: Array
    J_arm: Array
    arm_covariance: Array
    J_camera: Array
    J_turn_unknowns: Array
    J_turn_picture: Array
    J_turn_arm: Array
    J_turn_camera: Array
    taught_from_camera: Pose
    fits_model: bool

    def covariance(self, estimate: Array, tag_b: Array) -> Array:
        """(3, 3) of the position, mm^2; estimate (n, n), tag_b (6, 6): covariances."""
        by = (self.J_unknowns, self.J_picture, self.J_arm, self.J_camera)
        return _summed(by, (estimate, tag_b, self.arm_covariance, np.eye(self.J_camera.shape[1])))

    def turn_covariance(self, estimate: Array, tag_b: Array) -> Array:
        """(3, 3) of the orientation, rad^2."""
        by = (self.J_turn_unknowns, self.J_turn_picture, self.J_turn_arm, self.J_turn_camera)
        return _summed(by, (estimate, tag_b, self.arm_covariance, np.eye(self.J_camera.shape[1])))


def _summed(derivatives: Sequence[Array], covariances: Sequence[Array]) -> Array:
    total = np.zeros((3, 3))
    for J, covariance in zip(derivatives, covariances, strict=True):
        total += J @ covariance @ J.T
    return total
