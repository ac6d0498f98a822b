"""Held-out touches, the object turned, against what would have been served."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.errors import Contradiction, InputError, NotObservable, TagNotSeen
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.findings import finding
from vgrd.model import (
    CameraPlace,
    ExpectedCoordinate,
    Finding,
    FlangeTag,
    Observation,
    Policy,
    Touch,
    place_in,
)

TURNED_RAD = np.radians(60)  # of the object: as far as operators are asked to turn it
_MARGIN = 1.5  # on what 95 % of the misses stay within: a good one fails 1 in 300 (one direction) to 1,900
_EXACT_MM = 1e-6  # nothing is known better than that: keeps an exact direction invertible
_95 = 0.95  # all radii are told at this confidence (u95)


@dataclass(frozen=True, slots=True, eq=False)
class Miss:
    """What a touch says: how far it is off along what it measured, mm, and how far chance allows.

    directions: (k, 3) in the base; off: (k,), covariance: (k, k). base_from_wrist: (3, 3) of the touch.
    fits: the links up to the flange were seen, and they are where they were taught.
    """

    name: str
    directions: Array
    off: Array
    covariance: Array
    base_from_wrist: Array
    fits: bool

    @property
    def mm(self) -> float:
        """Length of it."""
        return float(np.linalg.norm(self.off))

    @property
    def share(self) -> float:
        """Of what is allowed; beyond 1 chance does not explain it."""
        return _share_of_allowed(self.off, self.covariance)


def verify(
    calibration: Calibration, verifications: Sequence[Touch], stability: Array | None = None
) -> tuple[list[Finding], dict[str, float]]:
    """Findings, and the largest miss (`verification_max_mm`) along what the touches measured.

    A touch counts as precisely as it says, across and along the tool; a direction that it did not
    measure (an infinite sigma) does not count. stability: (6,) of the camera, as in `CameraPlace`: tag A
    in the picture of a touch then tells where the camera stands; None: it stands where it was taught.
    """
    findings, misses = [], []
    for judged in judge(calibration, verifications, stability):
        if isinstance(judged, Finding):
            findings.append(judged)
            continue
        misses.append(judged)
        if not judged.share <= 1:
            words = (
                f"{judged.name} misses by {judged.mm:.2f} mm, "
                f"{judged.share:.1f} times as much as chance allows"
            )
            findings.append(finding("verification_failed", words, fatal=True))
    findings += _tool(misses)
    return findings, {"verification_max_mm": max(miss.mm for miss in misses)} if misses else {}


def judge(
    calibration: Calibration, verifications: Sequence[Touch], stability: Array | None = None
) -> list[Finding | Miss]:
    """By verification how far it is off, or why that cannot be told; stability: as in `verify`."""
    return [
        _judged(calibration, touch, f"verification {i + 1}", stability)
        for i, touch in enumerate(verifications)
    ]


def turned_apart(taught: Sequence[Touch], verifications: Sequence[Touch]) -> list[int]:
    """Which verifications (indices) were made with the object turned from all touches and each other.

    Hand-eye and axis errors cancel in a touch at the taught turn. Turns are compared by tag B as a camera
    that stands still sees it; a touch without it does not count.
    """
    return apart([object_turn(one) for one in taught], [object_turn(one) for one in verifications])


def object_turn(touch: Touch) -> Array | None:
    """(3, 3) of tag B in the camera, None where it was not seen."""
    tag_b = None if touch.observation is None else touch.observation.tag_b
    return None if tag_b is None else np.asarray(tag_b.camera_from_tag.rotation)


def apart(taught: Sequence[Array | None], turns: Sequence[Array | None]) -> list[int]:
    """Which turns (indices) differ from all that were taught and from each other; None: not seen."""
    known, counted = [R for R in taught if R is not None], []
    for i, R in enumerate(turns):
        if R is None:
            continue
        if all(np.linalg.norm(log_rotation(R @ turn.T)) >= TURNED_RAD for turn in known):
            counted.append(i)
            known.append(R)
    return counted


def _judged(
    calibration: Calibration, touch: Touch, name: str, stability: Array | None
) -> Finding | Miss:
    """How far a touch is off, or why that cannot be told."""
    picture = touch.observation
    if picture is None or picture.tag_b is None:
        return finding("verification_unseen", f"{name}: tag B was not in view")
    directions, sigmas_mm = _measured(calibration, touch)
    if not len(directions):
        words = (
            f"{name} ({touch.target}): both sigmas of the touch are infinite, it measured nothing"
        )
        return finding("verification_unusable", words)
    place, R = _place(picture, calibration, stability), touch.base_from_wrist.rotation
    try:
        expected = expected_coordinate(
            calibration, touch.target, picture.tag_b, Policy.FIXED, R, place
        )
    except (InputError, NotObservable, TagNotSeen) as fault:
        return finding("verification_unusable", f"{name}: {fault}")
    except Contradiction as fault:
        return finding("verification_failed", f"{name}: {fault}", fatal=True)
    return Miss(
        f"{name} ({touch.target})",
        directions,
        directions @ _off(calibration, touch, expected),
        directions @ expected.position_covariance @ directions.T + np.diag(sigmas_mm**2),
        R,
        expected.fits and place.flange_tag is not None,
    )


def _place(picture: Observation, calibration: Calibration, stability: Array | None) -> CameraPlace:
    """Where the camera stood in the picture of a touch; stability None: as the session says."""
    if stability is None:
        return place_in(picture, calibration.facts.camera_stability)
    return CameraPlace(stability, FlangeTag.of(picture))


def _tool(misses: Sequence[Miss]) -> list[Finding]:
    """The tool, where touches miss although camera, tags and object are where they were."""
    seen = [miss for miss in misses if miss.fits]
    failed = [miss for miss in seen if not miss.share <= 1]
    if not failed:
        return []
    words = (
        f"tool: {', '.join(miss.name for miss in failed)} missed, although both tags are where they were "
        "taught"
    )
    shift = _shift_of_tip(seen)
    if shift is not None:
        place = ", ".join(f"{number:.2f}" for number in shift)
        words += f"; a tip that moved by ({place}) mm in the flange's frame explains every touch"
    return [finding("tool_suspected", words)]


def _shift_of_tip(misses: Sequence[Miss]) -> Array | None:
    """The one shift (3,) of the tip, mm in the flange, that explains several touches; None without."""
    if len(misses) < 2:
        return None
    rows = [-miss.directions @ miss.base_from_wrist for miss in misses]
    weights = [
        np.linalg.inv(np.linalg.cholesky(miss.covariance + _EXACT_MM**2 * np.eye(len(miss.off))))
        for miss in misses
    ]
    J = np.vstack([W @ row for W, row in zip(weights, rows, strict=True)])
    r = np.concatenate([W @ miss.off for W, miss in zip(weights, misses, strict=True)])
    shift = np.linalg.lstsq(J, r)[0]
    left = [miss.off - row @ shift for miss, row in zip(misses, rows, strict=True)]
    explained = all(
        _share_of_allowed(off, miss.covariance) <= 1
        for off, miss in zip(left, misses, strict=True)
    )
    return shift if explained else None


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
