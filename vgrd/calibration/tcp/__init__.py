"""The TCP from touches of a fixed point, a plane or a ball.

May import touches, observability and model.
"""

from vgrd.calibration.tcp.contact import ContactTcp, contact_tcp
from vgrd.calibration.tcp.fixed_point import FixedPointResult, calibrate_fixed_point
from vgrd.calibration.tcp.plane import Plane, calibrate_plane, check_one_plane, fit_plane
from vgrd.calibration.tcp.sphere import calibrate_sphere, check_one_sphere, fit_sphere

__all__ = [
    "ContactTcp",
    "FixedPointResult",
    "Plane",
    "calibrate_fixed_point",
    "calibrate_plane",
    "calibrate_sphere",
    "check_one_plane",
    "check_one_sphere",
    "contact_tcp",
    "fit_plane",
    "fit_sphere",
]
