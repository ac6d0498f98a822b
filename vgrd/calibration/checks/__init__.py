"""Checks of a recording by its own data: what is missing, what was meant otherwise, what moved."""

from vgrd.calibration.checks.bad_touches import bad_touches
from vgrd.calibration.checks.conventions import cannot_tell
from vgrd.calibration.checks.examining import examine
from vgrd.calibration.checks.missing_motion import MissingMotion, missing_motion, missing_motions

__all__ = [
    "MissingMotion",
    "bad_touches",
    "cannot_tell",
    "examine",
    "missing_motion",
    "missing_motions",
]
