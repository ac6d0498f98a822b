"""Expected coordinates from the joint estimate, for a camera that stands still."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from vgrd.calibration.joint.basis import Basis, basis_of
from vgrd.calibration.joint.estimate import JointResult
from vgrd.calibration.joint.fit import unknown_in_words
from vgrd.calibration.joint.problem import Tags, target_of
from vgrd.calibration.joint.rows import ObjectMotions, left_jacobian, moved_tag, object_motions
from vgrd.calibration.joint.state import table_motion_of
from vgrd.calibration.touches.recorded import touched_orientation
from vgrd.errors import InputError, NotObservable, TagNotSeen
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import radius95, sqrt_information
from vgrd.model import (
    ExpectedCoordinate,
    Observation,
    Policy,
    Recording,
    TagObservation,
    frozen_array,
)

_EYE = np.eye(3)
_REFUSED_MM = 0.25
_FITS_MODEL = 0.9999


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A flange pose, position corrected by the arm's field, and the errors it consists of.

    by_unknowns (3, n): of the joint estimate; by_picture (3, 6): of the tag's left tangent;
    by_arm (3, 6): of the arm's deviation there; arm_covariance (6, 6): of what is left of that.
    turn_*: the same for the orientation, rad. fits_model: the object moved as it can.
    """

    base_from_wrist: Pose
    by_unknowns: Array
    J_picture: Array
    J_arm: Array
    arm_covariance: Array
    J_turn_unknowns: Array
    J_turn_picture: Array
    fits_model: bool


def expected_by_joint(
    result: JointResult,
    target: str,
    observation_now: Observation | TagObservation,
    policy: Policy = Policy.FIXED,
    base_from_work: Array | None = None,
) -> ExpectedCoordinate:
    """Flange pose at which the work tip meets the target in the picture given; Eq. 5 and 6.

    policy fixed: wrist as touched (or `base_from_work` (3, 3)); follow: it turns with the object;
    requested: exactly `base_from_work`. The picture counts as one spin more: it only has to tell
    the turn, unless the object left its turntable or plane. Raises InputError, TagNotSeen, or
    NotObservable where the answer depends on what the recording left undetermined.
    """
    R_work = work_orientation(result.recording, target, policy, base_from_work)
    return expected_from(basis_of(result), target, tag_b_of(observation_now), policy, R_work)


def expected_from(
    basis: Basis, target: str, tag: TagObservation, policy: Policy, R_work: Array
) -> ExpectedCoordinate:
    """As `expected_by_joint`, from what the runtime keeps; R_work (3, 3): of the wrist at the touch."""
    made = predict(basis, target, tag, policy, R_work)
    unknown = made.by_unknowns @ basis.undetermined
    covariance = (
        made.by_unknowns @ basis.covariance @ made.by_unknowns.T
        + unknown @ unknown.T
        + made.J_picture @ tag.covariance @ made.J_picture.T
        + made.J_arm @ made.arm_covariance @ made.J_arm.T
    )
    turned = (
        made.J_turn_unknowns @ basis.covariance @ made.J_turn_unknowns.T
        + made.J_turn_picture @ tag.covariance @ made.J_turn_picture.T
    )
    return ExpectedCoordinate(
        target=target_of(basis.facts, target),
        base_from_wrist=made.base_from_wrist,
        position_covariance=frozen_array(covariance, 3, 3),
        u95_mm=radius95(covariance),
        u95_rad=radius95(turned),
    )


def predict(
    basis: Basis,
    target: str,
    tag: TagObservation,
    policy: Policy,
    R_work: Array,
    *,
    refuse: bool = True,
) -> Prediction:
    """Expected coordinate with the derivatives that its uncertainty consists of.

    R_work: (3, 3) of the wrist, the object as taught (follow) or at the touch (fixed, requested).
    refuse: raise NotObservable where it depends on something undetermined.
    """
    seen = _on_model(basis, tag)
    fits = seen is not None
    seen = seen or _anywhere(basis, tag)
    flange, R, by, turn = _flange(basis, target, seen, policy, R_work)
    tip = R @ _tip(basis)
    J_arm = -np.hstack([_EYE, -hat(tip)])
    correction, J_field, arm_covariance = basis.arm.deviation(flange)
    n = basis.layout.size
    by[:, :n] += J_arm @ J_field
    flange = flange + J_arm @ correction - by @ (seen.gain @ seen.residual)
    by_unknowns = by[:, :n] - by @ seen.gain @ seen.by_unknowns
    if refuse:
        _check_determined(basis, by_unknowns)
    return Prediction(
        base_from_wrist=Pose(R, flange),
        by_unknowns=by_unknowns,
        J_picture=by @ seen.gain @ seen.sqrt_information,
        J_arm=J_arm,
        arm_covariance=arm_covariance,
        J_turn_unknowns=turn[:, :n] - turn @ seen.gain @ seen.by_unknowns,
        J_turn_picture=turn @ seen.gain @ seen.sqrt_information,
        fits_model=fits,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The object's motion in one picture, and how to improve unknowns and motion by it.

    residual (6,), whitened; by_unknowns (6, n); gain (n + k, 6): minus the correction of (unknowns,
    motion) per residual; at: Moves of one.
    """

    at: ObjectMotions
    residual: Array
    by_unknowns: Array
    gain: Array
    sqrt_information: Array


def _tags_of(tag: TagObservation) -> Tags:
    C = tag.camera_from_tag
    return Tags(C.rotation[None], C.translation[None], sqrt_information(tag.covariance)[None])


def _on_model(basis: Basis, tag: TagObservation) -> _Seen | None:
    """The picture as one spin more; None where it cannot be one."""
    state, layout = basis.state, basis.layout
    if not layout.axis:
        return None
    tags = _tags_of(tag)
    motion = tag.camera_from_tag @ state.camera_from_tag_b.inverse()
    table_motion = table_motion_of(state.camera_from_axis, motion, basis.facts.object.motion)[None]
    at = object_motions(state, table_motion, layout)
    r, J, J_motion = (part[0] for part in moved_tag(state, tags, at, layout))
    S = np.eye(6) + J @ basis.covariance @ J.T
    S_inv = np.linalg.inv(S)
    of_move = np.linalg.solve(J_motion.T @ S_inv @ J_motion, J_motion.T @ S_inv)
    left = np.eye(6) - J_motion @ of_move
    misfit = float((left @ r) @ S_inv @ (left @ r))
    if misfit > 2 * gammaincinv((6 - len(layout.object_motions)) / 2, _FITS_MODEL):
        return None
    gain = np.vstack([basis.covariance @ J.T @ S_inv @ left, of_move])
    return _Seen(at, r, J, gain, tags.sqrt_informations[0])


def _anywhere(basis: Basis, tag: TagObservation) -> _Seen:
    """The object where the picture alone says."""
    state, layout = basis.state, basis.layout
    tags = _tags_of(tag)
    M = tag.camera_from_tag @ state.camera_from_tag_b.inverse()
    J_axis = np.zeros((1, 6, len(layout.axis)))
    at = ObjectMotions(M.rotation[None], M.translation[None], J_axis, np.eye(6)[None])
    r, J, J_motion = (part[0] for part in moved_tag(state, tags, at, layout))
    gain = np.vstack([np.zeros((layout.size, 6)), np.linalg.inv(J_motion)])
    return _Seen(at, r, J, gain, tags.sqrt_informations[0])


def _flange(
    basis: Basis, target: str, seen: _Seen, policy: Policy, R_work: Array
) -> tuple[Array, Array, Array, Array]:
    """Flange (3,), wrist (3, 3), derivatives (3, n + k) of both by unknowns and motion."""
    state, layout, at = basis.state, basis.layout, seen.at
    X, N = state.base_from_camera, Pose(at.rotations[0], at.translations[0])
    p = np.asarray(target_of(basis.facts, target).point_in_object)
    taught = state.base_from_object @ p
    in_camera = N @ (X.inverse() @ taught)
    point = X @ in_camera
    turn = X.rotation @ N.rotation @ X.rotation.T
    n, k = layout.size, at.J_motion.shape[2]
    by, turned = np.zeros((3, n + k)), np.zeros((3, n + k))
    motion = np.zeros((6, n + k))
    motion[:, layout.axis_columns], motion[:, n:] = at.J_axis[0], at.J_motion[0]
    by += X.rotation @ left_jacobian(in_camera[None])[0] @ motion
    by[:, layout.OBJECT] = turn @ left_jacobian(taught[None])[0]
    by[:, layout.CAMERA] = left_jacobian(point[None])[0] - by[:, layout.OBJECT]
    R = R_work
    if policy is Policy.FOLLOW:
        R = turn @ R_work
        turned += X.rotation @ motion[3:]
        turned[:, layout.CAMERA.start + 3 : layout.CAMERA.stop] = _EYE - turn
    tip = R @ _tip(basis)
    by += hat(tip) @ turned
    by[:, layout.TCP] = -R
    return point - tip, R, by, turned


def _tip(basis: Basis) -> Array:
    return np.asarray(basis.state.tcp_in_wrist + basis.facts.tool.work_from_touch_mm)


def _check_determined(basis: Basis, by_unknowns: Array) -> None:
    moved = np.linalg.norm(by_unknowns @ basis.undetermined, axis=0)
    if moved.size and float(moved.max()) > _REFUSED_MM:
        raise NotObservable(
            "the expected coordinate depends on "
            f"{unknown_in_words(basis.layout, basis.undetermined)}, which the recording "
            "leaves undetermined: touch with the wrist tilted by 20 degrees or more about two "
            "axes, look with tag A in view, or keep the wrist as it was touched",
            rank=basis.layout.size - moved.size,
            unknowns=basis.layout.size,
        )


def tag_b_of(seen: Observation | TagObservation) -> TagObservation:
    """Tag B of a picture; raises TagNotSeen."""
    tag = seen.tag_b if isinstance(seen, Observation) else seen
    if tag is None:
        raise TagNotSeen("tag B is not in the picture")
    return tag


def work_orientation(
    recording: Recording, name: str, policy: Policy, base_from_work: Array | None
) -> Array:
    """As asked for, as configured, or as touched: the most usual orientation of that target."""
    if base_from_work is not None:
        return np.asarray(base_from_work, dtype=np.float64)
    if policy is Policy.REQUESTED:
        raise InputError("policy 'requested' needs the orientation of the wrist: base_from_work")
    configured = target_of(recording.facts, name).base_from_work
    if configured is not None:
        return np.asarray(configured)
    return touched_orientation(recording.touches, name)
