"""The paper's plans, step by step: touches, rotation centre, verdict.

May import every method and checks.
"""

from vgrd.calibration.stepwise.calibration import calibrate_in_steps
from vgrd.calibration.stepwise.chain import CameraChain, Pivot
from vgrd.calibration.stepwise.equations import (
    flange_for,
    motion_about,
    moved_flange,
    point_in_base_live,
    special_expected,
)
from vgrd.calibration.stepwise.solution import SpecialSolution, UniversalSolution, is_open

__all__ = [
    "CameraChain",
    "Pivot",
    "SpecialSolution",
    "UniversalSolution",
    "calibrate_in_steps",
    "flange_for",
    "is_open",
    "motion_about",
    "moved_flange",
    "point_in_base_live",
    "special_expected",
]
