"""One CAD point that stands elsewhere than its touches say."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from vgrd.calibration.universal import UniversalResult
from vgrd.errors import CalibrationError
from vgrd.geometry import Array
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CHANCE
from vgrd.model import Finding
from vgrd.solving.touch_files.document import TouchFile
from vgrd.solving.touch_files.fitting import plain_fit, rows_of

_LEAST_FREEDOM = 3  # left beside a free target: below it some target fits by chance
_DEPENDENT = 1e-6  # of a target's own columns: less of it is left where the fit takes it up


def find_wrong_target(file: TouchFile) -> Finding | None:
    """The target that explains all misfit beyond chance when it stands elsewhere; None without one.

    A target needs two touches or more, and has to explain more than any single bad touch.
    """
    try:
        fit = plain_fit(file)
    except CalibrationError:
        return None
    if not isinstance(fit, UniversalResult) or fit.degrees_of_freedom < 3 + _LEAST_FREEDOM:
        return None
    rows = rows_of(file, fit)
    U = np.linalg.svd(rows.jacobian, full_matrices=False)[0]

    def freed(touches: NDArray[np.bool_]) -> tuple[float, Array]:
        columns = rows.shift * touches[rows.touch_of][:, None]
        left = columns - U @ (U.T @ columns)
        step = -np.linalg.pinv(left, rcond=_DEPENDENT) @ rows.residuals
        return float(np.sum((left @ step) ** 2)), step

    targets, target_of = np.unique(file.points_in_object, axis=0, return_inverse=True)
    count = np.bincount(target_of.ravel())
    repeated = np.flatnonzero(count > 1)
    if not len(repeated) or len(targets) == len(repeated) == 1:
        return None
    gains = [freed(target_of.ravel() == k) for k in repeated]
    singles = [freed(np.arange(len(file.names)) == i)[0] for i in range(len(file.names))]
    best = int(np.argmax([gain for gain, _ in gains]))
    gain, step = gains[best]
    freedom = fit.degrees_of_freedom - 3
    left_over = max(float(rows.residuals @ rows.residuals) - gain, np.finfo(float).tiny)
    chance = len(repeated) * float(fisher.sf(gain / 3 / (left_over / freedom), 3, freedom))
    if chance >= CHANCE or gain <= max(singles):
        return None
    target = targets[repeated[best]]
    found = target + fit.object_from_base.rotation @ step
    return finding(
        "target_off",
        f"target ({_words(target)}) stands {np.linalg.norm(step):.2f} mm elsewhere by its {count[repeated[best]]} "
        f"touches, at ({_words(found)})",
        fatal=True,
    )


def _words(point: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in point)
