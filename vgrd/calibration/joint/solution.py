"""The joint estimate as it is stored and served: expected coordinates from one picture.

A new picture counts as one spin more (Eq. 5 and 6 with the object's motion estimated along): it
improves the unknowns a little, and only has to tell the turn of the object. Where the camera may have
moved since teaching, tag A in the picture tells where it stands (`picture`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from vgrd.calibration.acceptance import served_radius
from vgrd.calibration.joint.answers import Flange, Prediction, Wish, flange_of
from vgrd.calibration.joint.camera_corrections import (
    TAG_A,
    TAG_B,
    CameraCorrections,
    RefinedCorrections,
)
from vgrd.calibration.joint.fit import unknown_in_words
from vgrd.calibration.joint.links import slip_jacobians, slip_traces, suspects
from vgrd.calibration.joint.noise.kinds import NOISE_OF_TAG_A, NOISE_OF_TAG_B
from vgrd.calibration.joint.picture import (
    ArmPrior,
    Links,
    PictureFit,
    PictureModel,
    first_motion,
    guess_camera,
    weigh,
)
from vgrd.calibration.joint.sequence import JointSeries, Sighting
from vgrd.calibration.joint.state import StepLayout, left_jacobian, taught_place
from vgrd.calibration.levels import Level
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, hat
from vgrd.judging.thresholds import IRRELEVANT_MM
from vgrd.model import (
    UNMOVED,
    ArmKnowledge,
    CameraPlace,
    CellFacts,
    ExpectedCoordinate,
    Link,
    LinkReport,
    Motion,
    PlacedPoint,
    Policy,
    SlipEstimate,
    TagObservation,
    Target,
    TaughtPoint,
    TcpEstimate,
    frozen_array,
    frozen_copy,
)

_EYE = np.eye(3)


@dataclass(frozen=True, slots=True)
class Refinement:
    """A number of the cell file that was estimated: so many sigmas beyond it, and that sigma."""

    sigma: float
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class JointSolution:
    """Values of the unknowns that answers depend on; the spins are marginalised.

    tip_in_wrist: (3,), any value that fits where the TCP is undetermined. axis, object_motions: which
    body-frame motions of camera_from_axis (z: axis of turning) and of the object on it are unknowns.
    has_point: a fixed point was touched, whose place tells of the arm's errors. bare: the targets without
    CAD that were touched; bare_in_base: (b, 3), where. inexact: targets that the part has elsewhere than CAD,
    by offsets_in_object (c, 3). refined: tag sizes and intrinsics by name. levels: of noise, as found.
    covariance (n, n) of a step in (base_from_camera, wrist_from_tag_a, TCP, base_from_object,
    camera_from_tag_b, bare targets, offsets, axis, fixed point, refined numbers); undetermined (n, z):
    500 mm or 1 rad along what the session left open.
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
    bare: tuple[str, ...]
    bare_in_base: Array
    inexact: tuple[str, ...]
    offsets_in_object: Array
    refined: Mapping[str, Refinement]
    levels: tuple[Level, ...]
    covariance: Array
    undetermined: Array
    arm: ArmKnowledge

    @property
    def layout(self) -> StepLayout:
        """Where the unknowns stand in a step."""
        return StepLayout(
            self.axis,
            self.object_motions,
            0,
            self.has_point,
            len(self.refined),
            bare=self.bare,
            inexact=self.inexact,
        )

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
        camera: CameraPlace = UNMOVED,
    ) -> ExpectedCoordinate:
        """Flange pose at which the work tip meets the target in the picture given.

        As `expected_for`.
        """
        return self.expected_for(facts, taught.target, tag_b, policy, R_work, camera)

    def expected_for(
        self,
        facts: CellFacts,
        target: Target,
        tag_b: TagObservation,
        policy: Policy,
        R_work: Array,
        camera: CameraPlace = UNMOVED,
    ) -> ExpectedCoordinate:
        """The same for a target of CAD that was not touched.

        R_work: (3, 3) of the wrist, the object as taught (follow) or at the touch (fixed, requested).
        Raises NotObservable where the answer depends on what the session left undetermined, or on the
        place of a camera that nothing tells.
        """
        tag_b, camera = self._known(facts, tag_b, camera)
        prediction = self.predict(facts, target, tag_b, policy, R_work, camera)
        unknown = prediction.J_unknowns @ self.undetermined
        covariance = prediction.covariance(self.covariance, tag_b.covariance) + unknown @ unknown.T
        return ExpectedCoordinate(
            target=target,
            base_from_wrist=prediction.base_from_wrist,
            position_covariance=frozen_array(covariance, 3, 3),
            u95_mm=served_radius(covariance, camera),
            u95_rad=served_radius(
                prediction.turn_covariance(self.covariance, tag_b.covariance), camera
            ),
            fits=prediction.fits_model,
            taught_from_camera=prediction.taught_from_camera,
        )

    def predict(
        self,
        facts: CellFacts,
        target: Target,
        tag_b: TagObservation,
        policy: Policy,
        R_work: Array,
        camera: CameraPlace = UNMOVED,
        *,
        refuse: bool = True,
    ) -> Prediction:
        """Expected coordinate with the derivatives that its uncertainty consists of.

        tag_b, camera: where it may stand, tags as seen with what was refined. refuse: raise NotObservable
        where the answer depends on something undetermined.
        """
        tip_in_wrist = np.asarray(self.tip_in_wrist + facts.tool.work_from_touch_mm)
        wish = Wish(*self.taught_place(target), tip_in_wrist, policy, R_work)
        picture, flange, arm = self._picture(facts, wish, tag_b, facts.object.motion, camera)
        if not (fits := picture.stands):
            picture, flange, arm = self._picture(facts, wish, tag_b, None, camera)
        n, w = self.layout.size, len(arm.mean)
        J, J_turn = (
            np.hstack([part[:, :n], np.zeros((3, w)), part[:, n:]])
            for part in (flange.J, flange.J_turn)
        )
        J_arm = -np.hstack([_EYE, -hat(flange.base_from_wrist.rotation @ tip_in_wrist)])
        J[:, n + w - 6 : n + w] = J_arm
        J[:, :n] += J_arm @ arm.J_unknowns[-6:]
        place = flange.base_from_wrist.translation + J_arm @ arm.mean[-6:]
        known, noise = J[:, : n + w] - J @ picture.gain @ picture.J_known, J @ picture.gain
        known_turn = J_turn[:, : n + w] - J_turn @ picture.gain @ picture.J_known
        noise_turn = J_turn @ picture.gain
        if refuse:
            self._check_determined(known[:, :n])
        return Prediction(
            base_from_wrist=Pose(
                flange.base_from_wrist.rotation, place - noise @ picture.residual
            ),
            J_unknowns=known[:, :n],
            J_picture=noise[:, :6] @ picture.sqrt_information,
            J_arm=known[:, n:],
            arm_covariance=arm.covariance,
            J_camera=noise[:, 6:],
            J_turn_unknowns=known_turn[:, :n],
            J_turn_picture=noise_turn[:, :6] @ picture.sqrt_information,
            J_turn_arm=known_turn[:, n:],
            J_turn_camera=noise_turn[:, 6:],
            taught_from_camera=picture.taught_from_camera,
            fits_model=fits,
        )

    def taught_place(self, target: Target) -> tuple[Array, Array]:
        """Where a target stood while touched, (3,) base, and its derivative (3, n).

        Raises NotObservable for one that nothing tells.
        """
        return taught_place(
            target,
            self.base_from_object,
            self.bare_in_base,
            self.offsets_in_object,
            self.layout,
        )

    def in_tag_b(self, facts: CellFacts, taught: TaughtPoint) -> PlacedPoint | None:
        """A target in tag B's frame (III-C); None where the session left that open."""
        del facts
        place, J_place = self.taught_place(taught.target)
        X, F = self.base_from_camera, self.camera_from_tag_b
        point_in_camera = X.inverse() @ place
        J = J_place
        J[:, StepLayout.CAMERA] -= left_jacobian(place[None])[0]
        J[:, StepLayout.TAG_B] -= X.rotation @ left_jacobian(point_in_camera[None])[0]
        J = (X @ F).rotation.T @ J
        if float(np.abs(J @ self.undetermined).max(initial=0.0)) > IRRELEVANT_MM:
            return None
        return PlacedPoint(
            frozen_array(F.inverse() @ point_in_camera, 3),
            frozen_array(J @ self.covariance @ J.T, 3, 3),
        )

    def examine(self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace) -> LinkReport:
        """Whether a picture contradicts the calibration, and which links may have moved.

        Raises TagNotSeen as `expected_for`.
        """
        tag_b, camera = self._known(facts, tag_b, camera)
        return _report(self._model(facts, tag_b, facts.object.motion, camera), camera)

    def after_slip(self, slip: SlipEstimate) -> Self:
        """The estimate with a tag that sits elsewhere; its uncertainty grows by that of the slip."""
        name, part = {
            Link.TAG_A: ("wrist_from_tag_a", StepLayout.TAG_A),
            Link.TAG_B: ("camera_from_tag_b", StepLayout.TAG_B),
        }[slip.link]
        moved = getattr(self, name) @ Pose.exp(slip.tangent)
        covariance = self.covariance.copy()
        G = moved.adjoint()
        covariance[part, part] += G @ slip.covariance @ G.T
        return replace(self, **{name: moved, "covariance": frozen_copy(covariance)})

    def series(self, facts: CellFacts, stability: Array) -> JointSeries:
        """Judges pictures in their order, each by what the earlier ones told; stability: of the camera."""
        return JointSeries(
            self.covariance,
            self.arm,
            stability,
            lambda tag_b, camera: self._told(facts, tag_b, camera),
        )

    def _told(self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace) -> Sighting:
        tag_b, camera = self._known(facts, tag_b, camera)
        model = self._model(facts, tag_b, facts.object.motion, camera)
        motions = model.motions
        return Sighting(
            report=_report(model, camera),
            rows=model.rows,
            slips=slip_jacobians(model),
            camera_from_tag_b=Pose(motions.rotations[0], motions.translations[0])
            @ self.camera_from_tag_b,
            taught_from_camera=model.guess.taught_from_camera,
        )

    def slip_traces(
        self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace
    ) -> Mapping[Link, Array]:
        """How a slip (mm, rad) of each link would show in a picture, (f, 6) in sigmas; `links`.

        Raises TagNotSeen as `expected_for`.
        """
        tag_b, camera = self._known(facts, tag_b, camera)
        model = self._model(facts, tag_b, facts.object.motion, camera)
        return slip_traces(model.with_place(camera))

    def corrections(self, facts: CellFacts) -> RefinedCorrections:
        """What was refined of the cell's tag sizes and intrinsics."""
        sigmas = {name: number.sigma for name, number in self.refined.items()}
        values = np.array([number.value for number in self.refined.values()])
        return RefinedCorrections(CameraCorrections.with_sigmas(facts, sigmas), values)

    def measured_tag_b(self, facts: CellFacts, camera_from_tag_b: Pose) -> Pose:
        """Tag B there, as a detector that trusts the cell file measures it."""
        return self.corrections(facts).measured(camera_from_tag_b, TAG_B)

    def _known(
        self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace
    ) -> tuple[TagObservation, CameraPlace]:
        """The tags of a picture as seen with what was refined, their noise as it was found."""
        corrections = self.corrections(facts)
        seen_b = _at_level(corrections.corrected(tag_b, TAG_B), self.levels, NOISE_OF_TAG_B)
        if (flange := camera.flange_tag) is None:
            return seen_b, camera
        seen_a = _at_level(corrections.corrected(flange.tag, TAG_A), self.levels, NOISE_OF_TAG_A)
        return seen_b, replace(camera, flange_tag=replace(flange, tag=seen_a))

    def _model(
        self,
        facts: CellFacts,
        tag_b: TagObservation,
        motion: Motion | None,
        camera: CameraPlace,
    ) -> PictureModel:
        """The picture at the first guess; motion None: the object moved anyhow."""
        links, arm = self._links(facts), self._arm(_stands(camera))
        guess = guess_camera(links, camera, arm)
        tags, motions = first_motion(links, guess, tag_b, motion if self.layout.axis else None)
        return PictureModel(links, guess, arm, tags, motions)

    def _picture(
        self,
        facts: CellFacts,
        wish: Wish,
        tag_b: TagObservation,
        motion: Motion | None,
        camera: CameraPlace,
    ) -> tuple[PictureFit, Flange, ArmPrior]:
        """What the picture tells, the flange at the first guess, the arm in the picture and there."""
        model = self._model(facts, tag_b, motion, camera)
        flange = flange_of(self.base_from_camera, self.layout, wish, model.motions)
        arm = self._arm([*_stands(camera), flange.base_from_wrist.translation], sent=1)
        return weigh(replace(model, arm=arm)), flange, arm

    def _links(self, facts: CellFacts) -> Links:
        return Links(
            self.base_from_camera,
            self.wrist_from_tag_a,
            self.camera_from_tag_b,
            self.camera_from_axis,
            self.layout,
            self.covariance,
            self.corrections(facts),
        )

    def _arm(self, flanges: Sequence[Array], sent: int = 0) -> ArmPrior:
        """The arm's deviations at flange positions (3,), at the last `sent` of which it is sent."""
        return ArmPrior(*self.arm.deviations(np.array(flanges).reshape(-1, 3), sent))

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
                f"axes{_again(self.bare)}, look with tag A in view, or keep the wrist as it was touched",
                rank=self.layout.size - shifts_mm.size,
                unknowns=self.layout.size,
            )


def _at_level(tag: TagObservation, levels: Sequence[Level], name: str) -> TagObservation:
    """The tag with the noise that teaching found instead of the one it states."""
    ratio = next((level.ratio for level in levels if level.name == name), 1.0)
    if ratio == 1.0:
        return tag
    return replace(tag, covariance=frozen_array(ratio**2 * tag.covariance, 6, 6))


def _again(bare: Sequence[str]) -> str:
    """What of tilted touches holds besides where targets are not in CAD."""
    return " (a target in CAD, or one and the same three times)" if bare else ""


def _report(model: PictureModel, camera: CameraPlace) -> LinkReport:
    """What the picture says of its links; camera: as it is configured."""
    picture = weigh(model)
    moved = None if camera.is_exact else picture.taught_from_camera
    misfit, freedom = picture.misfit, picture.freedom
    if picture.fits:
        return LinkReport(True, misfit, moved, model.guess.knocked, freedom=freedom)
    named, slips = suspects(model.with_place(camera))
    return LinkReport(False, misfit, moved, suspects=named, slips=slips, freedom=freedom)


def _stands(camera: CameraPlace) -> list[Array]:
    """Where the flange stood in the picture, (3,), if tag A is used."""
    seen = camera.flange_tag
    return [] if seen is None else [seen.base_from_wrist.translation]
