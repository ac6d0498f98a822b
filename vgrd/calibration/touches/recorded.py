"""The touches of a recording, as equations and by their orientation."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.touches.equations import TouchSet, touch_set
from vgrd.calibration.touches.reference import turned_touches
from vgrd.errors import InputError
from vgrd.geometry import Array, log_rotation
from vgrd.model import Recording, Touch


def arm_touches(touches: Sequence[Touch], recording: Recording) -> TouchSet:
    """Touches as equations, the arm's own error added to their sigmas."""
    arm = recording.facts.flange_sigma_mm
    return touch_set(
        [touch.base_from_wrist for touch in touches],
        recording.facts.tool.axis_in_wrist,
        [float(np.hypot(touch.lateral_sigma_mm, arm)) for touch in touches],
        [float(np.hypot(touch.axial_sigma_mm, arm)) for touch in touches],
    )


def cad_touches(recording: Recording) -> tuple[NDArray[np.intp], Array]:
    """Which touches are of targets in CAD, the object not turned, (k,) indices, and these points (k, 3).

    Raises InputError for a target that the object does not have.
    """
    targets = recording.facts.object.targets
    unknown = sorted({touch.target for touch in recording.touches} - set(targets))
    if unknown:
        names = ", ".join(sorted(targets))
        raise InputError(f"the object has no target {unknown[0]!r} as touched; there are: {names}")
    points = [targets[touch.target].point_in_object for touch in recording.touches]
    turned = turned_touches(recording)
    known = [(i, p) for i, p in enumerate(points) if p is not None and i not in turned]
    indices = np.array([i for i, _ in known], dtype=np.intp)
    return indices, np.array([point for _, point in known]).reshape(-1, 3)


def touched_orientation(touches: Sequence[Touch], target: str | None = None) -> Array:
    """Wrist (3, 3) as that target was touched, else as any was: the most usual orientation of all."""
    wrists = np.array([touch.base_from_wrist.rotation for touch in touches])
    indices = [i for i, touch in enumerate(touches) if touch.target == target]

    def unusual(i: int) -> float:
        return float(np.median(np.linalg.norm(log_rotation(wrists @ wrists[i].T), axis=1)))

    return np.asarray(wrists[min(indices or range(len(wrists)), key=unusual)])
