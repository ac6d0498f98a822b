"""Rows that samples not taken yet would add to the joint estimate, predicted where it stands."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.joint import (
    TAG_A,
    TAG_B,
    CameraPlaces,
    EvidenceKind,
    JointData,
    JointFit,
    JointState,
    Looks,
    StepLayout,
    Tags,
    adjoints,
    arm_jacobian,
    displacement_jacobian,
    inexact_of,
    linearize,
    points_of,
    target_of,
    turn_of,
)
from vgrd.calibration.planning.reach import Candidate, Spinning, Touching, flange_of, touch_pose
from vgrd.calibration.touches import TouchSet, touch_set
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import sqrt_information
from vgrd.model import Stability, TagObservation, TagSpec, frozen_array

_NONE = np.zeros(0, dtype=np.intp)
_TAG, _TOUCH = 6, 3  # rows: a pose has six, a point three
_WIDTH = _TAG + _TOUCH + _TAG
_AT_ONCE = 32  # candidates in one product, so that its arrays stay small


class ForeseenRows:
    """Predicts the rows of candidates; tag_a_in_view: whether the camera sees a camera_from_tag_a."""

    def __init__(self, result: JointFit, tag_a_in_view: Callable[[Pose], bool]) -> None:
        self._result = result
        self._in_view = tag_a_in_view
        stability = result.recording.facts.camera_stability
        self._is_movable = stability is Stability.MOVABLE
        self._body_a = _body_covariance(result.data.looks.tags)
        self._body_b = _body_covariance(result.data.reference)

    def of(self, candidates: Sequence[Candidate]) -> Array:
        """Rows (c, 15, n) of unit noise that each candidate would add, empty ones 0."""
        rows = np.zeros((len(candidates), _WIDTH, self._result.layout.size))
        stations = []
        for i, candidate in enumerate(candidates):
            if isinstance(candidate, Spinning):
                J = self._spin_rows(candidate.angle_rad)
                rows[i, : len(J)] = J
            elif isinstance(candidate, Touching) and candidate.turn_rad:
                rows[i] = self._turned_rows(candidate)
            else:
                stations.append(i)
        for k in range(0, len(stations), _AT_ONCE):
            batch = stations[k : k + _AT_ONCE]
            rows[batch] = self._stand_rows([candidates[i] for i in batch])
        return rows

    def _stand_rows(self, candidates: Sequence[Candidate]) -> Array:
        """Rows (c, 15, n) of touches and looks: 6 of tag A, 3 of the touch, 6 of tag B."""
        result, c = self._result, len(candidates)
        poses = [_pose_of(result, candidate) for candidate in candidates]
        touching = [i for i, candidate in enumerate(candidates) if isinstance(candidate, Touching)]
        data, looking = self._with_looks(poses)
        data = self._with_touches(data, candidates, poses, touching)
        still = replace(result.layout, spins=0, places=0)
        J = linearize(result.state, data, still)[1]
        moved = displacement_jacobian(result.state, data, J, still)
        J = np.hstack([self._embedded(J[: len(moved)], still), moved])
        rows = np.zeros((c, _WIDTH, J.shape[1]))
        for link, indices, width, first in (
            (EvidenceKind.HAND_EYE, looking, 6, 0),
            (EvidenceKind.TOUCHES, touching, 3, 6),
            (EvidenceKind.REFERENCE, touching, 6, 9),
        ):
            part = J[data.rows_of(link)].reshape(len(indices), width, J.shape[1])
            rows[indices, first : first + width] = part
        rows = self._with_arm(rows, data, looking, touching)
        by_unknowns, by_displacement = rows[:, :, :-_TAG], rows[:, :, -_TAG:]
        return _beside(by_unknowns, by_displacement) if self._is_movable else by_unknowns

    def _turned_rows(self, touching: Touching) -> Array:
        """Rows (15, n) of a touch of the turned object; its turn, which nobody knows, is eliminated."""
        result = self._result
        alone, pose = replace(result.layout, spins=1, places=0), touch_pose(result, touching)
        state = replace(result.state, table_motion=np.array([[0.0, 0.0, touching.turn_rad]]))
        data, looking = self._with_looks([pose])
        data = replace(
            self._with_touches(data, [touching], [pose], [0]),
            touch_spins=np.zeros(1, dtype=np.intp),
            reference=data.reference,
            spins=self._tags([moved_tag_b(result, touching.turn_rad)], TAG_B),
        )
        J = linearize(state, data, alone)[1]
        rows = np.zeros((1, _WIDTH, alone.size))
        seen = J[data.rows_of(EvidenceKind.HAND_EYE)]
        rows[0, : len(seen)] = seen
        rows[0, _TAG : _TAG + _TOUCH] = J[data.rows_of(EvidenceKind.TOUCHES)]
        rows[0, _TAG + _TOUCH :] = J[data.rows_of(EvidenceKind.SPINS)]
        (J,) = self._with_arm(rows, data, looking, [0])
        return self._embedded(_beside(J, J[:, alone.spin_columns()[0]]), alone)

    def _with_arm(
        self, rows: Array, data: JointData, looking: list[int], touching: list[int]
    ) -> Array:
        """The same with the noise of the arm; every stand's error is taken as its own."""
        arm = data.arm
        if arm.is_exact or not data.arm_rows:
            return rows
        G = arm_jacobian(self._result.state, data).reshape(data.arm_rows, -1, 6)
        J_arm = np.zeros((len(rows), 9, 6))
        for link, indices, width, first in (
            (EvidenceKind.HAND_EYE, looking, 6, 0),
            (EvidenceKind.TOUCHES, touching, 3, 6),
        ):
            part = G[data.rows_of(link)].reshape(len(indices), width, len(rows), 6)
            J_arm[indices, first : first + width] = part[np.arange(len(indices)), :, indices]
        J_arm = J_arm * np.sqrt(arm.variances())
        L = np.linalg.cholesky(np.eye(9) + J_arm @ J_arm.transpose(0, 2, 1))
        return np.concatenate([np.linalg.solve(L, rows[:, :9]), rows[:, 9:]], axis=1)

    def _with_touches(
        self,
        data: JointData,
        candidates: Sequence[Candidate],
        poses: Sequence[Pose],
        touching: Sequence[int],
    ) -> JointData:
        """Touches of the candidates given added, each with a picture of tag B."""
        if not touching:
            return data
        result, m = self._result, len(touching)
        touches, axis = result.data.touches, result.recording.facts.tool.axis_in_wrist
        lateral, axial = np.median(touches.lateral_sigma_mm), np.median(touches.axial_sigma_mm)
        names = [candidate.target for candidate in candidates if isinstance(candidate, Touching)]
        targets = [target_of(result.recording.facts, name) for name in names]
        cad, bare_of = points_of(targets, data.bare)
        return replace(
            data,
            touches=touch_set(
                [poses[i] for i in touching], axis, [float(lateral)] * m, [float(axial)] * m
            ),
            cad=cad,
            bare_of=bare_of,
            inexact_of=inexact_of(names, data.inexact),
            touch_stations=np.array(touching, dtype=np.intp),
            touch_spins=np.full(m, -1, dtype=np.intp),
            reference=self._tags([result.state.camera_from_tag_b] * m, TAG_B),
        )

    def _with_looks(self, poses: Sequence[Pose]) -> tuple[JointData, list[int]]:
        """Looks from the flange poses where tag A is in view, and which these are."""
        state = self._result.state
        camera_from_base = state.base_from_camera.inverse()
        tags = [camera_from_base @ pose @ state.wrist_from_tag_a for pose in poses]
        indices = [i for i, tag in enumerate(tags) if self._in_view(tag)]
        places = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
        looks = Looks(
            self._tags([tags[i] for i in indices], TAG_A),
            R[indices],
            places[indices],
            np.array(indices, dtype=np.intp),
        )
        return replace(_blank(self._result.data), looks=looks, flange_at=places), indices

    def _spin_rows(self, angle_rad: float) -> Array:
        """A spin more; its own angle, which nobody knows, is eliminated."""
        result, layout = self._result, self._result.layout
        if not layout.axis:
            return np.zeros((0, layout.size))
        alone = replace(layout, spins=1, places=0)
        table_motion = np.array([[0.0, 0.0, angle_rad]])
        state = replace(result.state, table_motion=table_motion)
        tag = self._tags([moved_tag_b(result, angle_rad)], TAG_B)
        data = replace(_blank(result.data), spins=tag)
        columns = alone.spin_columns()[0]
        if self._is_movable:
            return self._spin_by_both_tags(state, data, alone)
        J = linearize(state, data, alone)[1][data.rows_of(EvidenceKind.SPINS)]
        return self._embedded(_beside(J, J[:, columns]), alone)

    def _spin_by_both_tags(self, state: JointState, data: JointData, alone: StepLayout) -> Array:
        """The same where the camera may stand anywhere: tag A tells, seen as in the last spin."""
        result = self._result
        stands = [spin.base_from_wrist for spin in result.recording.spins if spin.tag_a]
        looking = self._with_looks(stands[-1:])[0]
        if not len(looking.looks.tags):
            return np.zeros((0, result.layout.size))
        data = replace(data, looks=looking.looks, flange_at=looking.flange_at)
        J = linearize(state, data, alone)[1]
        moved = displacement_jacobian(state, data, J, alone)
        J = np.hstack([J[: len(moved)], moved])
        if not data.arm.is_exact:
            noise = arm_jacobian(state, data) * np.sqrt(data.arm.variances())
            k = len(noise)
            L = np.linalg.cholesky(np.eye(k) + noise @ noise.T)
            J[:k] = np.linalg.solve(L, J[:k])
        own = np.hstack([J[:, alone.spin_columns()[0]], J[:, alone.size :]])
        return self._embedded(_beside(J[:, : alone.size], own), alone)

    def _embedded(self, J: Array, layout: StepLayout) -> Array:
        """Rows of another layout in the columns of all unknowns; spins of their own left out."""
        whole = self._result.layout
        rows = np.zeros((len(J), whole.size))
        common = whole.axis_columns.stop
        rows[:, :common] = J[:, :common]
        rows[:, whole.refined_columns] = J[:, layout.refined_columns]
        return rows

    def _tags(self, poses: Sequence[Pose], tag: str) -> Tags:
        """TAG_A or TAG_B seen at these poses with the usual noise."""
        result, body = self._result, self._body_a if tag == TAG_A else self._body_b
        corrections, values = result.data.corrections, result.state.refined
        R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
        t = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        A = adjoints(R, t)
        J_refined = None
        if corrections.count:
            J_refined = corrections.tangents_as_seen(R, t, tag, values)
        return Tags(R, t, sqrt_information(A @ body @ A.transpose(0, 2, 1)), J_refined)


def _pose_of(result: JointFit, candidate: Candidate) -> Pose:
    """base_from_wrist of a touch or a look."""
    if isinstance(candidate, Touching):
        return touch_pose(result, candidate)
    return flange_of(result, candidate) or Pose.identity()


def _beside(rows: Array, own: Array) -> Array:
    """Rows (..., r, n) beside what a sample's own unknowns take up, derivatives (..., r, k)."""
    Q = np.linalg.qr(own)[0]
    return np.asarray(rows - Q @ (np.swapaxes(Q, -1, -2) @ rows))


def picture_of(result: JointFit, angle_rad: float) -> TagObservation:
    """Tag B as the camera will see it once the object has turned by an angle."""
    spec, pose = result.recording.facts.tag_b, moved_tag_b(result, angle_rad)
    return _sighting(pose, _body_covariance(result.data.reference), spec)


def moved_tag_b(result: JointFit, angle_rad: float) -> Pose:
    """camera_from_tag_b after the object has turned by an angle about its axis."""
    return turn_of(result.state.camera_from_axis, angle_rad) @ result.state.camera_from_tag_b


def _body_covariance(tags: Tags) -> Array:
    """Mean covariance (6, 6) of a tag's pose, in the tag's own frame."""
    covariances = []
    for pose, W in zip(tags.poses(), tags.sqrt_informations, strict=True):
        half = pose.inverse().adjoint() @ np.linalg.inv(W)
        covariances.append(half @ half.T)
    return np.asarray(np.mean(covariances, axis=0))


def _sighting(pose: Pose, body: Array, spec: TagSpec) -> TagObservation:
    A = pose.adjoint()
    covariance = frozen_array(A @ body @ A.T, 6, 6)
    return TagObservation(spec, pose, covariance, frozen_array(np.zeros((4, 2)), 4, 2), 0.0)


def _blank(data: JointData) -> JointData:
    """The same cell with nothing recorded."""
    nothing = np.zeros((0, 3))
    J_refined = np.zeros((0, 6, data.corrections.count)) if data.corrections.count else None
    tags = Tags(np.zeros((0, 3, 3)), nothing, np.zeros((0, 6, 6)), J_refined)
    axis = data.touches.axis_in_wrist
    touches = TouchSet(np.zeros((0, 3, 3)), nothing, axis, np.zeros(0), np.zeros(0))
    holes = replace(data.holes, cad=nothing, inexact_of=_NONE, spin=_NONE, pixels=np.zeros((0, 2)))
    return replace(
        data,
        looks=Looks(tags, np.zeros((0, 3, 3)), nothing, _NONE),
        touches=touches,
        cad=nothing,
        bare_of=_NONE,
        inexact_of=_NONE,
        touch_stations=_NONE,
        touch_spins=_NONE,
        points=touches,
        point_stations=_NONE,
        reference=tags,
        spins=tags,
        holes=replace(holes, sigma_px=np.zeros(0)),
        center=None,
        turntable=replace(data.turntable, axis_in_object=None),
        places=CameraPlaces(),
    )
