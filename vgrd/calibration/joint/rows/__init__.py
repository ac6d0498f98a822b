"""Rows of the joint estimate: residuals and derivatives of everything that a session tells, the arm's too.

May import what precedes the fit: problem, state and camera_corrections.
"""

from vgrd.calibration.joint.rows.arm import ArmRows, arm_jacobian, arm_rows
from vgrd.calibration.joint.rows.evidence import (
    displacement_jacobian,
    linearize,
    moved_tag,
    touched_places,
)
from vgrd.calibration.joint.rows.tags import (
    ObjectMotions,
    as_refined,
    object_motions,
    seen_tag_a,
    tag_residuals,
    turn_of,
)

__all__ = [
    "ArmRows",
    "ObjectMotions",
    "arm_jacobian",
    "arm_rows",
    "as_refined",
    "displacement_jacobian",
    "linearize",
    "moved_tag",
    "object_motions",
    "seen_tag_a",
    "tag_residuals",
    "touched_places",
    "turn_of",
]
