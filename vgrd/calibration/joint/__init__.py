"""The joint estimate: all evidence of a session in one maximum-likelihood problem.

May import touches, hand_eye, universal and turntable.
"""

from vgrd.calibration.joint.answers import Prediction
from vgrd.calibration.joint.calibration import calibrate_jointly, contradicted_targets
from vgrd.calibration.joint.camera_corrections import (
    PRINTED,
    TAG_A,
    TAG_B,
    CameraCorrections,
    PriorSigmas,
    adjoints,
)
from vgrd.calibration.joint.estimate import calibrate_joint, start_near_tag_plane
from vgrd.calibration.joint.expected import expected_by_joint, predict, tag_b_of, work_orientation
from vgrd.calibration.joint.fit import (
    JointFit,
    information_inverse,
    variance_inflation,
    whiten_arm,
)
from vgrd.calibration.joint.knocks import as_seen_in_the_end, camera_moves
from vgrd.calibration.joint.marginal import solution_of
from vgrd.calibration.joint.problem import (
    CameraPlaces,
    EvidenceKind,
    HolePixel,
    JointData,
    Looks,
    Tags,
    Turntable,
    inexact_of,
    points_of,
    target_of,
)
from vgrd.calibration.joint.robust import TouchMiss, touch_misses
from vgrd.calibration.joint.rows import (
    arm_jacobian,
    displacement_jacobian,
    linearize,
    turn_of,
)
from vgrd.calibration.joint.solution import JointSolution
from vgrd.calibration.joint.state import JointState, StepLayout, taught_place

__all__ = [
    "PRINTED",
    "TAG_A",
    "TAG_B",
    "CameraCorrections",
    "CameraPlaces",
    "EvidenceKind",
    "HolePixel",
    "JointData",
    "JointFit",
    "JointSolution",
    "JointState",
    "Looks",
    "Prediction",
    "PriorSigmas",
    "StepLayout",
    "Tags",
    "TouchMiss",
    "Turntable",
    "adjoints",
    "arm_jacobian",
    "as_seen_in_the_end",
    "calibrate_joint",
    "calibrate_jointly",
    "camera_moves",
    "contradicted_targets",
    "displacement_jacobian",
    "expected_by_joint",
    "inexact_of",
    "information_inverse",
    "linearize",
    "points_of",
    "predict",
    "solution_of",
    "start_near_tag_plane",
    "tag_b_of",
    "target_of",
    "taught_place",
    "touch_misses",
    "turn_of",
    "variance_inflation",
    "whiten_arm",
    "work_orientation",
]
