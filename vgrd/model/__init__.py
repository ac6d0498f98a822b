"""Frozen values that pass between the layers: the cell, a recorded session, a calibration.

Imports geometry only. Units: mm, rad, s; poses are named `target_from_source`.
"""

from vgrd.model.arrays import frozen_array
from vgrd.model.calibration import (
    Calibration,
    ExpectedCoordinate,
    Finding,
    Policy,
    TaughtPoint,
    Verdict,
)
from vgrd.model.cell import CellFacts, Motion, Mount, ObjectSpec, TagSpec, Target, Tool
from vgrd.model.estimate import ArmKnowledge, ArmModel, JointEstimate
from vgrd.model.session import Observation, Plan, Recording, TagObservation, Touch

__all__ = [
    "ArmKnowledge",
    "ArmModel",
    "Calibration",
    "CellFacts",
    "ExpectedCoordinate",
    "Finding",
    "JointEstimate",
    "Motion",
    "Mount",
    "ObjectSpec",
    "Observation",
    "Plan",
    "Policy",
    "Recording",
    "TagObservation",
    "TagSpec",
    "Target",
    "TaughtPoint",
    "Tool",
    "Touch",
    "Verdict",
    "frozen_array",
]
