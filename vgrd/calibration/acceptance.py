"""Accept or reject against the job's tolerance, with the confidence of it."""

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_probability, chi2_quantile
from vgrd.geometry.covariance import radius_of
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import BELIEVED_CAMERA
from vgrd.model import CameraPlace, Finding

_DIRECTIONS = 3.0  # of a position, where the covariance is not known
_95 = 0.95  # all radii are told at this confidence (u95)


def accept(
    predicted_u95_mm: float,
    tolerance_mm: float,
    *,
    covariance: Array | None = None,
    confidence: float = _95,
) -> Finding:
    """Whether an expected coordinate meets the tolerance, and how sure that is.

    predicted_u95_mm: radius that holds 95 % of the misses; covariance: (3, 3) mm^2 of the position
    where it is known, which gives the shape; without it all directions count alike. The squared
    miss is g chi2(v) (Satterthwaite). Raises InputError on lengths that are not positive.
    """
    if not (tolerance_mm > 0 and predicted_u95_mm >= 0 and np.isfinite(tolerance_mm)):
        raise InputError(
            f"a tolerance of {tolerance_mm} mm and an error of {predicted_u95_mm} mm cannot be "
            "compared: both are lengths above zero"
        )
    sure = confidence_of(predicted_u95_mm, tolerance_mm, covariance)
    if sure >= confidence:
        return finding(
            "meets_tolerance",
            f"meets {tolerance_mm:g} mm with {_percent(sure)} confidence (95 % of the misses are "
            f"predicted within {predicted_u95_mm:.2f} mm)",
        )
    return finding(
        "misses_tolerance",
        f"does not meet {tolerance_mm:g} mm: only with {_percent(sure)} confidence, "
        f"{100 * confidence:g} % are wanted (95 % of the misses are predicted within "
        f"{predicted_u95_mm:.2f} mm)",
        fatal=True,
    )


def confidence_of(
    predicted_u95_mm: float, tolerance_mm: float, covariance: Array | None = None
) -> float:
    """Probability that a miss is within the tolerance."""
    if predicted_u95_mm == 0:
        return 1.0
    if not np.isfinite(predicted_u95_mm):
        return 0.0
    degrees_of_freedom = _DIRECTIONS
    if covariance is not None:
        squares = float(np.einsum("ij,ji->", covariance, covariance))
        degrees_of_freedom = float(np.trace(covariance)) ** 2 / squares
    g = predicted_u95_mm**2 / chi2_quantile(_95, degrees_of_freedom)
    return chi2_probability(tolerance_mm**2 / g, degrees_of_freedom)


def served_radius(covariance: Array, camera: CameraPlace) -> float:
    """The radius (mm, rad) that an answer states for its covariance: of 95 %, of more on trust.

    A camera whose place no tag A of this picture measures stands on what the cell file says of its
    stability. Such a sigma is a guess, and nobody sees it fail.
    """
    return radius_of(covariance, BELIEVED_CAMERA if camera.is_believed else _95)


def _percent(share: float) -> str:
    """Never rounded up to certainty."""
    return "more than 99.9 %" if share > 0.999 else f"{100 * share:.3g} %"
