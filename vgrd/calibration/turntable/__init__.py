"""The axis about which an object turns.

May import geometry and model.
"""

from vgrd.calibration.turntable.rotation_center import RotationCenter, find_rotation_center
from vgrd.calibration.turntable.usable_spins import turned_tags, without_useless_spins

__all__ = ["RotationCenter", "find_rotation_center", "turned_tags", "without_useless_spins"]
