"""Where the camera stands in a picture, for the paper's plans: by tag A (Eq. 5, 16), its stability, or both."""

from dataclasses import dataclass, field, replace

import numpy as np

from vgrd.calibration.touches import ReferenceTagA
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import CAMERA_STANDS, SAME_ORIENTATION_RAD
from vgrd.model import ArmModel, CameraPlace, FlangeTag, TagObservation, frozen_array

_EYE = np.eye(6)


def _nothing() -> Array:
    return frozen_array(np.zeros((6, 6)), 6, 6)


@dataclass(frozen=True, slots=True, eq=False)
class SeenTag:
    """Tag B as a camera that still stands where it stood while teaching would see it.

    The covariance of `tag` holds what is not known of the camera's place but the error of
    base_from_camera: J_hand_eye (6, 6) is the derivative by it (both left).
    """

    tag: TagObservation
    J_hand_eye: Array = field(default_factory=_nothing)

    @property
    def camera_from_tag(self) -> Pose:
        """Place of it."""
        return self.tag.camera_from_tag

    @property
    def covariance(self) -> Array:
        """(6, 6) of it."""
        return self.tag.covariance


@dataclass(frozen=True, slots=True, eq=False)
class CameraLinks:
    """What tells where the camera stands, as it was taught.

    hand_eye_covariance: (6, 6) of base_from_camera. reference_tag_a: tag A while teaching, None where
    none is known.
    """

    base_from_camera: Pose
    hand_eye_covariance: Array
    wrist_from_tag_a: Pose | None
    reference_tag_a: ReferenceTagA | None
    arm: ArmModel


@dataclass(frozen=True, slots=True, eq=False)
class _Displacement:
    """taught_from_camera, its covariance (6, 6) without the hand-eye, derivative (6, 6) by that; left."""

    taught_from_camera: Pose
    spread: Array
    J_hand_eye: Array = field(default_factory=_nothing)


def seen_by_taught_camera(
    tag_b: TagObservation, place: CameraPlace, links: CameraLinks
) -> SeenTag:
    """Tag B as a camera that still stands where it stood while teaching would see it.

    Raises TagNotSeen for a camera that may stand anywhere while nothing tells where.
    """
    if place.is_exact:
        return SeenTag(tag_b)
    moved = _displacement(place, links)
    G = moved.taught_from_camera.adjoint()
    seen = replace(
        tag_b,
        camera_from_tag=moved.taught_from_camera @ tag_b.camera_from_tag,
        covariance=G @ tag_b.covariance @ G.T + moved.spread,
    )
    return SeenTag(seen, moved.J_hand_eye)


def _displacement(place: CameraPlace, links: CameraLinks) -> _Displacement:
    by_tag_a = None if place.flange_tag is None else _by_tag_a(place.flange_tag, links)
    if by_tag_a is None:
        if place.is_free and place.flange_tag is not None:
            raise TagNotSeen(
                "where the camera stands is not known without a hand-eye calibration: take pictures with "
                "the wrist as it was while teaching"
            )
        place.check_known()
        return _Displacement(Pose.identity(), np.diag(place.stability**2))
    if place.is_free:
        return by_tag_a
    J, way = by_tag_a.J_hand_eye, by_tag_a.taught_from_camera.log()
    of_hand_eye, prior = J @ links.hand_eye_covariance @ J.T, np.diag(place.stability**2)
    spread = by_tag_a.spread + of_hand_eye
    if float(way @ np.linalg.solve(spread + prior, way)) > chi2_quantile(CAMERA_STANDS, 6):
        return by_tag_a  # it was moved farther than its stability allows
    gain = np.linalg.solve(spread + prior, prior).T
    left = prior - gain @ prior - gain @ of_hand_eye @ gain.T
    return _Displacement(Pose.exp(gain @ way), left, gain @ J)


def _by_tag_a(seen: FlangeTag, links: CameraLinks) -> _Displacement | None:
    """By tag A in both pictures where the wrist stands alike in them, else by the hand-eye."""
    reference = links.reference_tag_a
    if reference is not None:
        turn_rad = seen.base_from_wrist.distance(reference.base_from_wrist)[1]
        if turn_rad <= SAME_ORIENTATION_RAD:
            return _by_both_pictures(seen, reference, links)
    if links.wrist_from_tag_a is None:
        return None
    return _by_chain(seen, links, links.wrist_from_tag_a)


def _by_both_pictures(
    seen: FlangeTag, reference: ReferenceTagA, links: CameraLinks
) -> _Displacement:
    """Eq. 16-19: tag A then and now, the flange's own displacement between both taken along.

    While the wrist keeps its orientation only the rotation of the hand-eye counts.
    """
    B, C = links.base_from_camera, links.base_from_camera.inverse()
    W0, W1 = reference.base_from_wrist, seen.base_from_wrist
    carried = W1 @ W0.inverse()
    in_taught = C @ carried @ B
    moved = in_taught @ reference.camera_from_tag_a @ seen.tag.camera_from_tag.inverse()
    J_arm = np.hstack([-(C @ carried).adjoint() @ _turning(W0), C.adjoint() @ _turning(W1)])
    H = J_arm @ links.arm.cholesky_factor(np.array([W0.translation, W1.translation]))
    J_then, J_now = in_taught.adjoint(), moved.adjoint()
    spread = (
        H @ H.T + J_then @ reference.covariance @ J_then.T + J_now @ seen.tag.covariance @ J_now.T
    )
    return _Displacement(moved, spread, C.adjoint() @ (carried.adjoint() - _EYE))


def _by_chain(seen: FlangeTag, links: CameraLinks, wrist_from_tag_a: Pose) -> _Displacement:
    """Eq. 5: from the robot over tag A to the camera.

    The errors of the hand-eye calibration cancel where tag A is seen as it was while teaching, and
    count with the motion of the object.
    """
    camera_from_base = links.base_from_camera.inverse()
    W = seen.base_from_wrist
    chain = camera_from_base @ W @ wrist_from_tag_a @ seen.tag.camera_from_tag.inverse()
    J_arm, J_tag = camera_from_base.adjoint() @ _turning(W), chain.adjoint()
    arm = np.diag(links.arm.variances())
    return _Displacement(
        chain, np.asarray(J_arm @ arm @ J_arm.T + J_tag @ seen.tag.covariance @ J_tag.T)
    )


def _turning(base_from_wrist: Pose) -> Array:
    """(6, 6) from an error of the arm, which turns about its flange, to a left one."""
    out = np.eye(6)
    out[:3, 3:] = hat(base_from_wrist.translation)
    return out
