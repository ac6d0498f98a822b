"""What one picture of a calibrated cell cannot tell, and the words for it.

May import joint.
"""

from vgrd.calibration.blind_spots.courses import Course, Slips
from vgrd.calibration.blind_spots.slips import BlindSpot, blind_spots
from vgrd.calibration.blind_spots.words import sentences

__all__ = ["BlindSpot", "Course", "Slips", "blind_spots", "sentences"]
