"""The paper's universal method: TCP and object from touches with varied wrists, certified.

May import touches and observability.
"""

from vgrd.calibration.universal.estimate import (
    Equations,
    UniversalProblem,
    UniversalResult,
    calibrate_universal,
    retract,
)
from vgrd.calibration.universal.start import (
    linear_rotation,
    lowest_cost,
    lowest_valley,
    reduced_cost,
)

__all__ = [
    "Equations",
    "UniversalProblem",
    "UniversalResult",
    "calibrate_universal",
    "linear_rotation",
    "lowest_cost",
    "lowest_valley",
    "reduced_cost",
    "retract",
]
