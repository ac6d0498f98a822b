"""Poses, rotation formats, camera model: numpy and scipy only.

Imports errors only.
"""

from vgrd.geometry.pose import Array, Pose, exp_rotation, hat, log_rotation, nearest_rotation

__all__ = ["Array", "Pose", "exp_rotation", "hat", "log_rotation", "nearest_rotation"]
