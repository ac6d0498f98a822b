"""Touches that do not belong to the others: robust weights and leaving them out have to agree.

The paper's methods fit all touches, so one that is far off refuses their calibration.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.observability import Axes, fit_without_outliers, turned_axes
from vgrd.calibration.touches import TouchSet, arm_touches, cad_touches, fit_cad
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.geometry import Array
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import OUTLIER_SIGMA, WRONG_SIGMA
from vgrd.model import Finding, Recording


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """residuals_mm: (m, 3); the rest as `robust.TouchFit` wants it."""

    residuals_mm: Array
    whitened: Array
    scores: Array
    degrees_of_freedom: int


def bad_touches(recording: Recording) -> tuple[Finding, ...]:
    """All touches of targets in CAD that contradict the rest, at most a third of them, with how far they are off.

    By the universal method where the wrists varied, else by the rigid fit to CAD. Where it cannot be
    told which ones are bad, the worst of all. Fatal beyond 6 sigma. Raises what the method raises
    for all touches (`vgrd.calibration.stepwise.touch_fit.teach`).
    """
    indices, points = cad_touches(recording)
    if not len(indices):
        return ()
    touches = [recording.touches[i] for i in indices]
    arrays = arm_touches(touches, recording)
    axes = turned_axes([touch.base_from_wrist.rotation for touch in touches])[0]
    solve = _rigid if axes is Axes.NONE else _universal
    fit = fit_without_outliers(lambda w: solve(points, arrays.weighted(w)), len(touches))
    misses_mm = np.linalg.norm(fit.result.residuals_mm, axis=1)
    bad = np.flatnonzero(~fit.used)
    worst = int(np.argmax(fit.scores))
    if not bad.size and fit.scores[worst] > OUTLIER_SIGMA:
        bad = np.array([worst])
    return tuple(
        finding(
            "touch_outlier",
            f"touch {indices[i] + 1} ({touches[i].target}) does not belong to the others: "
            f"{misses_mm[i]:.2f} mm, {fit.scores[i]:.1f} sigma off",
            fatal=bool(fit.scores[i] > WRONG_SIGMA),
        )
        for i in bad
    )


def _rigid(points: Array, touches: TouchSet) -> _Fitted:
    fit = fit_cad(points, touches)
    whitened = np.einsum("mij,mj->mi", touches.base_sqrt_informations(), fit.residuals_mm)
    return _Fitted(fit.residuals_mm, whitened, fit.scores, touches.equations() - 6)


def _universal(points: Array, touches: TouchSet) -> _Fitted:
    fit = calibrate_universal(UniversalProblem(points, touches))
    return _Fitted(fit.residuals_mm, fit.whitened, fit.scores, fit.degrees_of_freedom)
