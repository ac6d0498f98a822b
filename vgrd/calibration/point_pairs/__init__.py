"""Hand-eye from places: a 3D camera saw one point of the tool, or one point of the base.

May import geometry and the errors.
"""

from vgrd.calibration.point_pairs.fit import (
    PointPairs,
    PointPairsFit,
    SampleMiss,
    ToolPointChange,
    fit_point_pairs,
    is_mirrored,
    leave_one_out,
    scale_of,
    tool_point_change,
)

__all__ = [
    "PointPairs",
    "PointPairsFit",
    "SampleMiss",
    "ToolPointChange",
    "fit_point_pairs",
    "is_mirrored",
    "leave_one_out",
    "scale_of",
    "tool_point_change",
]
