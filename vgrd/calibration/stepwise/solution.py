"""What the paper's plans solve, as it is stored and served.

The object has turned by R_Q (in the camera) since the reference picture. With a recorded pivot the
flange follows Eq. 19 and only the rotation of the hand-eye counts; without one the full motion
B M B^-1 is applied, B = base_from_camera. A camera that moved is followed by tag A: in the special plan
by where tag A was in the reference picture (Eq. 16-19), so that no place of the hand-eye counts either.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from vgrd.calibration.acceptance import served_radius
from vgrd.calibration.stepwise.camera import CameraLinks, SeenTag, seen_by_taught_camera
from vgrd.calibration.stepwise.chain import CameraChain, MovedPoint, Pivot
from vgrd.calibration.stepwise.series import StepwiseSeries
from vgrd.calibration.touches import ReferenceTagA
from vgrd.errors import InputError, NotObservable
from vgrd.geometry import Array, Pose, log_rotation
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.covariance import radius95, wide_directions
from vgrd.judging.thresholds import (
    FITS_MODEL,
    IRRELEVANT_MM,
    OPEN_TCP_MM,
    SAME_ORIENTATION_RAD,
)
from vgrd.model import (
    UNMOVED,
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
    TaughtPoint,
    TcpEstimate,
    frozen_array,
)

_EYE = np.eye(3)
LEFT_OPEN_MM = OPEN_TCP_MM / 2  # sigma: touches that tell an axis leave a hundredth of it
_NOISE_RADII = 2.0  # twice the 95 % radius: one picture in a million
_PIVOT_STANDS = chi2_quantile(FITS_MODEL, 3)  # its shift in the camera has three numbers


@dataclass(frozen=True, slots=True, eq=False)
class _Flange:
    """Where the flange must be now, mm: position (3,), how the object moved, derivative by the touches."""

    position: Array
    motion: MovedPoint
    J_touches: Array


@dataclass(frozen=True, slots=True, eq=False)
class StepwiseSolution:
    """What both of the paper's plans share.

    touch_covariances: by target, mm^2, of what its answer depends on besides the chain. pivot: None
    where none was recorded; it replaces the hand-eye translation.
    """

    METHOD: ClassVar[str] = ""

    chain: CameraChain
    wrist_from_tag_a: Pose | None
    pivot: Pivot | None
    touch_covariances: Mapping[str, Array]

    @property
    def base_from_camera(self) -> Pose:
        """From the hand-eye calibration."""
        return self.chain.base_from_camera

    @property
    def camera_from_tag_b(self) -> Pose:
        """Tag B in the reference picture (0), at which the targets were taught."""
        return self.chain.camera_from_tag_b

    @property
    def reference_covariance(self) -> Array:
        """(6, 6) of camera_from_tag_b."""
        return self.chain.reference_covariance

    @property
    def camera_from_axis(self) -> Pose:
        """A frame whose z is the axis about which the object may turn."""
        reference = self.chain.camera_from_tag_b
        place = reference.translation if self.pivot is None else reference @ self.pivot.in_tag_b
        return Pose(reference.rotation, place)

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

        R_work: (3, 3) of the wrist, the object as taught (follow) or at the touch (fixed, requested).
        camera: where it may stand. u95_mm counts touches, hand-eye, both pictures, pivot, the
        camera's place and the arm. Raises InputError for what the calibration cannot serve, naming
        the remedy, TagNotSeen where nothing tells where the camera stands.
        """
        seen = self._seen(facts, tag_b, camera)
        flange = self._flange(facts, taught, seen, policy, R_work)
        turn = flange.motion.rotation
        rotation_covariance = self.chain.rotation_covariance(seen, turn)
        touches = self.touch_covariances.get(taught.target.name, taught.covariance)
        if flange.J_touches.shape[1] == 3:
            touches = taught.covariance
        _check_open(flange.J_touches @ wide_directions(touches, LEFT_OPEN_MM), rotation_covariance)
        covariance = (
            flange.J_touches @ touches @ flange.J_touches.T
            + flange.motion.covariance
            + facts.robot_sigma_mm**2 * _EYE
        )
        follows = policy is Policy.FOLLOW
        return ExpectedCoordinate(
            target=taught.target,
            base_from_wrist=Pose(_wrist(policy, turn, R_work), flange.position),
            position_covariance=frozen_array(covariance, 3, 3),
            u95_mm=served_radius(covariance, camera),
            u95_rad=served_radius(rotation_covariance, camera) if follows else 0.0,
            fits=self._misfit(facts, seen) <= _PIVOT_STANDS,
            taught_from_camera=_displacement(seen, tag_b),
        )

    def in_tag_b(self, facts: CellFacts, taught: TaughtPoint) -> PlacedPoint | None:
        """A target in tag B's frame (III-C); None where the TCP is not known or open."""
        del facts, taught
        return None

    def examine(self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace) -> LinkReport:
        """Whether a picture contradicts the calibration: its rotation centre lies elsewhere.

        Raises TagNotSeen as `expected`.
        """
        seen = self._seen(facts, tag_b, camera)
        misfit = self._misfit(facts, seen)
        moved = None if camera.is_exact else _displacement(seen, tag_b)
        if misfit <= _PIVOT_STANDS:
            return LinkReport(True, misfit, moved)
        links = [Link.TAG_B, Link.OBJECT]
        if camera.flange_tag is not None and not camera.is_exact:
            links.append(Link.TAG_A)
        elif not camera.is_free:
            links.append(Link.CAMERA)
        return LinkReport(False, misfit, moved, suspects=tuple(links))

    def after_slip(self, slip: SlipEstimate) -> Self:
        """Always InputError: a plan in steps does not tell what a slip changes."""
        raise InputError(f"{slip.link} cannot be taken over by plan {self.METHOD}: teach anew")

    def series(self, facts: CellFacts, stability: Array) -> StepwiseSeries:
        """Judges pictures in their order; their camera's place holds the stability already."""
        del stability
        return StepwiseSeries(lambda tag_b, camera: self.examine(facts, tag_b, camera))

    def _seen(self, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace) -> SeenTag:
        links = CameraLinks(
            self.base_from_camera,
            self.chain.hand_eye_covariance,
            self.wrist_from_tag_a,
            self._reference_tag_a(),
            facts.arm,
        )
        return seen_by_taught_camera(tag_b, camera, links)

    def _reference_tag_a(self) -> ReferenceTagA | None:
        """None: the camera is found by the hand-eye alone."""
        return None

    def _misfit(self, facts: CellFacts, now: SeenTag) -> float:
        """How far a turntable's rotation centre is from where it was."""
        if self.pivot is None or facts.object.motion is not Motion.TURNTABLE:
            return 0.0
        shift, covariance = self.chain.pivot_shift(self.pivot, now)
        return float(shift @ np.linalg.solve(covariance, shift))

    @abstractmethod
    def _flange(
        self,
        facts: CellFacts,
        taught: TaughtPoint,
        now: SeenTag,
        policy: Policy,
        R_work: Array,
    ) -> _Flange: ...


@dataclass(frozen=True, slots=True, eq=False)
class UniversalSolution(StepwiseSolution):
    """Touches with varied wrists: the TCP is known.

    touch_covariances: (9, 9) of (flange_in_base, pivot_in_base, tcp_in_wrist), the pivot's rows 0
    where there is none.
    """

    METHOD: ClassVar[str] = "universal"

    tcp: TcpEstimate

    def in_tag_b(self, facts: CellFacts, taught: TaughtPoint) -> PlacedPoint | None:
        """A target in tag B's frame (III-C); None where the TCP is open."""
        if is_open(self.tcp.covariance):
            return None
        R_work, tip = taught.base_from_work, self.tcp.in_wrist + facts.tool.work_from_touch_mm
        J = np.hstack([_EYE, np.zeros((3, 3)), R_work])
        return self.chain.in_tag_b(
            taught.flange_in_base + R_work @ tip,
            J @ self.touch_covariances[taught.target.name] @ J.T,
        )

    def _flange(
        self,
        facts: CellFacts,
        taught: TaughtPoint,
        now: SeenTag,
        policy: Policy,
        R_work: Array,
    ) -> _Flange:
        """By (flange, pivot, TCP).

        A wrist that follows the object carries its own tip along: the motion of the whole flange by
        the hand-eye then needs no TCP, while the pivot's place in the base would.
        """
        tip_in_wrist = self.tcp.in_wrist + facts.tool.work_from_touch_mm
        tip = taught.flange_in_base + taught.base_from_work @ tip_in_wrist
        J_pivot = np.zeros((3, 3))
        if policy is not Policy.FOLLOW and self.pivot is not None:
            motion = self.chain.move_about(self.pivot, tip, now)
            J_pivot = _EYE - motion.rotation
        else:
            motion = self.chain.move(tip, now)
        R_now = _wrist(policy, motion.rotation, R_work)
        J_tcp = motion.rotation @ taught.base_from_work - R_now
        J_touches = np.hstack([motion.rotation, J_pivot, J_tcp])
        return _Flange(motion.position - R_now @ tip_in_wrist, motion, J_touches)


@dataclass(frozen=True, slots=True, eq=False)
class SpecialSolution(StepwiseSolution):
    """Touches with one wrist orientation: no TCP, the flange itself is carried along.

    touch_covariances: (6, 6) of (flange_in_base, pivot_in_base), empty without pivot. reference_tag_a:
    None where tag A was not seen while teaching, and in early files.
    """

    METHOD: ClassVar[str] = "special"

    reference_tag_a: ReferenceTagA | None = None

    @property
    def tcp(self) -> TcpEstimate | None:
        """Not known."""
        return None

    def _reference_tag_a(self) -> ReferenceTagA | None:
        return self.reference_tag_a

    def _flange(
        self,
        facts: CellFacts,
        taught: TaughtPoint,
        now: SeenTag,
        policy: Policy,
        R_work: Array,
    ) -> _Flange:
        """By (flange, pivot flange) of the touches."""
        del facts  # the tool does not matter
        _check_orientation(taught, R_work)
        flange = taught.flange_in_base
        if policy is Policy.FOLLOW:
            motion = self.chain.move(flange, now)
            return _Flange(motion.position, motion, motion.rotation)
        if self.pivot is None:
            raise InputError(
                "policy 'fixed' needs the rotation centre or the TCP: record spins of the turntable "
                "(and its centre in CAD), or touch with varied wrists, or use policy 'follow'"
            )
        motion = self.chain.move_about(self.pivot, flange, now)
        return _Flange(
            motion.position, motion, np.hstack([motion.rotation, _EYE - motion.rotation])
        )


def _displacement(seen: SeenTag, tag_b: TagObservation) -> Pose:
    """taught_from_camera, from tag B as the taught camera sees it and as it was seen."""
    return seen.camera_from_tag @ tag_b.camera_from_tag.inverse()


def _wrist(policy: Policy, turn: Array, R_work: Array) -> Array:
    return turn @ R_work if policy is Policy.FOLLOW else R_work


def is_open(covariance: Array) -> bool:
    """Whether a TCP's covariance (3, 3) says that the touches left it open along an axis."""
    return bool(wide_directions(covariance, LEFT_OPEN_MM).size)


def _check_open(open_mm: Array, rotation_covariance: Array) -> None:
    """Raise where the answer depends on what the touches left open, (3, k) mm.

    What the noise of the object's measured rotation lets it depend on that is noise, and counted so.
    """
    noise_mm = OPEN_TCP_MM * _NOISE_RADII * radius95(rotation_covariance)
    if float(np.linalg.norm(open_mm)) <= max(IRRELEVANT_MM, noise_mm):
        return
    raise NotObservable(
        "the expected coordinate depends on the TCP along the one axis about which the wrist turned, "
        "which the touches leave open: keep the wrist at the tilt of the touches, or touch with the "
        "wrist tilted by 20 degrees or more about two axes",
        rank=8,
        unknowns=9,
    )


def _check_orientation(taught: TaughtPoint, R_work: Array) -> None:
    turn_rad = float(np.linalg.norm(log_rotation(R_work @ taught.base_from_work.T)))
    if turn_rad > SAME_ORIENTATION_RAD:
        raise InputError(
            f"the wrist is to be turned by {np.degrees(turn_rad):.2f} degrees against the touches, but "
            "the TCP is unknown (all touches had one orientation): touch with varied wrists"
        )
