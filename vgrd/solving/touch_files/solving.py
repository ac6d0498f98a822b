"""A file of touches in, the TCP with every touch's fate and a verdict out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.calibration.checks import VariedWrists, misinterpretation
from vgrd.calibration.observability import (
    RobustFit,
    TouchFit,
    fit_without_outliers,
    noise_scale,
)
from vgrd.calibration.tcp import (
    FixedPointResult,
    calibrate_fixed_point,
    check_one_plane,
    check_one_sphere,
    fit_plane,
    fit_sphere,
)
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import (
    UniversalProblem,
    UniversalResult,
    calibrate_universal,
)
from vgrd.geometry import Array, Pose
from vgrd.geometry.chi2 import chi2_probability
from vgrd.geometry.covariance import radius95
from vgrd.geometry.rotation_relaxation import Certificate
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CHANCE, NOISY_SCALE, TOUCHES_CONTRADICT_MM, WEAK_TCP_MM
from vgrd.model import Finding, Verdict
from vgrd.solving.touch_files.document import TouchFile, TouchKind, load_touches
from vgrd.solving.touch_files.repeatability import Repeats, find_repeats, with_repeated_sigma

_CLOSED_FORM = Certificate(0.0, tight=True)


@dataclass(frozen=True, slots=True)
class TouchReport:
    """One touch; residual_mm: how far it is off the fit in the directions that it measured."""

    name: str
    used: bool
    reason: str
    residual_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class TouchSolution:
    """tcp_in_wrist: (3,) mm; covariance: (3, 3) of it, mm^2; object_from_base: universal only.

    certificate: None where a method has none (unknown plane, ball). repeats: None where no target
    was touched twice.
    """

    tcp_in_wrist: Array
    covariance: Array
    object_from_base: Pose | None
    touches: tuple[TouchReport, ...]
    certificate: Certificate | None
    verdict: Verdict
    repeats: Repeats | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain values for `--json`: mm, poses 4x4 by rows."""
        X, proof = self.object_from_base, self.certificate
        return {
            "tcp_in_wrist": self.tcp_in_wrist.tolist(),
            "covariance": self.covariance.tolist(),
            **({"object_from_base": X.matrix().tolist()} if X is not None else {}),
            "touches": [
                {
                    "name": touch.name,
                    "used": touch.used,
                    "reason": touch.reason,
                    "residual_mm": touch.residual_mm,
                }
                for touch in self.touches
            ],
            "certificate": {
                "gap": proof.gap if proof else None,
                "tight": proof is not None and proof.tight,
            },
            "verdict": {
                "ok": self.verdict.ok,
                "findings": [
                    {"code": finding.code, "message": finding.message}
                    for finding in self.verdict.findings
                ],
            },
            **({"repeatability_mm": self.repeats.to_json()} if self.repeats else {}),
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """What the kinds have in common; misses_mm: (m,)."""

    fit: RobustFit[Any]
    tcp_in_wrist: Array
    covariance: Array
    misses_mm: Array
    object_from_base: Pose | None = None
    certificate: Certificate | None = _CLOSED_FORM


def solve_touches(path: Path) -> TouchSolution:
    """TCP from a file of touches; bad touches are left out and named.

    Raises ConfigError (all faults of the file), TooFewObservations, NotObservable (names the
    missing motion) or DidNotConverge.
    """
    file = load_touches(path)
    estimate = _SOLVERS[file.kind](file)
    repeats = find_repeats(file, estimate.tcp_in_wrist, estimate.fit.used)
    weighted_file = with_repeated_sigma(file, repeats) if repeats else None
    if repeats and weighted_file:
        file, repeats = weighted_file, replace(repeats, applied=True)
        estimate = _SOLVERS[file.kind](file)
    scale = noise_scale(estimate.fit.result)
    noisy = _is_noisy(estimate.fit.result)
    covariance = estimate.covariance * (scale**2 if noisy else 1.0)
    findings = [
        *_contradiction(file, estimate, noisy=noisy),
        *_unproven(estimate),
        *_weakness(covariance, file.touches),
        *_outliers(file, estimate),
    ]
    return TouchSolution(
        tcp_in_wrist=estimate.tcp_in_wrist,
        covariance=covariance,
        object_from_base=estimate.object_from_base,
        touches=tuple(_reports(file, estimate)),
        certificate=estimate.certificate,
        verdict=Verdict(tuple(findings)),
        repeats=repeats,
    )


def _universal(file: TouchFile) -> _Estimate:
    def solve(weights: Array) -> UniversalResult:
        weighted = file.touches.weighted(weights)
        return calibrate_universal(UniversalProblem(file.points_in_object, weighted))

    fit = fit_without_outliers(solve, len(file.names))
    best = fit.result
    X = best.object_from_base
    return _Estimate(
        fit,
        best.tcp_in_wrist,
        best.covariance[6:, 6:],
        _measured_mm(file.touches, best.residuals_mm @ X.rotation),
        X,
        best.certificate,
    )


def _fixed_point(file: TouchFile) -> _Estimate:
    def solve(weights: Array) -> FixedPointResult:
        return calibrate_fixed_point(file.touches.weighted(weights))

    fit = fit_without_outliers(solve, len(file.names))
    best = fit.result
    misses_mm = _measured_mm(file.touches, best.residuals_mm)
    return _Estimate(fit, best.tcp_in_wrist, best.covariance[:3, :3], misses_mm)


def _plane(file: TouchFile) -> _Estimate:
    fit = fit_without_outliers(
        lambda weights: fit_plane(file.touches.weighted(weights), file.plane),
        len(file.names),
    )
    best = fit.result
    check_one_plane(best)
    proof = _CLOSED_FORM if file.plane else None
    misses_mm = np.abs(best.residuals_mm)
    return _Estimate(fit, best.tcp_in_wrist, best.covariance, misses_mm, certificate=proof)


def _sphere(file: TouchFile) -> _Estimate:
    fit = fit_without_outliers(
        lambda weights: fit_sphere(file.touches.weighted(weights), file.radius_mm),
        len(file.names),
    )
    best = fit.result
    check_one_sphere(best)
    misses_mm = np.abs(best.residuals_mm)
    return _Estimate(fit, best.tcp_in_wrist, best.covariance, misses_mm, certificate=None)


_SOLVERS = {
    TouchKind.UNIVERSAL: _universal,
    TouchKind.FIXED_POINT: _fixed_point,
    TouchKind.PLANE: _plane,
    TouchKind.SPHERE: _sphere,
}


def _measured_mm(touches: TouchSet, errors_in_base: Array) -> Array:
    """Length (m,) of errors (m, 3), directions that were not measured left out."""
    errors = np.einsum("mij,mj->mi", touches.measured().base_sqrt_informations(), errors_in_base)
    return np.asarray(np.linalg.norm(errors, axis=1))


def _is_noisy(fit: TouchFit) -> bool:
    """Whether chance explains the scatter in less than one of a thousand good files."""
    if fit.degrees_of_freedom < 1:
        return False
    squares = float(np.sum(fit.whitened**2))
    return 1 - chi2_probability(squares, fit.degrees_of_freedom) < CHANCE


def _contradiction(file: TouchFile, estimate: _Estimate, *, noisy: bool) -> list[Finding]:
    outlier_count = int(np.sum(~estimate.fit.used))
    scale = noise_scale(estimate.fit.result)
    if file.kind is TouchKind.UNIVERSAL and (noisy or outlier_count):
        points = file.points_in_object
        everything = calibrate_universal(UniversalProblem(points, file.touches))
        wrists = VariedWrists(file.touches)
        mistake = misinterpretation(file.names, points, wrists, noise_scale(everything))
        if mistake is not None:
            return [mistake]
    if not noisy:
        return []
    rms = float(np.sqrt(np.mean(estimate.misses_mm[estimate.fit.used] ** 2)))
    if scale > NOISY_SCALE and rms > TOUCHES_CONTRADICT_MM:
        message = f"the touches contradict each other, {rms:.1f} mm rms"
        return [finding("touches_contradict", message, fatal=True)]
    message = (
        f"the touches scatter {scale:.1f} times as much as their sigma promises ({rms:.2f} mm "
        "rms), the covariance is enlarged accordingly"
    )
    return [finding("touches_scatter", message)]


def _unproven(estimate: _Estimate) -> list[Finding]:
    proof = estimate.certificate
    if proof is None or proof.tight:
        return []
    message = f"another solution may fit better (gap {proof.gap:.1e})"
    return [finding("not_proven", message, fatal=True)]


def _weakness(covariance: Array, touches: TouchSet) -> list[Finding]:
    radius = radius95(covariance)
    if radius < WEAK_TCP_MM:
        return []
    x, y, z = np.linalg.eigh(covariance)[1][:, -1]
    message = (
        f"the TCP is known to {radius:.0f} mm only (95 %), least along ({x:.2f}, {y:.2f}, {z:.2f}) "
        f"of the flange: add to the {len(touches)} touches some with the wrist tilted further, "
        "to several sides"
    )
    return [finding("weak_motion", message, fatal=True)]


def _outliers(file: TouchFile, estimate: _Estimate) -> list[Finding]:
    return [
        finding("touch_outlier", f"touch {report.name}: {report.reason}")
        for report in _reports(file, estimate)
        if not report.used
    ]


def _reports(file: TouchFile, estimate: _Estimate) -> Sequence[TouchReport]:
    return [
        TouchReport(
            name,
            bool(used),
            "" if used else f"left out, {miss_mm:.2f} mm and {score:.1f} sigma off the others",
            float(miss_mm),
        )
        for name, used, miss_mm, score in zip(
            file.names, estimate.fit.used, estimate.misses_mm, estimate.fit.scores, strict=True
        )
    ]
