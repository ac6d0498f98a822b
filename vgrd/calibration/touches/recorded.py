"""The touches of a recording, as equations and by their orientation."""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.touches.equations import TouchSet, touch_set
from vgrd.geometry import Array, log_rotation
from vgrd.model import Recording, Touch


def arm_touches(touches: Sequence[Touch], recording: Recording) -> TouchSet:
    """Touches as equations, the arm's own error added to their sigmas."""
    arm = recording.facts.robot_sigma_mm
    return touch_set(
        [touch.base_from_wrist for touch in touches],
        recording.facts.tool.axis_in_wrist,
        [float(np.hypot(touch.lateral_sigma_mm, arm)) for touch in touches],
        [float(np.hypot(touch.axial_sigma_mm, arm)) for touch in touches],
    )


def touched_orientation(touches: Sequence[Touch], target: str | None = None) -> Array:
    """Wrist (3, 3) as that target was touched, else as any was: the most usual orientation of all."""
    wrists = np.array([touch.base_from_wrist.rotation for touch in touches])
    indices = [i for i, touch in enumerate(touches) if touch.target == target]

    def unusual(i: int) -> float:
        return float(np.median(np.linalg.norm(log_rotation(wrists @ wrists[i].T), axis=1)))

    return np.asarray(wrists[min(indices or range(len(wrists)), key=unusual)])
