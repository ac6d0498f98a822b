"""What a set of poses or residuals can tell, and which of them do not belong.

Imports geometry only.
"""

from vgrd.calibration.observability.leave_one_out import (
    RobustFit,
    TouchFit,
    fit_without_outliers,
    noise_scale,
)
from vgrd.calibration.observability.motion import (
    Axes,
    check_distinct,
    check_hand_eye_motion,
    hand_eye_observability,
    missing_rotation,
    turned_axes,
)

__all__ = [
    "Axes",
    "RobustFit",
    "TouchFit",
    "check_distinct",
    "check_hand_eye_motion",
    "fit_without_outliers",
    "hand_eye_observability",
    "missing_rotation",
    "noise_scale",
    "turned_axes",
]
