"""The figures behind a result: who contributes how much error, where it grows, how each touch fits."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from vgrd.calibration.joint import JointFit, touch_misses
from vgrd.calibration.planning import Budget, Job, PredictedError, error_budget, picture_of
from vgrd.errors import CalibrationError
from vgrd.model import Policy
from vgrd.solving.sample_numbers import SampleNumbers

ANGLES_DEG = tuple(range(0, 360, 15))  # of the map; errors go with one and two periods a turn


def budget_of(fit: JointFit, policy: Policy) -> Budget | None:
    """Of the picture in which the targets were touched; only what the session's own samples leave."""
    try:
        return error_budget(fit, picture_of(fit, 0.0), policy)
    except CalibrationError:
        return None  # what cannot be predicted is in the verdict


def figures(
    fit: JointFit, policy: Policy, budget: Budget, numbers: SampleNumbers
) -> dict[str, object]:
    """Error budget, map of the predicted error over the object's angles, residuals; JSON-able."""
    return {
        "budget": budget.to_json(),
        "map": error_map(fit, policy, budget.targets),
        "touches": [
            {**asdict(touch), "name": numbers.told(touch.name)} for touch in touch_misses(fit)
        ],
    }


def error_map(fit: JointFit, policy: Policy, targets: Sequence[str]) -> dict[str, object]:
    """95 % error of every target, mm, by turn of the object since it was touched, degrees."""
    job = Job(policy, angles_rad=tuple(np.radians(ANGLES_DEG)), targets=targets)
    predicted = PredictedError(fit, job)
    errors = predicted.angle_errors_mm(predicted.covariance, job)
    return {
        "angles_deg": list(ANGLES_DEG),
        "u95_mm": {name: errors[:, i].tolist() for i, name in enumerate(targets)},
    }
