"""Where the flange must be for a target on the moved object, with what that depends on."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.rows import ObjectMotions
from vgrd.calibration.joint.state import StepLayout, left_jacobian
from vgrd.geometry import Array, Pose, hat
from vgrd.model import Policy

_EYE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class Wish:
    """What is asked: a target as taught, (3,) base, the tip (3,) in the wrist, how the wrist will stand.

    J_taught: (3, n) by the unknowns.
    """

    taught: Array
    J_taught: Array
    tip_in_wrist: Array
    policy: Policy
    R_work: Array


@dataclass(frozen=True, slots=True, eq=False)
class Flange:
    """Flange pose, derivatives (3, n + k) of position and orientation by unknowns and motion."""

    base_from_wrist: Pose
    J: Array
    J_turn: Array


def flange_of(
    base_from_camera: Pose, layout: StepLayout, wish: Wish, motions: ObjectMotions
) -> Flange:
    """Where the flange must be when the object has moved so."""
    X, N = base_from_camera, Pose(motions.rotations[0], motions.translations[0])
    in_camera = N @ (X.inverse() @ wish.taught)
    point = X @ in_camera
    turn = X.rotation @ N.rotation @ X.rotation.T
    n, k = layout.size, motions.J_motion.shape[2]
    J, J_turn = np.zeros((3, n + k)), np.zeros((3, n + k))
    motion = np.zeros((6, n + k))
    motion[:, layout.axis_columns], motion[:, n:] = motions.J_axis[0], motions.J_motion[0]
    J += X.rotation @ left_jacobian(in_camera[None])[0] @ motion
    J[:, :n] += turn @ wish.J_taught
    J[:, layout.CAMERA] = (
        left_jacobian(point[None])[0] - turn @ left_jacobian(wish.taught[None])[0]
    )
    R = wish.R_work
    if wish.policy is Policy.FOLLOW:
        R = turn @ R
        J_turn += X.rotation @ motion[3:]
        J_turn[:, layout.CAMERA.start + 3 : layout.CAMERA.stop] = _EYE - turn
    tip = R @ wish.tip_in_wrist
    J += hat(tip) @ J_turn
    J[:, layout.TCP] = -R
    return Flange(Pose(R, point - tip), J, J_turn)
