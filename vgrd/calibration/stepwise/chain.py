"""How the object moved, seen from where the camera stood while teaching: Eq. 5 and 19 with their uncertainty."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.stepwise.camera import SeenTag
from vgrd.geometry import Array, Pose, hat
from vgrd.judging.thresholds import CENTER_MM
from vgrd.model import PlacedPoint, frozen_array

_EYE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class Pivot:
    """A point of the object that stays where it is when the object turns (rotation centre).

    in_tag_b: (3,), covariance: (3, 3) of it. in_base: (3,); for a constant wrist, where the flange
    stands when the work tip is on the pivot.
    """

    in_tag_b: Array
    in_base: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class MovedPoint:
    """A point of the reference, carried along with the object.

    position: (3,) now, base. rotation: (3, 3) of the object since the reference, base.
    covariance: (3, 3) mm^2 from hand-eye, both pictures and the pivot's place in tag B.
    """

    position: Array
    rotation: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraChain:
    """base_from_camera with its covariance (6, 6), and tag B in the reference picture with its own."""

    base_from_camera: Pose
    hand_eye_covariance: Array
    camera_from_tag_b: Pose
    reference_covariance: Array

    def in_tag_b(self, point: Array, covariance: Array) -> PlacedPoint:
        """Eq. 6 at the reference: a point (3,) of the base, with its covariance (3, 3), in tag B's frame."""
        X, F = self.base_from_camera, self.camera_from_tag_b
        in_camera = X.inverse() @ point
        J_camera = np.hstack([_EYE, -hat(point)])
        J_tag = X.rotation @ np.hstack([_EYE, -hat(in_camera)])
        in_base = (
            covariance
            + _quadratic(J_camera, self.hand_eye_covariance)
            + _quadratic(J_tag, self.reference_covariance)
        )
        R = (X @ F).rotation
        return PlacedPoint(
            frozen_array(F.inverse() @ in_camera, 3), frozen_array(R.T @ in_base @ R, 3, 3)
        )

    def move_about(self, pivot: Pivot, point: Array, now: SeenTag) -> MovedPoint:
        """Eq. 19: turn about the pivot, plus how far the pivot moved; only the rotation of the hand-eye counts."""
        R_bc = self.base_from_camera.rotation
        ref, C = self.camera_from_tag_b, now.camera_from_tag
        R_Q = C.rotation @ ref.rotation.T
        pivot_ref, pivot_now = ref @ pivot.in_tag_b, C @ pivot.in_tag_b
        arm = R_bc.T @ (point - pivot.in_base)
        turn = R_bc @ R_Q @ R_bc.T
        shift = R_bc @ (pivot_now - pivot_ref)
        u, v = R_bc @ arm, R_bc @ (R_Q @ arm)
        J_now = R_bc @ np.hstack([_EYE, -hat(pivot_now + R_Q @ arm)])
        J_ref = -R_bc @ np.hstack([_EYE, -hat(pivot_ref) - R_Q @ hat(arm)])
        J_hand_eye = J_now @ now.J_hand_eye
        J_hand_eye[:, 3:] += turn @ hat(u) - hat(v) - hat(shift)
        J_pivot = R_bc @ (C.rotation - ref.rotation)
        covariance = (
            _quadratic(J_now, now.covariance)
            + _quadratic(J_ref, self.reference_covariance)
            + _quadratic(J_hand_eye, self.hand_eye_covariance)
            + _quadratic(J_pivot, pivot.covariance)
        )
        return MovedPoint(pivot.in_base + v + shift, turn, covariance)

    def pivot_shift(self, pivot: Pivot, now: SeenTag) -> tuple[Array, Array]:
        """How far (3,) the pivot moved in the camera, which it should not, and the covariance (3, 3).

        A pivot may come from CAD, whose centre is not quite that of the turntable.
        """
        ref, C = self.camera_from_tag_b, now.camera_from_tag
        pivot_ref, pivot_now = ref @ pivot.in_tag_b, C @ pivot.in_tag_b
        J_now = np.hstack([_EYE, -hat(pivot_now)])
        covariance = (
            _quadratic(J_now, now.covariance)
            + _quadratic(J_now @ now.J_hand_eye, self.hand_eye_covariance)
            + _quadratic(np.hstack([_EYE, -hat(pivot_ref)]), self.reference_covariance)
            + _quadratic(C.rotation - ref.rotation, pivot.covariance + CENTER_MM**2 * _EYE)
        )
        return pivot_now - pivot_ref, covariance

    def move(self, point: Array, now: SeenTag) -> MovedPoint:
        """Motion of the object by the full hand-eye: B M B^-1."""
        B = self.base_from_camera
        M = now.camera_from_tag @ self.camera_from_tag_b.inverse()
        in_camera_ref = B.inverse() @ point
        in_camera_now = M @ in_camera_ref
        position = B @ in_camera_now
        turn = B.rotation @ M.rotation @ B.rotation.T
        J_now = B.rotation @ np.hstack([_EYE, -hat(in_camera_now)])
        J_ref = -B.rotation @ M.rotation @ np.hstack([_EYE, -hat(in_camera_ref)])
        J_hand_eye = np.hstack([_EYE - turn, turn @ hat(point) - hat(position)])
        J_hand_eye += J_now @ now.J_hand_eye
        covariance = (
            _quadratic(J_now, now.covariance)
            + _quadratic(J_ref, self.reference_covariance)
            + _quadratic(J_hand_eye, self.hand_eye_covariance)
        )
        return MovedPoint(position, turn, covariance)

    def rotation_covariance(self, now: SeenTag, turn: Array) -> Array:
        """Covariance (3, 3) rad^2 of the object's rotation `turn` (3, 3) in the base."""
        R_bc = self.base_from_camera.rotation
        J_hand_eye = np.hstack([0 * turn, _EYE - turn]) + R_bc @ now.J_hand_eye[3:]
        return (
            _quadratic(R_bc, now.covariance[3:, 3:])
            + _quadratic(turn @ R_bc, self.reference_covariance[3:, 3:])
            + _quadratic(J_hand_eye, self.hand_eye_covariance)
        )


def _quadratic(J: Array, covariance: Array) -> Array:
    return np.asarray(J @ covariance @ J.T)
