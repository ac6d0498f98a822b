"""Whether the flange pose of a proposed sample may be named: an operator may drive there as told.

A pose is named only where its place is known, the samples agree, a wrong target name would have shown,
and the arm stood close by before. Else the proposal is words, with the reason.
"""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.checks import rival_names
from vgrd.calibration.joint import JointFit, StepLayout
from vgrd.calibration.planning.reach import Candidate, Reach, Touching, flange_of
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.geometry.covariance import radius95
from vgrd.model import Recording

UNSURE_MM = (
    5.0  # a chosen bound: half of the 10 mm at which an approach slows down to jog onto a target
)
MARGIN_MM = (
    100.0  # a tip 200 mm ahead of the flange tilted by 30 degrees moves the flange by as much
)
_SLACK_RAD = 1e-6  # rounding


def reason_against(result: JointFit, candidate: Candidate, reach: Reach) -> str:
    """Why the flange pose of a candidate may not be named, in words; "" where it may."""
    flange = flange_of(result, candidate)
    if flange is None:
        return ""
    u95_mm = place_u95_mm(result, candidate)
    if not u95_mm <= UNSURE_MM:  # not a number is unsure too
        return f"its place is known to {u95_mm:.0f} mm only: jog there by eye"
    return rival_names(result.recording) or _beyond(result.recording, candidate, flange, reach)


def place_u95_mm(result: JointFit, candidate: Candidate) -> float:
    """95 % radius of where the flange has to be for a touch, mm; 0 for a look, which names a place."""
    if not isinstance(candidate, Touching):
        return 0.0
    flange = flange_of(result, candidate)
    if flange is None:
        return 0.0
    R = candidate.base_from_wrist
    point = flange.translation + R @ result.state.tcp_in_wrist
    J = np.zeros((3, result.layout.size))
    J[:, StepLayout.OBJECT] = np.hstack([np.eye(3), -hat(point)])
    J[:, StepLayout.TCP] = -R
    N = J @ result.undetermined
    return radius95(J @ result.covariance @ J.T + N @ N.T)


def _beyond(recording: Recording, candidate: Candidate, flange: Pose, reach: Reach) -> str:
    """How a flange pose lies outside what the arm reached in the session."""
    poses = [touch.base_from_wrist for touch in recording.touches]
    if not isinstance(candidate, Touching):
        poses += [look.base_from_wrist for look in recording.looks]
    if not poses:
        return "the arm has not been there before"
    places = np.array([pose.translation for pose in poses])
    outside = np.maximum(places.min(axis=0) - flange.translation, 0)
    outside = np.maximum(outside, flange.translation - places.max(axis=0))
    if not float(outside.max()) <= MARGIN_MM:
        return f"it is {outside.max():.0f} mm outside of where the arm stood: jog there by eye"
    axis = np.asarray(recording.facts.tool.axis_in_wrist)
    if not _is_turned_alike([p.rotation for p in poses], flange.rotation, axis, reach):
        return "the wrist never stood nearly so: turn it by eye"
    return ""


def _is_turned_alike(rotations: Sequence[Array], R: Array, axis: Array, reach: Reach) -> bool:
    """Whether an orientation is within the tilt and turn allowed from one that was reached."""
    widest = min(reach.max_tilt_rad + reach.max_yaw_rad, np.pi) + _SLACK_RAD
    for other in rotations:
        tilt = np.arctan2(
            np.linalg.norm(np.cross(R @ axis, other @ axis)), R @ axis @ other @ axis
        )
        turn = float(np.linalg.norm(log_rotation(other.T @ R)))
        if tilt <= reach.max_tilt_rad + _SLACK_RAD and turn <= widest:
            return True
    return False
