"""Where a target can be, and how its tool can stand, however its object moves: what stays the same.

A turntable takes a target round a circle, and all of it is right. So distance from the axis and height
along it tell a place that is wrong, the turn does not: that tells the tag, from which a target never goes
away.
"""

import math
from collections.abc import Mapping
from enum import StrEnum

import numpy as np

from vgrd.calibration.calibration import Calibration, Solution
from vgrd.calibration.joint import TAG_B, JointSolution
from vgrd.calibration.stepwise import SpecialSolution
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import radius95
from vgrd.judging.thresholds import SAME_ORIENTATION_RAD, WEAK_TCP_MM
from vgrd.model import Motion, Policy, TagObservation

SIGMAS = 3.0  # of the axis: one calibration in 400 knows it worse


class Lasting(StrEnum):
    """What stays the same of a point of the object, mm."""

    RADIUS = "radius"  # from the axis, or from the centre of turning where no axis is known
    HEIGHT = "height"  # along the axis


def work_tip(calibration: Calibration) -> Array | None:
    """(3,) in the wrist, None where the TCP is not known, or too badly to say where the tip is.

    An arm of four axes tells little of its TCP along the axis of its wrist, and its answers need none of it.
    """
    tcp = calibration.tcp
    if tcp is None or radius95(tcp.covariance) > WEAK_TCP_MM:
        return None
    return tcp.in_wrist + calibration.facts.tool.work_from_touch_mm


def followed_point(calibration: Calibration, base_from_wrist: Pose) -> Array:
    """What moves as the target does, (3,) base: the tip, or the flange where the tip is not known."""
    tip = work_tip(calibration)
    return base_from_wrist.translation if tip is None else base_from_wrist @ tip


def is_followed(
    calibration: Calibration, base_from_wrist: Pose, taught: Pose, policy: Policy
) -> bool:
    """Whether the followed point of a wrist tells of the target; taught: base_from_wrist, as taught.

    Without a tip it is the flange, which does as long as the wrist stands as it was taught, or turns along.
    """
    if work_tip(calibration) is not None or policy is Policy.FOLLOW:
        return True
    return bool(taught.distance(base_from_wrist)[1] <= SAME_ORIENTATION_RAD)


def lasting_numbers(
    calibration: Calibration, point: Array, policy: Policy
) -> Mapping[Lasting, float]:
    """What stays the same of a followed point (3,), base; empty where nothing does.

    A flange with a constant wrist goes round a circle of its own, so that only its height stays.
    """
    solution, motion = calibration.solution, calibration.facts.object.motion
    is_carried = work_tip(calibration) is not None or policy is Policy.FOLLOW
    axis_from_base = _axis_from_base(calibration)
    if axis_from_base is not None:
        x, y, z = axis_from_base @ point
        height = {Lasting.HEIGHT: float(z)}
        keeps_radius = motion is Motion.TURNTABLE and is_carried
        return height | ({Lasting.RADIUS: math.hypot(x, y)} if keeps_radius else {})
    if isinstance(solution, JointSolution) or solution.pivot is None:
        return {}
    is_special = isinstance(solution, SpecialSolution)  # its pivot is that of a flange
    keeps_radius = policy is not Policy.FOLLOW if is_special else work_tip(calibration) is not None
    if motion is Motion.TURNTABLE and keeps_radius:
        return {Lasting.RADIUS: float(np.linalg.norm(point - solution.pivot.in_base))}
    return {}


def base_from_tag(
    calibration: Calibration, tag_b: TagObservation, taught_from_camera: Pose
) -> Pose:
    """Where tag B stands in a picture, by the hand-eye alone; taught_from_camera: how the camera has moved."""
    solution = calibration.solution
    if isinstance(solution, JointSolution):
        tag_b = solution.corrections(calibration.facts).corrected(tag_b, TAG_B)
    return calibration.base_from_camera @ taught_from_camera @ tag_b.camera_from_tag


def away_from_tag_mm(
    calibration: Calibration,
    base_from_wrist: Pose,
    taught: Pose,
    base_from_tag_b: Pose,
    policy: Policy,
) -> float:
    """How far a target is from where it was taught, seen from the tag; 0 where nothing tells.

    base_from_wrist: where the flange is sent; taught: base_from_wrist at the target, as taught.
    """
    if work_tip(calibration) is None and policy is not Policy.FOLLOW:
        return 0.0
    taught_tag = calibration.base_from_camera @ calibration.solution.camera_from_tag_b
    now = base_from_tag_b.inverse() @ followed_point(calibration, base_from_wrist)
    then = taught_tag.inverse() @ followed_point(calibration, taught)
    return float(np.linalg.norm(now - then))


def doubt_mm(calibration: Calibration, point: Array) -> float:
    """How far a right place may be from what stays the same, the axis being known no better.

    Both ends of a diameter may be wrong by what the axis is, in opposite directions.
    """
    solution = calibration.solution
    axis_from_base = _axis_from_base(calibration)
    if isinstance(solution, JointSolution):
        if axis_from_base is None:
            return 0.0
        columns = solution.layout.axis_columns
        J = np.hstack([np.eye(3), -hat(axis_from_base @ point)])[:, list(solution.axis)]
        left_open = solution.undetermined[columns]
        covariance = solution.covariance[columns, columns] + left_open @ left_open.T
        spread = J @ covariance @ J.T
    elif solution.pivot is None:
        return 0.0
    else:
        spread = solution.pivot.covariance
    return 2 * SIGMAS * math.sqrt(max(float(np.linalg.eigvalsh(spread)[-1]), 0.0))


def lean_rad(
    calibration: Calibration, rotation: Array, taught_rotation: Array, policy: Policy
) -> float:
    """Angle between the tool's axis and the taught approach, the object turned as suits it best.

    rotation, taught_rotation: (3, 3) base from wrist. Where no axis is known, a wrist that follows its object
    may stand anyhow: 0; and any other is held against the approach as it was taught.
    """
    tool = calibration.facts.tool.axis_in_wrist
    now, then = rotation @ tool, taught_rotation @ tool
    axis_from_base = _axis_from_base(calibration)
    if axis_from_base is not None:
        z = axis_from_base.rotation[2]
        return abs(_angle(now, z) - _angle(then, z))
    return 0.0 if policy is Policy.FOLLOW else _angle(now, then)


def _angle(u: Array, v: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(u, v))), float(u @ v))


def _axis_from_base(calibration: Calibration) -> Pose | None:
    """A frame whose z is the axis about which the object turns; None where no picture told it."""
    solution = calibration.solution
    if not _tells_axis(solution) or calibration.facts.object.motion is Motion.FREE:
        return None
    return (solution.base_from_camera @ solution.camera_from_axis).inverse()


def _tells_axis(solution: Solution) -> bool:
    return isinstance(solution, JointSolution) and bool(solution.axis)
