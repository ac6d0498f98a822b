"""Checks of a recording by its own data: what is missing, what was meant otherwise, what moved.

May import the methods, touches, judging and model.
"""

from vgrd.calibration.checks.cad_mistakes import VariedWrists, misinterpretation
from vgrd.calibration.checks.conventions import cannot_tell, mistaken_unit
from vgrd.calibration.checks.examining import examine, mistakes
from vgrd.calibration.checks.interpretations import DISTINCT_FORMATS, Interpretation, best_of
from vgrd.calibration.checks.misinterpreted_points import rival_names
from vgrd.calibration.checks.motion_gaps import MissingMotion, missing_motion, missing_motions
from vgrd.calibration.checks.moved_reference import Jump, find_jump
from vgrd.calibration.checks.plans import check_plan
from vgrd.calibration.checks.pose_agreement import Agreement, Poses, agreement
from vgrd.calibration.checks.touch_outliers import bad_touches

__all__ = [
    "DISTINCT_FORMATS",
    "Agreement",
    "Interpretation",
    "Jump",
    "MissingMotion",
    "Poses",
    "VariedWrists",
    "agreement",
    "bad_touches",
    "best_of",
    "cannot_tell",
    "check_plan",
    "examine",
    "find_jump",
    "misinterpretation",
    "missing_motion",
    "missing_motions",
    "mistaken_unit",
    "mistakes",
    "rival_names",
]
