"""Whether touches are what they say, asked while they are taken: by each other, and by the calibration in use.

May import calibration, universal, hand_eye, touches, judging and model.
"""

from vgrd.calibration.plausibility.calibrated import NONE_IN_USE, InUse, Miss, misses
from vgrd.calibration.plausibility.review import missing_tags, questions

__all__ = ["NONE_IN_USE", "InUse", "Miss", "misses", "missing_tags", "questions"]
