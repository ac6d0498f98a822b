"""Accept or reject: what the numbers of a calibration say against it, in words with a remedy."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.checks import bad_touches
from vgrd.calibration.hand_eye import HandEyeResult
from vgrd.calibration.stepwise.touch_fit import FittedTouches
from vgrd.calibration.touches import Reference
from vgrd.calibration.turntable import RotationCenter
from vgrd.geometry.covariance import rms
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import (
    NOISY_SCALE,
    OUTLIER_SIGMA,
    PIVOT_APART_MM,
    SPIN_MM,
    SPIN_SIGMA,
    WRONG_SIGMA,
)
from vgrd.model import Finding, Motion, Plan, Recording

_FEW_SPINS = 4  # three determine the axis, one more contradicts
_FEW_DEGREES = 25.0  # rms: an arc of 87 degrees


@dataclass(frozen=True, slots=True, eq=False)
class StepwiseEvidence:
    """All that `judge` looks at."""

    recording: Recording
    taught: FittedTouches
    hand_eye: HandEyeResult
    reference: Reference
    center: RotationCenter | None
    has_pivot: bool


def judge(evidence: StepwiseEvidence) -> tuple[list[Finding], dict[str, float]]:
    """Findings and the residuals they rest on."""
    findings = [
        *bad_touches(evidence.recording),
        *_bad_points(evidence),
        *_contradicted(evidence.taught),
        *_method(evidence),
        *_hand_eye(evidence),
        *_spins(evidence),
    ]
    return findings, _residuals(evidence)


def _bad_points(evidence: StepwiseEvidence) -> list[Finding]:
    """The touch beside the object that is farthest from the fit of the others, where noise does not explain it."""
    beside = evidence.taught.beside
    if beside is None:
        return []
    worst = int(np.argmax(beside.scores))
    if beside.scores[worst] <= OUTLIER_SIGMA:
        return []
    return [
        finding(
            "point_outlier",
            f"point {worst + 1} ({evidence.recording.points[worst].target}) does not belong to the others: "
            f"{beside.misses_mm[worst]:.2f} mm, {beside.scores[worst]:.1f} sigma off",
            fatal=bool(beside.scores[worst] > WRONG_SIGMA),
        )
    ]


def _contradicted(taught: FittedTouches) -> list[Finding]:
    """Targets without CAD of which one touch does not belong to the others; none is left out of the mean."""
    return [
        finding(
            "target_contradicted",
            f"the touches of {name}, which has no point_mm, contradict each other by {score:.1f} sigma: undo "
            f"those of {name} and touch it again",
            fatal=True,
        )
        for name, score in taught.bare_scores.items()
        if score > OUTLIER_SIGMA
    ]


def _method(evidence: StepwiseEvidence) -> list[Finding]:
    plan, has_tcp = evidence.recording.plan, evidence.taught.tcp is not None
    if plan is Plan.UNIVERSAL and not has_tcp:
        return [
            finding(
                "constant_wrist",
                "the plan was universal but all touches have one wrist orientation: the TCP stays "
                "unknown",
            )
        ]
    if evidence.taught.open_axis is not None:
        x, y, z = np.round(evidence.taught.open_axis, 2) + 0.0
        return [
            finding(
                "tcp_axis_open",
                f"the wrist turned about one axis only: the TCP along ({x:.2f}, {y:.2f}, {z:.2f}) of the "
                "wrist is not determined, is taken as 0 mm, and answers at the tilt of the touches do "
                "not need it",
            )
        ]
    if plan is Plan.SPECIAL and has_tcp:
        return [
            finding(
                "varied_wrist",
                "the plan was special but the wrist was turned between the touches: solved with "
                "the universal method",
            )
        ]
    return []


def _hand_eye(evidence: StepwiseEvidence) -> list[Finding]:
    findings = [
        finding("look_outlier", f"{sample.name} was left out of the hand-eye, {sample.reason}")
        for sample in evidence.hand_eye.samples
        if not sample.used
    ]
    blind = [
        str(i + 1)
        for i, touch in enumerate(evidence.recording.touches)
        if touch.observation is None or touch.observation.tag_a is None
    ]
    if blind:
        findings.append(
            finding("tag_a_unseen", f"tag A was not in view in touch {', '.join(blind)}")
        )
    scale = evidence.hand_eye.noise_scale
    if scale > NOISY_SCALE:
        findings.append(
            finding(
                "hand_eye_noise",
                f"the looks scatter {scale:.1f} times as much as robot and camera promise",
            )
        )
    return findings


def _spins(evidence: StepwiseEvidence) -> list[Finding]:
    center = evidence.center
    findings = []
    if evidence.recording.facts.object.motion is Motion.TURNTABLE and not evidence.has_pivot:
        findings.append(
            finding(
                "no_pivot",
                "no rotation centre, expected coordinates rest on the hand-eye translation",
            )
        )
    if center is None:
        return findings
    count, degrees = len(center.residuals_mm), np.degrees(center.spread_rad)
    if count < _FEW_SPINS or degrees < _FEW_DEGREES:
        findings.append(
            finding(
                "few_spins",
                f"{count} spins over {degrees:.0f} degrees rms",
            )
        )
    worst = int(np.argmax(center.scores))
    miss_mm = float(np.linalg.norm(center.residuals_mm[worst]))
    if center.scores[worst] > SPIN_SIGMA and miss_mm > SPIN_MM:
        findings.append(
            finding(
                "spins_not_about_one_axis",
                f"spin {worst + 1} is {miss_mm:.2f} mm off the common axis, the object slipped or the "
                "camera moved",
                fatal=True,
            )
        )
    return [*findings, *_pivot_disagrees(evidence, center)]


def _pivot_disagrees(evidence: StepwiseEvidence, center: RotationCenter) -> list[Finding]:
    """Universal: hand-eye and touches must see the axis at one place."""
    pivot = evidence.taught.pivot_in_base
    if pivot is None or evidence.taught.tcp is None:
        return []
    B = evidence.hand_eye.mount_from_camera
    apart = B @ center.center_in_camera - pivot
    axis = B.rotation @ center.axis_in_camera
    apart_mm = float(np.linalg.norm(apart - axis * float(axis @ apart)))
    if apart_mm <= PIVOT_APART_MM:
        return []
    return [
        finding(
            "pivot_disagrees",
            f"camera and touches see the rotation centre {apart_mm:.1f} mm apart",
            fatal=True,
        )
    ]


def _residuals(evidence: StepwiseEvidence) -> dict[str, float]:
    inliers = [sample for sample in evidence.hand_eye.samples if sample.used]
    residuals = {
        "touch_rms_mm": rms(np.linalg.norm(evidence.taught.residuals_mm, axis=1)),
        "touch_worst_sigma": float(evidence.taught.scores.max()),
        "hand_eye_rms_mm": rms([sample.mm for sample in inliers]),
        "hand_eye_rms_deg": rms([sample.deg for sample in inliers]),
        "hand_eye_noise_scale": evidence.hand_eye.noise_scale,
        "reference_scatter_mm": evidence.reference.scatter_mm,
    }
    if evidence.center is not None:
        residuals["spin_rms_mm"] = rms(np.linalg.norm(evidence.center.residuals_mm, axis=1))
    return residuals
