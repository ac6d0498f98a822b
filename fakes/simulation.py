"""The paper's cell as equations: the studies' simulation, under the name that tests know."""

from vgrd.studies.simulation import (
    COARSE,
    EXACT_ARM,
    FINE,
    TAG_A,
    TAG_B,
    TOUCH_SIGMA_MM,
    WORK_ROTATION,
    ArmErrors,
    Hole,
    Request,
    Simulation,
    Vision,
)

__all__ = [
    "COARSE",
    "EXACT_ARM",
    "FINE",
    "TAG_A",
    "TAG_B",
    "TOUCH_SIGMA_MM",
    "WORK_ROTATION",
    "ArmErrors",
    "Hole",
    "Request",
    "Simulation",
    "Vision",
]
