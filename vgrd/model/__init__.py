"""Frozen values that pass between the layers: the cell, a recorded session, a calibration.

Imports geometry only. Units: mm, rad, s; poses are named `target_from_source`.
"""

from vgrd.model.arm import ArmKnowledge, ArmModel
from vgrd.model.arrays import frozen_array, frozen_copy
from vgrd.model.calibration import (
    ExpectedCoordinate,
    Finding,
    PlacedPoint,
    Policy,
    TaughtPoint,
    TcpEstimate,
    Verdict,
)
from vgrd.model.cell import (
    CellFacts,
    Motion,
    Mount,
    ObjectSpec,
    Stability,
    TagSpec,
    Target,
    Tool,
)
from vgrd.model.limits import Bounds, CellBounds
from vgrd.model.links import (
    UNMOVED,
    AdoptedSlip,
    CameraPlace,
    FlangeTag,
    Instant,
    Link,
    LinkReport,
    PictureSeries,
    SlipEstimate,
    place_in,
)
from vgrd.model.session import (
    MovingSight,
    Observation,
    Plan,
    Recording,
    TagObservation,
    Touch,
)

__all__ = [
    "UNMOVED",
    "AdoptedSlip",
    "ArmKnowledge",
    "ArmModel",
    "Bounds",
    "CameraPlace",
    "CellBounds",
    "CellFacts",
    "ExpectedCoordinate",
    "Finding",
    "FlangeTag",
    "Instant",
    "Link",
    "LinkReport",
    "Motion",
    "Mount",
    "MovingSight",
    "ObjectSpec",
    "Observation",
    "PictureSeries",
    "PlacedPoint",
    "Plan",
    "Policy",
    "Recording",
    "SlipEstimate",
    "Stability",
    "TagObservation",
    "TagSpec",
    "Target",
    "TaughtPoint",
    "TcpEstimate",
    "Tool",
    "Touch",
    "Verdict",
    "frozen_array",
    "frozen_copy",
    "place_in",
]
