"""Hand-eye calibration as published, every method under its authors' names, without refinement.

All solve `camera_from_target_i = X^-1 M_i Y` (see `vgrd.calibration.hand_eye.pose_pairs`): with motions
A = M_i M_j^-1, B = C_i C_j^-1 it is A X = X B, with the poses A = M_i, B = C_i it is A Y = X B.
"""

from vgrd.calibration.hand_eye.published.registry import (
    METHODS,
    HandEyePoses,
    PosePair,
    PublishedMethod,
)

__all__ = ["METHODS", "HandEyePoses", "PosePair", "PublishedMethod"]
