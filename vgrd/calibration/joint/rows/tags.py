"""Tags in pictures: where they are predicted, what differs from what was seen, and how the object moved."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.camera_corrections import adjoints
from vgrd.calibration.joint.problem import EvidenceKind, JointData, Tags
from vgrd.calibration.joint.state import JointState, StepLayout
from vgrd.geometry import Array, Pose, hat, log_rotation

Displaced = tuple[Array, Array]  # (n, 3, 3), (n, 3): camera_from_taught of every picture
_SMALL_RAD = 1e-2  # the second term is 1e-11 of the first there
_BERNOULLI = (1 / 12, -1 / 720, 1 / 30240)  # B_2k / (2k)!, k = 1, 2, 3: exact to 1e-6 at 1 rad


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMotions:
    """How the object moved, in the camera: (n, 3, 3), (n, 3), and what that depends on.

    J_axis (n, 6, a), J_motion (n, 6, k): left derivatives by the axis and by the planar motion.
    """

    rotations: Array
    translations: Array
    J_axis: Array
    J_motion: Array


def tag_residuals(R: Array, t: Array, tags: Tags) -> tuple[Array, Array, Array]:
    """Whitened log(predicted measured^-1) (n, 6), derivative (n, 6, 6) by a left perturbation.

    And (n, 6, e) by the refined numbers, which move what was measured, its noise with it.
    """
    turn = R @ np.swapaxes(tags.rotations, 1, 2)
    shift = t - np.einsum("nij,nj->ni", turn, tags.translations)
    w = log_rotation(turn).reshape(-1, 3)
    W, largest = hat(w), float(np.abs(w).max(initial=0.0))
    ad = np.zeros((len(w), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = W
    v = np.einsum("nij,nj->ni", _inverse_jacobian(W, largest), shift)
    ad[:, :3, 3:] = hat(v)
    D = tags.sqrt_informations @ _inverse_jacobian(ad, largest)
    E = np.zeros((len(w), 6, 0))
    if tags.J_refined is not None:
        E = -D @ tags.J_refined
    return np.einsum("nij,nj->ni", tags.sqrt_informations, np.concatenate([v, w], axis=1)), D, E


def _inverse_jacobian(ad: Array, largest: float) -> Array:
    """Inverse left Jacobian as a series in the adjoint of the logarithm; turns up to `largest`, below a radian."""
    square = ad @ ad
    inverse = np.eye(ad.shape[-1]) - ad / 2
    inverse += _BERNOULLI[0] * square
    if largest > _SMALL_RAD:
        power = square
        for factor in _BERNOULLI[1:]:
            power = power @ square
            inverse += factor * power
    return np.asarray(inverse)


def _seen(R: Array, t: Array, displaced: Displaced | None) -> tuple[Array, Array]:
    """Poses (n, 3, 3), (n, 3) of tags in the reference camera, as the camera of each picture has them."""
    if displaced is None:
        return R, t
    turns, shifts = displaced
    return turns @ R, np.einsum("nij,nj->ni", turns, t) + shifts


def displaced_by(state: JointState, data: JointData, kind: EvidenceKind) -> Displaced | None:
    """Inverse displacements of the camera in the pictures of a kind; None where it stood still."""
    places = data.places_of(kind)
    if places is None:
        return None
    inverses = [*(pose.inverse() for pose in state.taught_from_camera), Pose.identity()]
    turns = np.array([pose.rotation for pose in inverses])
    shifts = np.array([pose.translation for pose in inverses])
    return turns[places], shifts[places]


def seen_residuals(
    R: Array, t: Array, tags: Tags, displaced: Displaced | None
) -> tuple[Array, Array, Array]:
    """As `tag_residuals`, R and t and their perturbations in the reference camera."""
    r, D, E = tag_residuals(*_seen(R, t, displaced), tags)
    return r, D if displaced is None else D @ adjoints(*displaced), E


def object_motions(
    camera_from_axis: Pose, table_motion: Array, layout: StepLayout
) -> ObjectMotions:
    """How the object moved since it was touched; table_motion: (n, 3) x, y, angle."""
    R, t = turns_of(camera_from_axis, table_motion)
    adjoint = camera_from_axis.adjoint()
    J_axis = (np.eye(6) - adjoints(R, t)) @ adjoint[:, list(layout.axis)]
    J_motion = np.broadcast_to(
        adjoint[:, list(layout.object_motions)], (len(R), 6, len(layout.object_motions))
    )
    return ObjectMotions(R, t, J_axis, J_motion)


def turn_of(camera_from_axis: Pose, angle_rad: float) -> Pose:
    """The motion of the object about its axis, in the camera."""
    R, t = turns_of(camera_from_axis, np.array([[0.0, 0.0, angle_rad]]))
    return Pose(R[0], t[0])


def turns_of(camera_from_axis: Pose, table_motion: Array) -> tuple[Array, Array]:
    """The motions alone, (n, 3, 3) and (n, 3), in the camera."""
    G = camera_from_axis
    c, s = np.cos(table_motion[:, 2]), np.sin(table_motion[:, 2])
    P = np.zeros((len(c), 3, 3))
    P[:, 0, 0], P[:, 0, 1], P[:, 1, 0], P[:, 1, 1], P[:, 2, 2] = c, -s, s, c, 1.0
    shift = np.column_stack([table_motion[:, :2], np.zeros(len(c))])
    R = G.rotation @ P @ G.rotation.T
    return R, shift @ G.rotation.T + G.translation - R @ G.translation


def as_refined(
    state: JointState, raw: JointData, layout: StepLayout, anchor: JointState | None = None
) -> JointData:
    """The evidence, as gathered, as seen with what the state refined.

    anchor: where the derivatives by it are taken; None: at the state.
    """
    data = raw.refined(state.refined)
    if not data.corrections.count:
        return data
    at = anchor or state
    still, turned = still_tag_b(at, data), _turned_tag_b(at, layout)
    return data.with_tangents(
        {
            EvidenceKind.HAND_EYE: seen_tag_a(at, data),
            EvidenceKind.REFERENCE: _seen(*still, displaced_by(at, data, EvidenceKind.REFERENCE)),
            EvidenceKind.SPINS: _seen(*turned, displaced_by(at, data, EvidenceKind.SPINS)),
        }
    )


def still_tag_b(state: JointState, data: JointData) -> tuple[Array, Array]:
    """Poses of tag B while touching, (n, 3, 3) and (n, 3), in the reference camera."""
    tag_b, n = state.camera_from_tag_b, len(data.reference)
    return np.broadcast_to(tag_b.rotation, (n, 3, 3)), np.broadcast_to(tag_b.translation, (n, 3))


def _turned_tag_b(state: JointState, layout: StepLayout) -> tuple[Array, Array]:
    """The same in spins."""
    if not layout.spins:
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    motions, F = (
        object_motions(state.camera_from_axis, state.table_motion, layout),
        state.camera_from_tag_b,
    )
    return motions.rotations @ F.rotation, motions.rotations @ F.translation + motions.translations


def seen_tag_a(state: JointState, data: JointData) -> tuple[Array, Array]:
    """Poses of tag A, (n, 3, 3) and (n, 3), in the camera where it stood in each picture."""
    displaced = displaced_by(state, data, EvidenceKind.HAND_EYE)
    return _seen(*predicted_tag_a(state, data), displaced)


def predicted_tag_a(state: JointState, data: JointData) -> tuple[Array, Array]:
    """Poses of tag A in the reference camera, (n, 3, 3) and (n, 3), at the flange poses it was seen from."""
    X_inv = state.base_from_camera.inverse()
    Y, looks = state.wrist_from_tag_a, data.looks
    t = looks.rotations @ Y.translation + looks.translations
    return X_inv.rotation @ looks.rotations @ Y.rotation, X_inv @ t
