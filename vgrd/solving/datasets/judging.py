"""Verdict on a solved dataset: what does not fit, how sure that is, and what to do about it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.hand_eye import (
    HandEyeResult,
    SampleResidual,
    null_space_findings,
)
from vgrd.calibration.levels import Level
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import INTRINSICS
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CONTRADICTORY_DEG, CONTRADICTORY_MM, WEAK_DEG, WEAK_MM
from vgrd.model import Finding, Verdict
from vgrd.solving.datasets.fitting import TargetScale
from vgrd.solving.datasets.loading import Dataset
from vgrd.solving.datasets.quality import Quality, figure
from vgrd.solving.datasets.suspects import suspects, unit_mismatch

_DOUBTFUL = 4.0  # times the median miss
_DOUBTFUL_MM = 0.2  # smaller misses are nobody's concern
_DOUBTFUL_DEG = 0.02  # the same
_HALF_TURN_DEG = 170.0  # no slip but a symmetric target turns a pose so far
_SCATTER = (
    3.0  # times the level assumed, which is right within a factor of 2 in two of three cases
)
_SCATTER_SIGMAS = 3.0  # of the level found: by chance 1 in 1,000
_OTHER_SIZE = 5e-3  # of a target's size: no arm and no lens that was calibrated is so far off
_DIGITS = (1, 1, 1, 1, 4, 4)  # px, and coefficients


@dataclass(frozen=True, slots=True, eq=False)
class Miss:
    """How far a fit without a sample misses it; pixels (n, 2) as a sum of squares over `count`.

    shift_mm, turn_rad: (3,) in the camera, whose lengths are mm and deg.
    """

    shift_mm: Array
    turn_rad: Array
    squares_px: float
    count: int

    @property
    def mm(self) -> float:
        """How far the target's place is missed."""
        return float(np.linalg.norm(self.shift_mm))

    @property
    def deg(self) -> float:
        """By how much its orientation is missed."""
        return float(np.degrees(np.linalg.norm(self.turn_rad)))


@dataclass(frozen=True, slots=True, eq=False)
class DatasetEvidence:
    """All that the verdict looks at; misses: None where the others did not determine a fit.

    unseen, few_points: reasons by sample.
    """

    dataset: Dataset
    names: Sequence[str]
    camera_from_target: Sequence[Pose]
    result: HandEyeResult
    misses: Sequence[Miss | None]
    unseen: dict[str, str]
    few_points: dict[str, str]
    scale: TargetScale
    quality: Quality
    tolerance_mm: float | None = None


def judge(evidence: DatasetEvidence) -> Verdict:
    """All findings, worst first; camera and target are not judged by contradictory samples."""
    general = _contradiction(evidence) or [
        *null_space_findings(evidence.dataset.mount, evidence.result.null_space),
        *_weakness(evidence),
        *_camera(evidence),
        *_size(evidence),
        *_scatter(evidence),
    ]
    findings = [
        *general,
        *_tolerance(evidence),
        *(finding("target_not_seen", f"sample {n}: {r}") for n, r in evidence.unseen.items()),
        *(
            finding("sample_rejected", f"sample {sample.name}: left out, {_why(sample)}")
            for sample in evidence.result.samples
            if not sample.used
        ),
        *(finding("few_points", f"sample {n}: {r}") for n, r in evidence.few_points.items()),
        *(finding("sample_doubtful", f"sample {n}: {r}") for n, r in doubtful(evidence).items()),
    ]
    if any(miss is None for miss in evidence.misses):
        findings.append(
            finding(
                "no_leave_one_out",
                "without one of the samples the rest does not determine a fit, the errors are "
                "unknown",
            )
        )
    return Verdict(tuple(sorted(findings, key=lambda one: not one.fatal)))


def _tolerance(evidence: DatasetEvidence) -> list[Finding]:
    """Fatal where further looks are not known to be predicted to within the tolerance."""
    quality, tolerance = evidence.quality, evidence.tolerance_mm
    if tolerance is None or quality.mm <= tolerance:
        return []
    told = f"{figure(quality.mm)} mm" if np.isfinite(quality.mm) else "an unknown error"
    message = (
        f"predicted to within {told} at 95 %, the tolerance is {tolerance:g} mm; most of it comes from "
        f"{quality.limits}, what helps is {quality.advice}"
    )
    return [finding("tolerance_exceeded", message, fatal=True)]


def _why(sample: SampleResidual) -> str:
    """The reason as told, and what half a turn means."""
    if sample.deg < _HALF_TURN_DEG:
        return sample.reason
    return (
        f"{sample.reason}: the target was taken half a turn round; where it looks the same after half a "
        "turn, turn its pose there, or give pictures or points instead of poses"
    )


def doubtful(evidence: DatasetEvidence) -> dict[str, str]:
    """Samples in the fit that the fit of the others misses by far more than the rest, with the figures."""
    used = {sample.name for sample in evidence.result.samples if sample.used}
    misses = {n: m for n, m in zip(evidence.names, evidence.misses, strict=True) if m is not None}
    if not misses:
        return {}
    mm = float(np.median([miss.mm for miss in misses.values()]))
    deg = float(np.median([miss.deg for miss in misses.values()]))
    return {
        name: f"{miss.mm:.1f} mm and {miss.deg:.2f} deg off the fit of the others (typical "
        f"{mm:.1f} mm, {deg:.2f} deg)"
        for name, miss in misses.items()
        if name in used
        and (miss.mm > _DOUBTFUL * mm + _DOUBTFUL_MM or miss.deg > _DOUBTFUL * deg + _DOUBTFUL_DEG)
    }


def _contradiction(evidence: DatasetEvidence) -> list[Finding]:
    """Fatal: the samples belong to no common hand-eye pose."""
    misses = [miss for miss in evidence.misses if miss is not None]
    if not misses:
        return []
    mm = float(np.median([miss.mm for miss in misses]))
    deg = float(np.median([miss.deg for miss in misses]))
    lost = sum(not sample.used for sample in evidence.result.samples)
    hints = unit_mismatch(evidence.dataset, evidence.names, evidence.camera_from_target)
    if (
        not hints
        and mm < CONTRADICTORY_MM
        and deg < CONTRADICTORY_DEG
        and 2 * lost < len(evidence.names)
    ):
        return []
    hints = hints or suspects(evidence.dataset, evidence.names, evidence.camera_from_target)
    advice = " ".join(hints) or (
        "Check rotation format, unit, mount, and that poses and pictures belong together."
    )
    message = (
        f"the samples contradict each other: typically {mm:.1f} mm and {deg:.2f} deg off, {lost} "
        f"of {len(evidence.names)} left out. {advice}"
    )
    return [finding("contradictory", message, fatal=True)]


def _weakness(evidence: DatasetEvidence) -> list[Finding]:
    sigmas = np.sqrt(np.diag(evidence.result.covariance)[:6])
    mm, deg = float(sigmas[:3].max()), float(np.degrees(sigmas[3:].max()))
    if mm < WEAK_MM and deg < WEAK_DEG:
        return []
    message = (
        f"the camera's pose is uncertain by {mm:.0f} mm and {deg:.1f} deg (1 sigma): record more "
        "samples, turn the wrist by 20 degrees and more about different axes"
    )
    return [finding("weak_motion", message, fatal=True)]


def _camera(evidence: DatasetEvidence) -> list[Finding]:
    dataset, found = evidence.dataset, evidence.result.camera
    if dataset.refine or dataset.camera is None or found is None or not evidence.result.refined:
        return []
    moves = ", ".join(
        f"{name} {given:.{digits}f} -> {refined:.{digits}f}"
        for name, given, refined, digits in zip(
            INTRINSICS, dataset.camera.intrinsics(), found.intrinsics(), _DIGITS, strict=True
        )
    )
    message = (
        "camera: the intrinsics as given do not fit robot and pictures, beyond doubt, so they were "
        f"refined: {moves}. Use the transforms with these; for those given, as_given holds others"
    )
    return [finding("intrinsics_doubtful", message)]


def _scatter(evidence: DatasetEvidence) -> list[Finding]:
    """Levels far above what was assumed; a target of another size is one itself and told alone."""
    if evidence.scale.excess != 0:
        return []
    return [
        finding(
            "samples_scatter",
            f"the {level.name}: {level.ratio:.1f} times the scatter assumed, {_level(level.found, level)} "
            f"instead of {_level(level.stated, level)}",
        )
        for level in evidence.result.levels
        if np.log(level.ratio) > max(np.log(_SCATTER), _SCATTER_SIGMAS * level.log_sigma)
    ]


def _level(value: float, level: Level) -> str:
    return (
        f"{figure(float(np.degrees(value)))} deg"
        if level.unit == "rad"
        else f"{figure(value)} {level.unit}"
    )


def _size(evidence: DatasetEvidence) -> list[Finding]:
    """The target is not the size given: all depths are off by that share, and no miss shows it."""
    deviation, quality, tolerance = evidence.scale.excess, evidence.quality, evidence.tolerance_mm
    if deviation == 0:
        return []
    is_fatal = abs(deviation) > _OTHER_SIZE or (
        tolerance is not None and quality.size_mm > tolerance
    )
    message = (
        f"target: by the robot's motion the target is {100 * deviation:+.2f} +- "
        f"{100 * evidence.scale.sigma:.2f} % off the size given, which is {figure(quality.size_mm)} mm at "
        f"{figure(quality.distance_mm)} mm"
    )
    return [finding("target_size", message, fatal=is_fatal)]
