"""What a hand-eye fit estimates: the two poses and what is refined beside them."""

from dataclasses import dataclass, field, replace

import numpy as np

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.rotation_relaxation import Certificate
from vgrd.model import Mount


def flange_motion_of(mount: Mount, base_from_wrist: Pose) -> Pose:
    """M of the module's equation."""
    return base_from_wrist if mount is Mount.EYE_TO_HAND else base_from_wrist.inverse()


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """State of the estimate: X, Y, and what a recording refines beside them.

    certificate: of the start, None where it was given. points: (k, 3) of the target, mm, that are
    not known exactly; prior_points (k, 3), prior_sigma_mm (k,): what is known of them.
    """

    X: Pose = field(default_factory=Pose.identity)
    Y: Pose = field(default_factory=Pose.identity)
    camera: CameraModel | None = None
    scale: float = 1.0
    refines_camera: bool = False
    refines_scale: bool = False
    certificate: Certificate | None = None
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    prior_points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    prior_sigma_mm: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def extra(self) -> int:
        """Number of unknowns beside the two poses."""
        return 6 * self.refines_camera + self.points.size + self.refines_scale

    def predict(self, mount: Mount, base_from_wrist: Pose) -> Pose:
        """camera_from_target at a flange pose."""
        return self.X.inverse() @ flange_motion_of(mount, base_from_wrist) @ self.Y

    def retract(self, step: Array) -> "HandEye":
        """Left perturbations of X and Y; intrinsics and points added; scale multiplied."""
        camera, scale = self.camera, self.scale
        if camera is not None and self.refines_camera:
            camera = camera.with_intrinsics(_moved_intrinsics(camera.intrinsics(), step[12:18]))
        if self.refines_scale:
            scale = scale * float(np.exp(np.clip(step[-1], -1, 1)))
        X, Y = Pose.exp(step[:6]) @ self.X, Pose.exp(step[6:12]) @ self.Y
        points = self.points + step[self.point_columns].reshape(-1, 3)
        return replace(self, X=X, Y=Y, camera=camera, scale=scale, points=points)

    @property
    def point_columns(self) -> slice:
        """Where the points stand in a step."""
        first = 12 + 6 * self.refines_camera
        return slice(first, first + self.points.size)

    def anchors(self) -> tuple[Array, Array]:
        """What is known of the points: residuals (3 k,), derivatives (3 k, 12 + extra)."""
        weights = np.repeat(1 / self.prior_sigma_mm, 3)
        J = np.zeros((self.points.size, 12 + self.extra))
        J[:, self.point_columns] = np.diag(weights)
        return (self.points - self.prior_points).ravel() * weights, J


def _moved_intrinsics(values: Array, step: Array) -> Array:
    """Focal lengths stay positive whatever the step: they are multiplied, the rest is added."""
    intrinsics = values + step
    intrinsics[:2] = values[:2] * np.exp(np.clip(step[:2] / values[:2], -1, 1))
    return intrinsics
