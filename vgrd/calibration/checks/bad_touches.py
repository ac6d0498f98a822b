"""Touches that do not belong to the others: robust weights and leaving them out have to agree."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.cad_fit import fit_cad
from vgrd.calibration.motion import Axes, turned_axes
from vgrd.calibration.robust import fit_without_outliers
from vgrd.calibration.teaching import arm_touches
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.geometry import Array
from vgrd.model import Finding, Recording

_MIN_TOUCHES = 5


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """off_mm: (m, 3); the rest as `robust.TouchFit` wants it."""

    off_mm: Array
    whitened: Array
    scores: Array
    freedom: int


def bad_touches(recording: Recording) -> tuple[Finding, ...]:
    """All touches that contradict the rest, at most a third of them, with how far they are off.

    By the universal method where the wrists varied, else by the rigid fit to CAD. Nothing below 5
    touches. Raises what the method raises for all touches (`vgrd.calibration.teaching.teach`).
    """
    touches = recording.touches
    if len(touches) < _MIN_TOUCHES:
        return ()
    targets = recording.facts.object.targets
    points = np.array([targets[touch.target].point_in_object for touch in touches])
    arrays = arm_touches(touches, recording)
    axes = turned_axes([touch.base_from_wrist.rotation for touch in touches])[0]
    solve = _rigid if axes is Axes.NONE else _universal
    fit = fit_without_outliers(lambda w: solve(points, arrays.weighted(w)), len(touches))
    off = np.linalg.norm(fit.result.off_mm, axis=1)
    return tuple(
        Finding(
            "touch_outlier",
            f"touch {i + 1} ({touches[i].target}) does not belong to the others: {off[i]:.2f} mm, "
            f"{fit.scores[i]:.1f} sigma off; undo it and touch that target again",
        )
        for i in np.flatnonzero(~fit.used)
    )


def _rigid(points: Array, touches: TouchSet) -> _Fitted:
    fit = fit_cad(points, touches)
    whitened = np.einsum("mij,mj->mi", touches.base_whiteners(), fit.residuals_mm)
    return _Fitted(fit.residuals_mm, whitened, fit.scores, touches.equations() - 6)


def _universal(points: Array, touches: TouchSet) -> _Fitted:
    fit = calibrate_universal(UniversalProblem(points, touches))
    return _Fitted(fit.residuals_mm, fit.whitened, fit.scores, fit.freedom)
