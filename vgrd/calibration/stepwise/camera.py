"""Where the camera stands in a picture, for the paper's plans: by tag A (Eq. 5), by its stability, or by both."""

import numpy as np

from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import CAMERA_STANDS
from vgrd.model import ArmModel, CameraPlace, FlangeTag, TagObservation


def seen_by_taught_camera(
    tag_b: TagObservation,
    place: CameraPlace,
    base_from_camera: Pose,
    wrist_from_tag_a: Pose | None,
    robot_sigma_mm: float,
) -> TagObservation:
    """Tag B as a camera that still stands where it stood while teaching would see it.

    Its covariance holds what is not known of the camera's place. The errors of the hand-eye calibration
    cancel where tag A is seen as it was while teaching, and count with the motion of the object. Raises
    TagNotSeen for a camera that may stand anywhere while nothing tells where.
    """
    if place.is_exact:
        return tag_b
    taught_from_camera, spread = _displacement(
        place, base_from_camera, wrist_from_tag_a, robot_sigma_mm
    )
    G = taught_from_camera.adjoint()
    return TagObservation(
        tag_b.tag,
        taught_from_camera @ tag_b.camera_from_tag,
        G @ tag_b.covariance @ G.T + spread,
        tag_b.corners_px,
        tag_b.rms_px,
        tag_b.chi2,
    )


def _displacement(
    place: CameraPlace,
    base_from_camera: Pose,
    wrist_from_tag_a: Pose | None,
    robot_sigma_mm: float,
) -> tuple[Pose, Array]:
    """taught_from_camera and its covariance (6, 6), left."""
    if place.flange_tag is None or wrist_from_tag_a is None:
        place.check_known()
        return Pose.identity(), np.diag(place.stability**2)
    chain, spread = _by_chain(place.flange_tag, base_from_camera, wrist_from_tag_a, robot_sigma_mm)
    if place.is_free:
        return chain, spread
    way, prior = chain.log(), np.diag(place.stability**2)
    gain = np.linalg.solve(spread + prior, prior).T
    if float(way @ np.linalg.solve(spread + prior, way)) > chi2_quantile(CAMERA_STANDS, 6):
        return chain, spread  # it was moved farther than its stability allows
    return Pose.exp(gain @ way), prior - gain @ prior


def _by_chain(
    seen: FlangeTag, base_from_camera: Pose, wrist_from_tag_a: Pose, robot_sigma_mm: float
) -> tuple[Pose, Array]:
    """Eq. 5: from the robot over tag A to the camera."""
    camera_from_base = base_from_camera.inverse()
    W = seen.base_from_wrist
    tag = seen.tag
    chain = camera_from_base @ W @ wrist_from_tag_a @ tag.camera_from_tag.inverse()
    turning = np.eye(6)
    turning[:3, 3:] = hat(W.translation)  # the arm turns about its flange
    J_arm, J_tag = camera_from_base.adjoint() @ turning, chain.adjoint()
    arm = np.diag(ArmModel.of(robot_sigma_mm).variances())
    return chain, np.asarray(J_arm @ arm @ J_arm.T + J_tag @ tag.covariance @ J_tag.T)
