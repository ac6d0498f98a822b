"""The joint estimate as it is stored and served: expected coordinates for a camera that stands still.

A new picture counts as one spin more (Eq. 5 and 6 with the object's motion estimated along): it
improves the unknowns a little, and only has to tell the turn of the object.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vgrd.calibration.joint.fit import unknown_in_words
from vgrd.calibration.joint.problem import Tags
from vgrd.calibration.joint.rows import ObjectMotions, left_jacobian, moved_tag, object_motions
from vgrd.calibration.joint.state import StepLayout, table_motion_of
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.covariance import radius95, sqrt_information
from vgrd.judging.thresholds import IRRELEVANT_MM
from vgrd.model import (
    ArmKnowledge,
    CellFacts,
    ExpectedCoordinate,
    Policy,
    TagObservation,
    Target,
    TaughtPoint,
    TcpEstimate,
    frozen_array,
    frozen_copy,
)

_EYE = np.eye(3)
_FITS_MODEL = 0.9999  # a picture of a turntable is taken for one that left it once in 10,000


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A flange pose, position corrected by the arm's field, and the errors it consists of.

    J_unknowns (3, n): by the joint estimate; J_picture (3, 6): by the tag's left tangent; J_arm
    (3, 6): by the arm's deviation there; arm_covariance (6, 6): of what is left of that. J_turn_*:
    the same for the orientation, rad. fits_model: the object moved as it can.
    """

    base_from_wrist: Pose
    J_unknowns: Array
    J_picture: Array
    J_arm: Array
    arm_covariance: Array
    J_turn_unknowns: Array
    J_turn_picture: Array
    fits_model: bool


@dataclass(frozen=True, slots=True, eq=False)
class JointSolution:
    """Values of the unknowns that answers depend on; the spins are marginalised.

    tip_in_wrist: (3,), any value that fits where the TCP is undetermined. axis, object_motions: which
    body-frame motions of camera_from_axis (z: axis of turning) and of the object on it are unknowns.
    has_point: a fixed point was touched, whose place tells of the arm's errors. covariance (n, n) of a
    step in (base_from_camera, wrist_from_tag_a, TCP, base_from_object, camera_from_tag_b, axis, fixed
    point); undetermined (n, z): 500 mm or 1 rad along what the session left open.
    """

    METHOD: ClassVar[str] = "joint"

    base_from_camera: Pose
    wrist_from_tag_a: Pose
    tip_in_wrist: Array
    base_from_object: Pose
    camera_from_tag_b: Pose
    camera_from_axis: Pose
    axis: tuple[int, ...]
    object_motions: tuple[int, ...]
    has_point: bool
    covariance: Array
    undetermined: Array
    arm: ArmKnowledge

    @property
    def layout(self) -> StepLayout:
        """Where the unknowns stand in a step."""
        return StepLayout(self.axis, self.object_motions, spins=0, has_point=self.has_point)

    @property
    def reference_covariance(self) -> Array:
        """(6, 6) of camera_from_tag_b, what is undetermined included."""
        return self._block(StepLayout.TAG_B)

    @property
    def tcp(self) -> TcpEstimate | None:
        """The touch tip, None where the session left it open."""
        if float(np.abs(self.undetermined[StepLayout.TCP]).max(initial=0.0)) >= IRRELEVANT_MM:
            return None
        return TcpEstimate(self.tip_in_wrist, self._block(StepLayout.TCP))

    def expected(
        self,
        facts: CellFacts,
        taught: TaughtPoint,
        tag_b: TagObservation,
        policy: Policy,
        R_work: Array,
    ) -> ExpectedCoordinate:
        """Flange pose at which the work tip meets the target in the picture given.

        As `expected_for`.
        """
        return self.expected_for(facts, taught.target, tag_b, policy, R_work)

    def expected_for(
        self,
        facts: CellFacts,
        target: Target,
        tag_b: TagObservation,
        policy: Policy,
        R_work: Array,
    ) -> ExpectedCoordinate:
        """The same for a target of which nothing but CAD is known.

        R_work: (3, 3) of the wrist, the object as taught (follow) or at the touch (fixed, requested).
        Raises NotObservable where the answer depends on what the session left undetermined.
        """
        prediction = self.predict(facts, target, tag_b, policy, R_work)
        unknown = prediction.J_unknowns @ self.undetermined
        covariance = (
            prediction.J_unknowns @ self.covariance @ prediction.J_unknowns.T
            + unknown @ unknown.T
            + prediction.J_picture @ tag_b.covariance @ prediction.J_picture.T
            + prediction.J_arm @ prediction.arm_covariance @ prediction.J_arm.T
        )
        rotation_covariance = (
            prediction.J_turn_unknowns @ self.covariance @ prediction.J_turn_unknowns.T
            + prediction.J_turn_picture @ tag_b.covariance @ prediction.J_turn_picture.T
        )
        return ExpectedCoordinate(
            target=target,
            base_from_wrist=prediction.base_from_wrist,
            position_covariance=frozen_array(covariance, 3, 3),
            u95_mm=radius95(covariance),
            u95_rad=radius95(rotation_covariance),
        )

    def predict(
        self,
        facts: CellFacts,
        target: Target,
        tag_b: TagObservation,
        policy: Policy,
        R_work: Array,
        *,
        refuse: bool = True,
    ) -> Prediction:
        """Expected coordinate with the derivatives that its uncertainty consists of.

        refuse: raise NotObservable where it depends on something undetermined.
        """
        picture = _as_spin(self, facts, tag_b)
        fits = picture is not None
        picture = picture or _anywhere(self, tag_b)
        tip_in_wrist = np.asarray(self.tip_in_wrist + facts.tool.work_from_touch_mm)
        point = np.asarray(target.point_in_object)
        flange, R, J, J_turn = _flange(self, point, tip_in_wrist, picture, policy, R_work)
        J_arm = -np.hstack([_EYE, -hat(R @ tip_in_wrist)])
        correction, J_field, arm_covariance = self.arm.deviation(flange)
        n = self.layout.size
        J[:, :n] += J_arm @ J_field
        flange = flange + J_arm @ correction - J @ (picture.gain @ picture.residual)
        J_unknowns = J[:, :n] - J @ picture.gain @ picture.J_unknowns
        if refuse:
            self._check_determined(J_unknowns)
        return Prediction(
            base_from_wrist=Pose(R, flange),
            J_unknowns=J_unknowns,
            J_picture=J @ picture.gain @ picture.sqrt_information,
            J_arm=J_arm,
            arm_covariance=arm_covariance,
            J_turn_unknowns=J_turn[:, :n] - J_turn @ picture.gain @ picture.J_unknowns,
            J_turn_picture=J_turn @ picture.gain @ picture.sqrt_information,
            fits_model=fits,
        )

    def _block(self, part: slice) -> Array:
        unknown = self.undetermined[part]
        return frozen_copy(self.covariance[part, part] + unknown @ unknown.T)

    def _check_determined(self, J_unknowns: Array) -> None:
        shifts_mm = np.linalg.norm(J_unknowns @ self.undetermined, axis=0)
        if shifts_mm.size and float(shifts_mm.max()) > IRRELEVANT_MM:
            raise NotObservable(
                "the expected coordinate depends on "
                f"{unknown_in_words(self.layout, self.undetermined)}, which the recording "
                "leaves undetermined: touch with the wrist tilted by 20 degrees or more about two "
                "axes, look with tag A in view, or keep the wrist as it was touched",
                rank=self.layout.size - shifts_mm.size,
                unknowns=self.layout.size,
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    """The object's motion in one picture, and how to improve unknowns and motion by it.

    residual (6,), whitened; J_unknowns (6, n); gain (n + k, 6): minus the correction of (unknowns,
    motion) per residual; motion: of one.
    """

    motion: ObjectMotions
    residual: Array
    J_unknowns: Array
    gain: Array
    sqrt_information: Array


def _tags_of(tag: TagObservation) -> Tags:
    C = tag.camera_from_tag
    return Tags(C.rotation[None], C.translation[None], sqrt_information(tag.covariance)[None])


def _as_spin(solution: JointSolution, facts: CellFacts, tag: TagObservation) -> _Picture | None:
    """The picture as one spin more; None where it cannot be one."""
    layout = solution.layout
    if not layout.axis:
        return None
    tags = _tags_of(tag)
    motion = tag.camera_from_tag @ solution.camera_from_tag_b.inverse()
    table_motion = table_motion_of(solution.camera_from_axis, motion, facts.object.motion)[None]
    motions = object_motions(solution.camera_from_axis, table_motion, layout)
    r, J, J_motion = (
        part[0] for part in moved_tag(solution.camera_from_tag_b, tags, motions, layout)
    )
    S = np.eye(6) + J @ solution.covariance @ J.T
    S_inv = np.linalg.inv(S)
    motion_gain = np.linalg.solve(J_motion.T @ S_inv @ J_motion, J_motion.T @ S_inv)
    left = np.eye(6) - J_motion @ motion_gain
    misfit = float((left @ r) @ S_inv @ (left @ r))
    if misfit > chi2_quantile(_FITS_MODEL, 6 - len(layout.object_motions)):
        return None
    gain = np.vstack([solution.covariance @ J.T @ S_inv @ left, motion_gain])
    return _Picture(motions, r, J, gain, tags.sqrt_informations[0])


def _anywhere(solution: JointSolution, tag: TagObservation) -> _Picture:
    """The object where the picture alone says."""
    layout = solution.layout
    tags = _tags_of(tag)
    M = tag.camera_from_tag @ solution.camera_from_tag_b.inverse()
    J_axis = np.zeros((1, 6, len(layout.axis)))
    motions = ObjectMotions(M.rotation[None], M.translation[None], J_axis, np.eye(6)[None])
    r, J, J_motion = (
        part[0] for part in moved_tag(solution.camera_from_tag_b, tags, motions, layout)
    )
    gain = np.vstack([np.zeros((layout.size, 6)), np.linalg.inv(J_motion)])
    return _Picture(motions, r, J, gain, tags.sqrt_informations[0])


def _flange(
    solution: JointSolution,
    point_in_object: Array,
    tip_in_wrist: Array,
    picture: _Picture,
    policy: Policy,
    R_work: Array,
) -> tuple[Array, Array, Array, Array]:
    """Flange (3,), wrist (3, 3), derivatives (3, n + k) of both by unknowns and motion."""
    layout, motions = solution.layout, picture.motion
    X, N = solution.base_from_camera, Pose(motions.rotations[0], motions.translations[0])
    taught = solution.base_from_object @ point_in_object
    in_camera = N @ (X.inverse() @ taught)
    point = X @ in_camera
    turn = X.rotation @ N.rotation @ X.rotation.T
    n, k = layout.size, motions.J_motion.shape[2]
    J, J_turn = np.zeros((3, n + k)), np.zeros((3, n + k))
    motion = np.zeros((6, n + k))
    motion[:, layout.axis_columns], motion[:, n:] = motions.J_axis[0], motions.J_motion[0]
    J += X.rotation @ left_jacobian(in_camera[None])[0] @ motion
    J[:, layout.OBJECT] = turn @ left_jacobian(taught[None])[0]
    J[:, layout.CAMERA] = left_jacobian(point[None])[0] - J[:, layout.OBJECT]
    R = R_work
    if policy is Policy.FOLLOW:
        R = turn @ R_work
        J_turn += X.rotation @ motion[3:]
        J_turn[:, layout.CAMERA.start + 3 : layout.CAMERA.stop] = _EYE - turn
    tip = R @ tip_in_wrist
    J += hat(tip) @ J_turn
    J[:, layout.TCP] = -R
    return point - tip, R, J, J_turn
