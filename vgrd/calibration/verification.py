"""Held-out touches, the object turned, against what would have been served."""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.errors import Contradiction, InputError, NotObservable, TagNotSeen
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.findings import finding
from vgrd.model import ExpectedCoordinate, Finding, Policy, Touch, place_in

_MARGIN = 1.5  # on what 95 % of the misses stay within: a good one fails 1 in 300 (one direction) to 1,900
_EXACT_MM = 1e-6  # nothing is known better than that: keeps an exact direction invertible
_95 = 0.95  # all radii are told at this confidence (u95)


def verify(
    calibration: Calibration, verifications: Sequence[Touch]
) -> tuple[list[Finding], dict[str, float]]:
    """Findings, and the largest miss (`verification_max_mm`) along what the touches measured.

    A touch counts as precisely as it says, across and along the tool; a direction that it did not
    measure (an infinite sigma) does not count.
    """
    findings, misses = [], []
    for i, touch in enumerate(verifications):
        doubt, miss_mm = _judged(calibration, touch, f"verification {i + 1}")
        findings += [doubt] if doubt is not None else []
        misses += [miss_mm] if miss_mm is not None else []
    return findings, {"verification_max_mm": max(misses)} if misses else {}


def _judged(
    calibration: Calibration, touch: Touch, name: str
) -> tuple[Finding | None, float | None]:
    """What speaks against the calibration, and the miss in mm where it can be told."""
    picture = touch.observation
    if picture is None or picture.tag_b is None:
        return finding("verification_unseen", f"{name}: tag B was not in view"), None
    directions, sigmas_mm = _measured(calibration, touch)
    if not len(directions):
        words = (
            f"{name} ({touch.target}): both sigmas of the touch are infinite, it measured nothing"
        )
        return finding("verification_unusable", words), None
    try:
        expected = expected_coordinate(
            calibration,
            touch.target,
            picture.tag_b,
            Policy.FIXED,
            touch.base_from_wrist.rotation,
            place_in(picture, calibration.facts.camera_stability),
        )
    except (InputError, NotObservable, TagNotSeen) as fault:
        return finding("verification_unusable", f"{name}: {fault}"), None
    except Contradiction as fault:
        return finding("verification_failed", f"{name}: {fault}", fatal=True), None
    miss_vector = directions @ _off(calibration, touch, expected)
    miss = float(np.linalg.norm(miss_vector))
    covariance = directions @ expected.position_covariance @ directions.T
    share = _share_of_allowed(miss_vector, covariance + np.diag(sigmas_mm**2))
    if share <= 1:
        return None, miss
    words = f"{name} ({touch.target}) misses by {miss:.2f} mm, {share:.1f} times as much as chance allows"
    return finding("verification_failed", words, fatal=True), miss


def _off(calibration: Calibration, touch: Touch, expected: ExpectedCoordinate) -> Array:
    """Flange as touched minus as served (3,): touches use the touch tip, answers the work tip."""
    tips = touch.base_from_wrist.rotation @ calibration.facts.tool.work_from_touch_mm
    served = expected.base_from_wrist.translation
    return np.asarray(touch.base_from_wrist.translation - served - tips)


def _measured(calibration: Calibration, touch: Touch) -> tuple[Array, Array]:
    """Directions (k, 3) in the base that the touch measured, unit vectors, and its sigmas (k,)."""
    axis = touch.base_from_wrist.rotation @ calibration.facts.tool.axis_in_wrist
    frame = np.linalg.svd(axis[None])[2]
    sigmas = np.array([touch.axial_sigma_mm, touch.lateral_sigma_mm, touch.lateral_sigma_mm])
    measured = ~np.isposinf(sigmas)
    return frame[measured], sigmas[measured]


def _share_of_allowed(miss_vector: Array, covariance: Array) -> float:
    """Sigmas over those that chance explains; infinite where the numbers are none."""
    covariance = covariance + _EXACT_MM**2 * np.eye(len(miss_vector))
    squared = float(miss_vector @ np.linalg.solve(covariance, miss_vector))
    limit = _MARGIN * np.sqrt(chi2_quantile(_95, len(miss_vector)))
    share = float(np.sqrt(squared) / limit) if squared >= 0 else np.inf
    return share if share < np.inf else np.inf  # a share that is no number is none that passes
