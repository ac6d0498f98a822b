"""First values of the joint estimate's unknowns, from closed forms.

May import problem and state of the joint estimate, and the methods.
"""

from vgrd.calibration.joint.start.guess import guess
from vgrd.calibration.joint.start.touches import linear_start

__all__ = ["guess", "linear_start"]
