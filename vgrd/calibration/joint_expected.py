"""Expected coordinates from the joint estimate, for a camera that stands still."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint import JointResult, whiten_arm
from vgrd.calibration.joint_problem import target_of
from vgrd.errors import InputError, NotObservable, TagNotSeen
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.geometry.covariance import radius95
from vgrd.model import (
    ExpectedCoordinate,
    Observation,
    Policy,
    Recording,
    TagObservation,
    frozen_array,
)

_EYE = np.eye(3)
_REFUSED_MM = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """A flange pose and how it changes.

    by_unknowns (3, n), by_picture (3, 6) left tangent of the tag, by_arm (3, 6) deviation of the
    arm there: its position, mm; turn_*: its orientation, rad.
    """

    base_from_wrist: Pose
    by_unknowns: Array
    by_picture: Array
    by_arm: Array
    turn_by_unknowns: Array
    turn_by_picture: Array


def expected_by_joint(
    result: JointResult,
    target: str,
    observation_now: Observation | TagObservation,
    policy: Policy = Policy.FIXED,
    base_from_work: Array | None = None,
) -> ExpectedCoordinate:
    """Flange pose at which the work tip meets the target in the picture given; Eq. 5 and 6.

    policy fixed: wrist as touched (or `base_from_work` (3, 3)); follow: it turns with the object;
    requested: exactly `base_from_work`. Where the arm has a smooth error field, the errors seen
    while teaching correct the answer. Raises InputError, TagNotSeen, or NotObservable where the
    answer depends on what the recording left undetermined.
    """
    tag = _tag_b(observation_now)
    s = sensitivity(result, target, tag.camera_from_tag, policy, base_from_work)
    flange, covariance = _with_arm(result, s)
    covariance = covariance + s.by_picture @ tag.covariance @ s.by_picture.T
    turned = s.turn_by_unknowns @ result.covariance @ s.turn_by_unknowns.T
    turned = turned + s.turn_by_picture @ tag.covariance @ s.turn_by_picture.T
    return ExpectedCoordinate(
        target=target_of(result.recording, target),
        base_from_wrist=Pose(s.base_from_wrist.rotation, flange),
        position_covariance=frozen_array(covariance, 3, 3),
        u95_mm=radius95(covariance),
        u95_rad=radius95(turned),
    )


def sensitivity(
    result: JointResult,
    target: str,
    camera_from_tag_b: Pose,
    policy: Policy,
    base_from_work: Array | None = None,
) -> Sensitivity:
    """Flange for the target in a picture, errors of the arm left aside, and its derivatives."""
    state, layout = result.state, result.layout
    p = np.asarray(target_of(result.recording, target).point_in_object)
    R_work = _work_orientation(result.recording, target, policy, base_from_work)
    tip = state.tcp_in_wrist + result.recording.facts.tool.work_from_touch_mm
    X, Z, O_R = state.base_from_camera, state.object_from_tag_b, state.base_from_object.rotation
    base_from_object = X @ camera_from_tag_b @ Z.inverse()
    now = base_from_object.rotation
    in_camera = X.inverse() @ base_from_object @ p
    point = base_from_object @ p
    by = np.zeros((3, layout.size))
    by[:, layout.CAMERA] = np.hstack([_EYE, -hat(point)])
    by[:, layout.TAG_B] = -now @ np.hstack([_EYE, -hat(p)])
    by_picture = X.rotation @ np.hstack([_EYE, -hat(in_camera)])
    turn, turn_by_picture = np.zeros((3, layout.size)), np.zeros((3, 6))
    R = R_work
    if policy is Policy.FOLLOW:
        R = now @ O_R.T @ R_work
        turn[:, layout.CAMERA.start + 3 : layout.CAMERA.stop] = _EYE
        turn[:, layout.TAG_B.start + 3 : layout.TAG_B.stop] = -now
        turn[:, layout.OBJECT.start + 3 : layout.OBJECT.stop] = -now @ O_R.T
        turn_by_picture[:, 3:] = X.rotation
    lever = hat(R @ tip)
    by = by + lever @ turn
    by[:, layout.TCP] = -R
    return Sensitivity(
        base_from_wrist=Pose(R, point - R @ tip),
        by_unknowns=by,
        by_picture=by_picture + lever @ turn_by_picture,
        by_arm=-np.hstack([_EYE, -lever]),
        turn_by_unknowns=turn,
        turn_by_picture=turn_by_picture,
    )


def _with_arm(result: JointResult, s: Sensitivity) -> tuple[Array, Array]:
    """Flange (3,) corrected by what the arm did nearby, and its covariance without the picture.

    The field at the answer is predicted from the residuals of teaching (universal kriging).
    """
    arm, at = result.data.arm, s.base_from_wrist.translation
    by, squares = s.by_unknowns, arm.scales() ** 2
    here = (arm.sigma_mm**2 + arm.field_mm**2) * np.diag(squares)
    flange = at
    if arm.field_mm > 0:
        near = arm.field(at[None], result.data.flange_at)
        shared = np.kron(near, np.diag(squares)) @ result.arm_by.T
        gain = whiten_arm(result.arm_factor, shared.T).T
        k = gain.shape[1]
        flange = at - s.by_arm @ (gain @ result.whitened[:k])
        by = by - s.by_arm @ gain @ result.jacobian[:k]
        here = here - gain @ gain.T
    _require_determined(result, by)
    covariance = by @ result.covariance @ by.T + s.by_arm @ here @ s.by_arm.T
    return flange, covariance


def _require_determined(result: JointResult, by_unknowns: Array) -> None:
    moved = np.linalg.norm(by_unknowns @ result.undetermined, axis=0)
    if moved.size and float(moved.max()) > _REFUSED_MM:
        raise NotObservable(
            f"the expected coordinate depends on {result.unknown_in_words()}, which the recording "
            "leaves undetermined: touch with the wrist tilted by 20 degrees or more about two "
            "axes, look with tag A in view, or keep the wrist as it was touched",
            rank=result.layout.size - moved.size,
            unknowns=result.layout.size,
        )


def _tag_b(seen: Observation | TagObservation) -> TagObservation:
    tag = seen.tag_b if isinstance(seen, Observation) else seen
    if tag is None:
        raise TagNotSeen("tag B is not in the picture")
    return tag


def _work_orientation(
    recording: Recording, name: str, policy: Policy, base_from_work: Array | None
) -> Array:
    """As asked for, as configured, or as touched: the most usual orientation of that target."""
    if base_from_work is not None:
        return np.asarray(base_from_work, dtype=np.float64)
    if policy is Policy.REQUESTED:
        raise InputError("policy 'requested' needs the orientation of the wrist: base_from_work")
    configured = target_of(recording, name).base_from_work
    if configured is not None:
        return np.asarray(configured)
    every = np.array([touch.base_from_wrist.rotation for touch in recording.touches])
    own = [i for i, touch in enumerate(recording.touches) if touch.target == name]

    def unusual(i: int) -> float:
        return float(np.median(np.linalg.norm(log_rotation(every @ every[i].T), axis=1)))

    return np.asarray(every[min(own or range(len(every)), key=unusual)])
