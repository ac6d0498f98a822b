"""Touches of a recording that contradict CAD, and the mistake in CAD or its names that explains them."""

import numpy as np

from vgrd.calibration.checks.misreading import ConstantWrist, VariedWrists, misreading
from vgrd.calibration.motion import Axes, turned_axes
from vgrd.calibration.teaching import arm_touches
from vgrd.model import Finding, Recording

_CONTRADICTORY = 3.0
_MIN_TOUCHES = 4


def misread_points(recording: Recording) -> Finding | None:
    """Mirrored CAD points, two targets swapped, or their order wrong; None where nothing shows it.

    Four touches are the least, five where the wrists vary; touches about one axis tell nothing.
    """
    touches = recording.touches
    targets = recording.facts.object.targets
    axes = turned_axes([t.base_from_wrist.rotation for t in touches] or [np.eye(3)])[0]
    if len(touches) < _MIN_TOUCHES + (axes is Axes.MANY) or axes is Axes.ONE:
        return None
    points = np.array([targets[touch.target].point_in_object for touch in touches])
    arrays = arm_touches(touches, recording)
    wrists = ConstantWrist(arrays) if axes is Axes.NONE else VariedWrists(arrays)
    scale = wrists.scatter(points)
    if not _CONTRADICTORY < scale < np.inf:
        return None
    names = [f"{i + 1} ({touch.target})" for i, touch in enumerate(touches)]
    return misreading(names, points, wrists, scale)
