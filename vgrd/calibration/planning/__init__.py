"""What to record next, what it would bring, and what the error consists of.

May import joint and checks.
"""

from vgrd.calibration.planning.advice import advise_session
from vgrd.calibration.planning.budget import Budget, Source, Systematic, error_budget
from vgrd.calibration.planning.insertions import (
    CLEAN_WANTED,
    further_touches,
    predicted_insertions,
)
from vgrd.calibration.planning.next_sample import (
    Job,
    Spinning,
    Touching,
    plan_samples,
    plan_touches,
)
from vgrd.calibration.planning.predicted_error import PredictedError
from vgrd.calibration.planning.predicted_rows import picture_of
from vgrd.calibration.planning.reach import Reach
from vgrd.calibration.planning.with_cad import errors_with_cad_mm

__all__ = [
    "CLEAN_WANTED",
    "Budget",
    "Job",
    "PredictedError",
    "Reach",
    "Source",
    "Spinning",
    "Systematic",
    "Touching",
    "advise_session",
    "error_budget",
    "errors_with_cad_mm",
    "further_touches",
    "picture_of",
    "plan_samples",
    "plan_touches",
    "predicted_insertions",
]
