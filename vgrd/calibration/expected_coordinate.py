"""Expected coordinates from a calibration and one picture of tag B, with their uncertainty.

The object has turned by R_Q (in the camera) since the reference picture. With a recorded pivot the
flange follows Eq. 19 and only the rotation of the hand-eye counts; without one the full motion
B M B^-1 is applied, B = base_from_camera.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.basis import stored_basis
from vgrd.calibration.joint.expected import expected_from
from vgrd.calibration.observability.motion import SAME_ORIENTATION_RAD
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.geometry.covariance import radius95
from vgrd.model import (
    Calibration,
    ExpectedCoordinate,
    Policy,
    TagObservation,
    TaughtPoint,
    frozen_array,
)

_EYE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class _Moved:
    """A point of the reference, carried along with the object.

    position: (3,) now, base. rotation: (3, 3) of the object since the reference, base.
    covariance: (3, 3) mm^2 from hand-eye, both pictures and the pivot's place in tag B.
    """

    position: Array
    rotation: Array
    covariance: Array


def expected_coordinate(
    calibration: Calibration,
    target_name: str,
    camera_from_tag_b: TagObservation,
    policy: Policy,
    base_from_work: Array | None = None,
) -> ExpectedCoordinate:
    """Flange pose at which the work tip meets the target in the picture given.

    policy fixed: the wrist stays at the taught orientation; follow: it turns with the object;
    requested: it stands as base_from_work says. base_from_work: (3, 3), for the other policies
    another orientation for the object as it was taught. u95_mm counts
    touches, hand-eye, both pictures, pivot and the arm (see `radius95`). Raises InputError for an
    unknown target and for what the calibration cannot serve, naming the remedy.
    """
    taught = _taught(calibration, target_name)
    if policy is Policy.REQUESTED and base_from_work is None:
        raise InputError("policy 'requested' needs the orientation in which the wrist will stand")
    R_work = taught.base_from_work if base_from_work is None else np.asarray(base_from_work)
    if calibration.joint is not None:
        basis = stored_basis(calibration.joint, calibration.facts)
        return expected_from(basis, target_name, camera_from_tag_b, policy, R_work)
    if calibration.tcp_in_wrist is None:
        _check_taught_orientation(taught, R_work)
        moved, J_touches = _special(calibration, taught, camera_from_tag_b, policy)
        flange = moved.position
    else:
        moved, J_touches = _universal(calibration, taught, camera_from_tag_b, policy, R_work)
        flange = moved.position - _wrist(policy, moved, R_work) @ _tip_in_wrist(calibration)
    R_now = _wrist(policy, moved, R_work)
    robot = calibration.facts.robot_sigma_mm**2 * _EYE
    covariance = _touch_covariance(taught, J_touches) + moved.covariance + robot
    turned = _rotation_covariance(calibration, camera_from_tag_b, moved.rotation)
    return ExpectedCoordinate(
        target=taught.target,
        base_from_wrist=Pose(R_now, flange),
        position_covariance=frozen_array(covariance, 3, 3),
        u95_mm=radius95(covariance),
        u95_rad=0.0 if policy is not Policy.FOLLOW else radius95(turned),
    )


def _taught(calibration: Calibration, target_name: str) -> TaughtPoint:
    try:
        return calibration.taught[target_name]
    except KeyError:
        known = ", ".join(sorted(calibration.taught))
        raise InputError(f"target {target_name!r} was not taught; there are: {known}") from None


def _check_taught_orientation(taught: TaughtPoint, R_work: Array) -> None:
    off = float(np.linalg.norm(log_rotation(R_work @ taught.base_from_work.T)))
    if off > SAME_ORIENTATION_RAD:
        raise InputError(
            f"the wrist is to be turned by {np.degrees(off):.2f} degrees against the touches, but "
            "the TCP is unknown (all touches had one orientation): touch with varied wrists"
        )


def _wrist(policy: Policy, moved: _Moved, R_work: Array) -> Array:
    return moved.rotation @ R_work if policy is Policy.FOLLOW else R_work


def _tip_in_wrist(calibration: Calibration) -> Array:
    return np.asarray(calibration.tcp_in_wrist) + calibration.facts.tool.work_from_touch_mm


def _universal(
    calibration: Calibration,
    taught: TaughtPoint,
    now: TagObservation,
    policy: Policy,
    R_work: Array,
) -> tuple[_Moved, Array]:
    """Where the work tip must be now; derivative of the flange by (flange, pivot, TCP).

    A wrist that follows the object carries its own tip along: the motion of the whole flange by
    the hand-eye then needs no TCP, while the pivot's place in the base would.
    """
    tip = taught.flange_in_base + taught.base_from_work @ _tip_in_wrist(calibration)
    J_pivot = np.zeros((3, 3))
    if policy is not Policy.FOLLOW and calibration.pivot_in_base is not None:
        moved = _about_pivot(calibration, tip, now)
        J_pivot = _EYE - moved.rotation
    else:
        moved = _with_hand_eye(calibration, tip, now)
    J_tcp = moved.rotation @ taught.base_from_work - _wrist(policy, moved, R_work)
    return moved, np.hstack([moved.rotation, J_pivot, J_tcp])


def _special(
    calibration: Calibration, taught: TaughtPoint, now: TagObservation, policy: Policy
) -> tuple[_Moved, Array]:
    """Where the flange must be now, and its derivative by (flange, pivot flange) of the touches."""
    flange = taught.flange_in_base
    if policy is Policy.FOLLOW:
        moved = _with_hand_eye(calibration, flange, now)
        return moved, moved.rotation
    if calibration.pivot_in_base is None:
        raise InputError(
            "policy 'fixed' needs the rotation centre or the TCP: record spins of the turntable "
            "(and its centre in CAD), or touch with varied wrists, or use policy 'follow'"
        )
    moved = _about_pivot(calibration, flange, now)
    return moved, np.hstack([moved.rotation, _EYE - moved.rotation])


def _touch_covariance(taught: TaughtPoint, J_touches: Array) -> Array:
    joint = taught.joint_covariance
    if joint is None or J_touches.shape[1] == 3:
        joint = taught.covariance
    return np.asarray(J_touches @ joint @ J_touches.T)


def _about_pivot(calibration: Calibration, point: Array, now: TagObservation) -> _Moved:
    """Eq. 19: turn about the pivot, plus how far the pivot moved."""
    if calibration.pivot_in_tag_b is None or calibration.pivot_in_base is None:
        raise InputError("this calibration has no pivot")
    R_bc = calibration.base_from_camera.rotation
    ref, C = calibration.camera_from_tag_b_ref, now.camera_from_tag
    R_Q = C.rotation @ ref.rotation.T
    pivot_ref, pivot_now = ref @ calibration.pivot_in_tag_b, C @ calibration.pivot_in_tag_b
    arm = R_bc.T @ (point - calibration.pivot_in_base)
    turn = R_bc @ R_Q @ R_bc.T
    shift = R_bc @ (pivot_now - pivot_ref)
    u, v = R_bc @ arm, R_bc @ (R_Q @ arm)
    J_now = R_bc @ np.hstack([_EYE, -hat(pivot_now + R_Q @ arm)])
    J_ref = -R_bc @ np.hstack([_EYE, -hat(pivot_ref) - R_Q @ hat(arm)])
    J_hand_eye = turn @ hat(u) - hat(v) - hat(shift)
    J_pivot = R_bc @ (C.rotation - ref.rotation)
    pivot = calibration.pivot_covariance
    covariance = (
        _quadratic(J_now, now.covariance)
        + _quadratic(J_ref, calibration.reference_covariance)
        + _quadratic(J_hand_eye, calibration.hand_eye_covariance[3:, 3:])
        + _quadratic(J_pivot, pivot)
    )
    return _Moved(calibration.pivot_in_base + v + shift, turn, covariance)


def _with_hand_eye(calibration: Calibration, point: Array, now: TagObservation) -> _Moved:
    """Motion of the object by the full hand-eye: B M B^-1."""
    B = calibration.base_from_camera
    M = now.camera_from_tag @ calibration.camera_from_tag_b_ref.inverse()
    in_camera_ref = B.inverse() @ point
    in_camera_now = M @ in_camera_ref
    position = B @ in_camera_now
    turn = B.rotation @ M.rotation @ B.rotation.T
    J_now = B.rotation @ np.hstack([_EYE, -hat(in_camera_now)])
    J_ref = -B.rotation @ M.rotation @ np.hstack([_EYE, -hat(in_camera_ref)])
    J_hand_eye = np.hstack([_EYE - turn, turn @ hat(point) - hat(position)])
    covariance = (
        _quadratic(J_now, now.covariance)
        + _quadratic(J_ref, calibration.reference_covariance)
        + _quadratic(J_hand_eye, calibration.hand_eye_covariance)
    )
    return _Moved(position, turn, covariance)


def _rotation_covariance(calibration: Calibration, now: TagObservation, turn: Array) -> Array:
    """Covariance (3, 3) rad^2 of the object's rotation in the base."""
    R_bc = calibration.base_from_camera.rotation
    return (
        _quadratic(R_bc, now.covariance[3:, 3:])
        + _quadratic(turn @ R_bc, _block(calibration.reference_covariance))
        + _quadratic(_EYE - turn, calibration.hand_eye_covariance[3:, 3:])
    )


def _block(covariance: Array | None) -> Array | None:
    return None if covariance is None else covariance[3:, 3:]


def _quadratic(J: Array, covariance: Array | None) -> Array:
    return np.zeros((3, 3)) if covariance is None else np.asarray(J @ covariance @ J.T)
