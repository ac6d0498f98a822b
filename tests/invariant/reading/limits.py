"""The limits that are in force, as the cell file says them, by sums of their own."""

import math
from dataclasses import dataclass

from vgrd.geometry import Array, Pose

CONE_DEG = 60.0  # docs/limits.md, where the file says nothing
ROUNDING_MM, ROUNDING_DEG = (
    0.01,
    0.2,
)  # of the registers; of how upright the wrists of the touches were


@dataclass(slots=True)
class LimitsInForce:
    """outer_radius_mm: of the cell file, until it is reloaded."""

    outer_radius_mm: float = math.inf

    def broken(self, flange: Pose, tip: Array) -> str:
        """Which limit a valid coordinate breaks, empty when none. tip: (3,) base, as the calibration has it."""
        for name, point in (("flange", flange.translation), ("tip", tip)):
            radius_mm = math.hypot(point[0], point[1])
            if radius_mm > self.outer_radius_mm + ROUNDING_MM:
                return f"{name} at a radius of {radius_mm:.3f} mm beyond {self.outer_radius_mm} mm"
        lean_deg = math.degrees(math.acos(max(-1.0, min(1.0, -float(flange.rotation[2, 2])))))
        if lean_deg > CONE_DEG + ROUNDING_DEG:
            return f"the tool leans by {lean_deg:.1f} degrees"
        return ""
