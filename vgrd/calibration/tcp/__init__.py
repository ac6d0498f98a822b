"""The TCP from touches of a fixed point, a plane or a ball.

May import touches, observability and model.
"""

from vgrd.calibration.tcp.contact import ContactTcp, contact_tcp
from vgrd.calibration.tcp.fixed_point import FixedPointResult, calibrate_fixed_point
from vgrd.calibration.tcp.orientation import AxisPoint, ToolOrientation, tool_orientation
from vgrd.calibration.tcp.plane import Plane, calibrate_plane, check_one_plane, fit_plane
from vgrd.calibration.tcp.sphere import calibrate_sphere, check_one_sphere, fit_sphere
from vgrd.calibration.tcp.stated_surface import (
    SurfaceDifference,
    plane_difference,
    radius_difference,
)
from vgrd.calibration.tcp.surface import SurfaceResult
from vgrd.calibration.tcp.systematic import grouped_covariance
from vgrd.calibration.tcp.touch_levels import (
    TouchKind,
    TouchRows,
    by_kind,
    find_touch_levels,
    freedom_of_unknowns,
    named_levels,
    point_rows,
    surface_rows,
    touch_kinds,
    with_levels,
)

__all__ = [
    "AxisPoint",
    "ContactTcp",
    "FixedPointResult",
    "Plane",
    "SurfaceDifference",
    "SurfaceResult",
    "ToolOrientation",
    "TouchKind",
    "TouchRows",
    "by_kind",
    "calibrate_fixed_point",
    "calibrate_plane",
    "calibrate_sphere",
    "check_one_plane",
    "check_one_sphere",
    "contact_tcp",
    "find_touch_levels",
    "fit_plane",
    "fit_sphere",
    "freedom_of_unknowns",
    "grouped_covariance",
    "named_levels",
    "plane_difference",
    "point_rows",
    "radius_difference",
    "surface_rows",
    "tool_orientation",
    "touch_kinds",
    "with_levels",
]
