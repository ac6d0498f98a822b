"""Pictures in their order: what earlier ones told, so that a small slip shows and a constant error does not.

May import picture and links of the joint estimate.
"""

from vgrd.calibration.joint.sequence.series import JointSeries, Sighting

__all__ = ["JointSeries", "Sighting"]
