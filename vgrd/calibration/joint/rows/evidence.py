"""Residuals of the joint estimate, whitened by the sensors' noise, and their derivatives."""

import numpy as np

from vgrd.calibration.joint.camera_corrections import adjoints
from vgrd.calibration.joint.problem import EvidenceKind, Indices, JointData, Tags
from vgrd.calibration.joint.rows.tags import (
    Displaced,
    ObjectMotions,
    displaced_by,
    object_motions,
    predicted_tag_a,
    seen_residuals,
    still_tag_b,
    turns_of,
)
from vgrd.calibration.joint.state import JointState, StepLayout, left_jacobian
from vgrd.calibration.touches import TouchSet
from vgrd.geometry import Array, Pose, hat

_EYE = np.eye(3)


def linearize(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    """Residuals (r,) and derivative (r, n), rows in the order of `data.counts`.

    Pictures follow the refined numbers linearly from where `data` has them.
    """
    blocks = [
        _hand_eye(state, data, layout),
        _touches(state, data, layout),
        _points(state, data, layout),
        _reference(state, data, layout),
    ]
    if layout.spins:
        blocks.append(_spins(state, data, layout))
    if len(data.holes.cad):
        blocks.append(_holes(state, data, layout))
    if data.center is not None:
        blocks.append(_center(state, data.center, data.turntable.center_sigma_mm, layout))
    if data.axis is not None:
        blocks.append(_axis(state, data.axis, data.turntable.axis_sigma_rad, layout))
    if layout.inexact:
        blocks.append(_cad(state, data, layout))
    if layout.refined:
        blocks.append((state.refined, np.eye(layout.size)[layout.refined_columns]))
    r, J = np.concatenate([r for r, _ in blocks]), np.vstack([J for _, J in blocks])
    if layout.places:
        _put_places(J, state, data, layout)
    if layout.refined:
        seen = slice(0, len(r) - layout.refined)
        r[seen] += J[seen, layout.refined_columns] @ (state.refined - data.refined_values)
    return r, J


def displacement_jacobian(
    state: JointState, data: JointData, J: Array, layout: StepLayout
) -> Array:
    """Derivative (k, 6) of the rows of pictures by the camera's displacement in the picture of each.

    J (r, n): of all rows. The displacement moves what the camera sees against what is predicted, as
    base_from_camera does to tag A and to holes, and camera_from_tag_b the other way to tag B, each seen
    through the motion of the object. The k rows are the first ones; those of touches are 0.
    """
    out = np.zeros((data.rows_of(EvidenceKind.HOLES).stop, 6))
    in_camera = state.base_from_camera.adjoint()
    rows = data.rows_of(EvidenceKind.HAND_EYE)
    out[rows] = J[rows, layout.CAMERA] @ in_camera
    rows = data.rows_of(EvidenceKind.REFERENCE)
    out[rows] = -J[rows, layout.TAG_B]
    if not (layout.spins or len(data.holes.cad)):
        return out
    motions = object_motions(state.camera_from_axis, state.table_motion, layout)
    back = np.linalg.inv(adjoints(motions.rotations, motions.translations))
    rows = data.rows_of(EvidenceKind.SPINS)
    out[rows] = -(J[rows, layout.TAG_B].reshape(-1, 6, 6) @ back).reshape(-1, 6)
    rows = data.rows_of(EvidenceKind.HOLES)
    back = np.concatenate([back, np.eye(6)[None]])[data.holes.spin]
    out[rows] = (J[rows, layout.CAMERA].reshape(-1, 2, 6) @ in_camera @ back).reshape(-1, 6)
    return out


def _put_places(J: Array, state: JointState, data: JointData, layout: StepLayout) -> None:
    """Columns of the displacements into J (r, n)."""
    by_displacement = displacement_jacobian(state, data, J, layout)
    places, columns = data.row_places(), layout.place_columns()
    for place, own in enumerate(columns):
        rows = np.flatnonzero(places == place)
        J[rows[:, None], own] = by_displacement[rows]


def _rows(count: int, width: int, layout: StepLayout) -> Array:
    return np.zeros((count, width, layout.size))


def _flat(r: Array, J: Array) -> tuple[Array, Array]:
    return r.ravel(), J.reshape(-1, J.shape[2])


def _hand_eye(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    X_inv, looks = state.base_from_camera.inverse(), data.looks
    displaced = displaced_by(state, data, EvidenceKind.HAND_EYE)
    r, D, E = seen_residuals(*predicted_tag_a(state, data), looks.tags, displaced)
    D = D @ X_inv.adjoint()
    J = _rows(len(r), 6, layout)
    J[:, :, layout.refined_columns] = E
    J[:, :, layout.CAMERA] = -D
    J[:, :, layout.TAG_A] = D @ adjoints(looks.rotations, looks.translations)
    return _flat(r, J)


def _tips(state: JointState, touches: TouchSet) -> Array:
    return np.asarray(touches.rotations @ state.tcp_in_wrist + touches.translations)


def touched_points(state: JointState, data: JointData) -> Array:
    """The targets of all touches on the part, (m, 3) object; 0 for one without CAD."""
    return data.cad + _offsets(state, data.inexact_of)


def _offsets(state: JointState, inexact_of: Indices) -> Array:
    """How far targets (n,) are from CAD, (n, 3); -1: not at all."""
    return np.asarray(np.vstack([state.offsets_in_object, np.zeros(3)])[inexact_of])


def _put_offsets(J: Array, by_point: Array, inexact_of: Indices, layout: StepLayout) -> None:
    """Derivatives (n, k, 3) by points in the object into the columns of their offsets in J (n, k, m)."""
    samples = np.flatnonzero(inexact_of >= 0)
    columns = layout.inexact_columns()[inexact_of[samples]]
    rows = np.arange(J.shape[1])[None, :, None]
    J[samples[:, None, None], rows, columns[:, None, :]] = by_point[samples]


def touched_places(state: JointState, data: JointData) -> Array:
    """Where the target of every touch stood, (m, 3) base: by CAD or a place of its own, and by the turn."""
    return _turned(_still_places(state, data), state, data)


def _still_places(state: JointState, data: JointData) -> Array:
    """The same, (m, 3) base, with the object as it stood in most touches."""
    places, own = state.base_from_object @ touched_points(state, data), data.bare_of >= 0
    places[own] = state.bare_in_base[data.bare_of[own]]
    return places


def _turned(places: Array, state: JointState, data: JointData) -> Array:
    """Places (m, 3) in the base as the object stood in each touch."""
    turned = data.touch_spins >= 0
    if not turned.any():
        return places
    R, t = turns_of(state.camera_from_axis, state.table_motion[data.touch_spins[turned]])
    in_camera = state.base_from_camera.inverse() @ places[turned]
    moved = places.copy()
    moved[turned] = state.base_from_camera @ (np.einsum("nij,nj->ni", R, in_camera) + t)
    return moved


def _touches(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    touches = data.touches
    W = touches.base_sqrt_informations()
    places, in_cad = _still_places(state, data), data.bare_of < 0
    moved = _turned(places, state, data)
    J = _rows(len(W), 3, layout)
    by_place = W
    if moved is not places:
        by_place = W @ _put_turns(J, -W, (places, moved), state, data, layout)
    J[:, :, layout.TCP] = W @ touches.rotations
    J[in_cad, :, layout.OBJECT] = -by_place[in_cad] @ left_jacobian(places[in_cad])
    for i in np.flatnonzero(~in_cad):
        J[i][:, layout.bare_columns()[data.bare_of[i]]] = -by_place[i]
    _put_offsets(J, -by_place @ state.base_from_object.rotation, data.inexact_of, layout)
    misses = _tips(state, touches) - moved
    return _flat(np.einsum("nij,nj->ni", W, misses), J)


def _put_turns(
    J: Array,
    W: Array,
    places: tuple[Array, Array],
    state: JointState,
    data: JointData,
    layout: StepLayout,
) -> Array:
    """Derivatives of the touches' places by what turned the object into J, weighted by W (n, 3, 3).

    places: p and p', (n, 3) each; p stands at p' = X N X^-1 p with X = base_from_camera and N the motion of the
    spin. Returns the rotation (n, 3, 3) of that, the derivative by p.
    """
    by_place = np.broadcast_to(_EYE, W.shape).copy()
    turned = np.flatnonzero(data.touch_spins >= 0)
    spins, X = data.touch_spins[turned], state.base_from_camera
    motions = object_motions(state.camera_from_axis, state.table_motion, layout)
    R = X.rotation @ motions.rotations[spins] @ X.rotation.T
    still, moved = (p[turned] for p in places)
    by_camera = left_jacobian(moved) - R @ left_jacobian(still)
    by_motion = X.rotation @ left_jacobian(X.inverse() @ moved)
    part = _rows(len(turned), 3, layout)
    part[:, :, layout.CAMERA] = by_camera
    part[:, :, layout.axis_columns] = by_motion @ motions.J_axis[spins]
    _put_moves(part, by_motion @ motions.J_motion[spins], spins, layout)
    J[turned] = W[turned] @ part
    by_place[turned] = R
    return by_place


def _points(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    points = data.points
    W = points.base_sqrt_informations()
    J = _rows(len(W), 3, layout)
    if len(W):
        J[:, :, layout.TCP] = W @ points.rotations
        J[:, :, layout.point_columns] = -W
    misses = _tips(state, points) - state.fixed_point_in_base
    return _flat(np.einsum("nij,nj->ni", W, misses), J)


def _reference(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    R, t = still_tag_b(state, data)
    displaced = displaced_by(state, data, EvidenceKind.REFERENCE)
    r, D, E = seen_residuals(R, t, data.reference, displaced)
    J = _rows(len(r), 6, layout)
    J[:, :, layout.refined_columns] = E
    J[:, :, layout.TAG_B] = D
    return _flat(r, J)


def moved_tag(
    camera_from_tag_b: Pose,
    tags: Tags,
    motions: ObjectMotions,
    layout: StepLayout,
    displaced: Displaced | None = None,
) -> tuple[Array, Array, Array]:
    """Residuals (n, 6) of tag B on the moved object, derivatives by the unknowns and the motions.

    (n, 6, unknowns) without, and (n, 6, k) of each one's own motion.
    """
    F = camera_from_tag_b
    t = motions.rotations @ F.translation + motions.translations
    r, D, E = seen_residuals(motions.rotations @ F.rotation, t, tags, displaced)
    J = _rows(len(r), 6, layout)
    if tags.J_refined is not None:
        J[:, :, layout.refined_columns] = E
    J[:, :, layout.TAG_B] = D @ adjoints(motions.rotations, motions.translations)
    J[:, :, layout.axis_columns] = D @ motions.J_axis
    return r, J, D @ motions.J_motion


def _spins(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    motions = object_motions(state.camera_from_axis, state.table_motion, layout)
    displaced = displaced_by(state, data, EvidenceKind.SPINS)
    r, J, J_motion = moved_tag(state.camera_from_tag_b, data.spins, motions, layout, displaced)
    _put_moves(J, J_motion, np.arange(len(r)), layout)
    return _flat(r, J)


def _put_moves(J: Array, blocks: Array, spins: Indices, layout: StepLayout) -> None:
    columns = layout.spin_columns()[spins]
    samples, rows = np.ogrid[: len(blocks), : blocks.shape[1]]
    J[samples[:, :, None], rows[:, :, None], columns[:, None, :]] = blocks


def _holes(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    holes = data.holes
    spun = holes.spin >= 0
    in_base = state.base_from_object @ (holes.cad + _offsets(state, holes.inexact_of))
    camera_from_base = state.base_from_camera.inverse()
    in_camera = camera_from_base @ in_base
    J_base = np.broadcast_to(camera_from_base.rotation, (len(in_camera), 3, 3)).copy()
    J_point = np.zeros((len(in_camera), 3, layout.size))
    if spun.any():
        motions, k = (
            object_motions(state.camera_from_axis, state.table_motion, layout),
            holes.spin[spun],
        )
        in_camera[spun] = (
            np.einsum("nij,nj->ni", motions.rotations[k], in_camera[spun])
            + motions.translations[k]
        )
        J_base[spun] = motions.rotations[k] @ J_base[spun]
        lever, part = left_jacobian(in_camera[spun]), np.zeros((len(k), 3, layout.size))
        part[:, :, layout.axis_columns] = lever @ motions.J_axis[k]
        _put_moves(part, lever @ motions.J_motion[k], k, layout)
        J_point[spun] = part
    if (displaced := displaced_by(state, data, EvidenceKind.HOLES)) is not None:
        turns, shifts = displaced
        in_camera = np.einsum("nij,nj->ni", turns, in_camera) + shifts
    pixels, D = holes.camera.linearize(in_camera)
    D = D / holes.sigma_px[:, None, None]
    D = D if displaced is None else D @ displaced[0]
    J = D @ J_point
    J[:, :, layout.OBJECT] = D @ J_base @ left_jacobian(in_base)
    J[:, :, layout.CAMERA] = -J[:, :, layout.OBJECT]
    _put_offsets(J, D @ J_base @ state.base_from_object.rotation, holes.inexact_of, layout)
    J_camera = holes.camera.intrinsics_jacobian(in_camera) @ data.corrections.intrinsics()
    J[:, :, layout.refined_columns] = J_camera / holes.sigma_px[:, None, None]
    return _flat((pixels - holes.pixels) / holes.sigma_px[:, None], J)


def _center(
    state: JointState, center: Array, sigma_mm: float, layout: StepLayout
) -> tuple[Array, Array]:
    """The centre across the axis is where CAD says; along it nothing is said."""
    G, camera_from_base = state.camera_from_axis, state.base_from_camera.inverse()
    in_base = state.base_from_object @ center
    misses = G.inverse() @ (camera_from_base @ in_base) / -sigma_mm
    J = np.zeros((3, layout.size))
    J_body = np.hstack([_EYE / sigma_mm, hat(misses)])
    J[:, layout.axis_columns] = J_body[:, list(layout.axis)]
    turn = G.rotation.T @ camera_from_base.rotation / sigma_mm
    J[:, layout.CAMERA] = turn @ left_jacobian(in_base[None])[0]
    J[:, layout.OBJECT] = -J[:, layout.CAMERA]
    return misses[:2], J[:2]


def _axis(
    state: JointState, axis_in_object: Array, sigma_rad: float, layout: StepLayout
) -> tuple[Array, Array]:
    """The axis of turning points where CAD says, either way."""
    G = state.camera_from_axis.rotation
    in_base = state.base_from_object.rotation @ axis_in_object
    turn = G.T @ state.base_from_camera.rotation.T
    axis = turn @ in_base
    sign = np.sign(axis[2]) / sigma_rad
    J = np.zeros((3, layout.size))
    J_body = np.hstack([np.zeros((3, 3)), hat(axis)])
    J[:, layout.axis_columns] = J_body[:, list(layout.axis)]
    J[:, layout.OBJECT.start + 3 : layout.OBJECT.stop] = -turn @ hat(in_base)
    J[:, layout.CAMERA.start + 3 : layout.CAMERA.stop] = turn @ hat(in_base)
    return sign * axis[:2], sign * J[:2]


def _cad(state: JointState, data: JointData, layout: StepLayout) -> tuple[Array, Array]:
    """The targets are where CAD says, as far as the part keeps to it."""
    sigmas_mm = np.repeat(data.cad_sigma_mm * data.cad_factors, 3)
    offsets = state.offsets_in_object.ravel() / sigmas_mm
    J = np.zeros((len(offsets), layout.size))
    J[np.arange(len(offsets)), layout.inexact_columns().ravel()] = 1 / sigmas_mm
    return offsets, J
