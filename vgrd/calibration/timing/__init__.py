"""When pictures were taken, by the clock of the poses: found from pictures of the moving arm.

May import geometry, model and judging.
"""

from vgrd.calibration.timing.offset import WIDEST_S, TimeOffset, find_time_offset

__all__ = ["WIDEST_S", "TimeOffset", "find_time_offset"]
