"""A touch whose wrist stands as in no other one: the tool leans elsewhere, or turned where it must not."""

from collections.abc import Sequence

import numpy as np

from vgrd.geometry import Array, log_rotation
from vgrd.judging.thresholds import NO_ROTATION_RAD
from vgrd.model import Plan, Recording

_LEAN_RAD = float(
    np.radians(50)
)  # advice asks for 30 degrees from the usual, so two may be 60 apart
_TURN_RAD = (
    2 * NO_ROTATION_RAD
)  # of a wrist that is to stay: at half of it, rms, it counts as turned
_ONE_WRIST = frozenset({Plan.SPECIAL, Plan.CONVENTIONAL, Plan.PLANE, Plan.SPHERE})


def wrong_wrist(
    recording: Recording, wrist: Array, others: Sequence[Array], in_use: Sequence[Array]
) -> str:
    """What is odd about the wrist (3, 3) of a touch, in words; "" where nothing is.

    others: of the other touches, (3, 3); in_use: as the targets of the calibration in use are worked on.
    """
    if recording.plan in _ONE_WRIST and others:
        turn = min(float(np.linalg.norm(log_rotation(wrist @ other.T))) for other in others)
        if turn > _TURN_RAD:
            return (
                f"plan {recording.plan.value} wants one wrist for all targets, and here it is turned by "
                f"{np.degrees(turn):.1f} degrees"
            )
    known = [*others, *in_use]
    if not known:
        return ""
    lean = _least_lean(wrist, known, np.asarray(recording.facts.tool.axis_in_wrist))
    if lean > _LEAN_RAD:
        return f"the tool leans {np.degrees(lean):.0f} degrees away from every other touch"
    return ""


def _least_lean(R: Array, others: Sequence[Array], axis_in_wrist: Array) -> float:
    """Least angle, rad, between the tool's axis at an orientation (3, 3) and at others."""
    axis = R @ axis_in_wrist
    angles = [
        np.arctan2(
            np.linalg.norm(np.cross(axis, other @ axis_in_wrist)), axis @ (other @ axis_in_wrist)
        )
        for other in others
    ]
    return float(min(angles))
