"""What is answered from the joint estimate: the flange pose and its uncertainty.

May import state and rows of the joint estimate.
"""

from vgrd.calibration.joint.answers.flange import Flange, Wish, flange_of
from vgrd.calibration.joint.answers.prediction import Prediction

__all__ = ["Flange", "Prediction", "Wish", "flange_of"]
