"""What is said about the touches of a file and their TCP, in findings."""

from collections.abc import Iterator, Sequence

import numpy as np

from vgrd.calibration.levels import Level
from vgrd.geometry import Array
from vgrd.geometry.covariance import radius95
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import WEAK_TCP_MM
from vgrd.model import Finding
from vgrd.solving.touch_files.contradictions import find_contradiction
from vgrd.solving.touch_files.document import TouchFile
from vgrd.solving.touch_files.fitting import Estimate, Levelled
from vgrd.solving.touch_files.solution import TouchReport

_CLEARLY_OFF = 3.5  # sigmas of a level's own spread: with 3 sigmas 3 % of clean files were told
_NO_TOOL_MM = 5.0  # from the flange's origin: no tip is so near, a TCP taught badly is that wrong
_SHORT_TOOL_MM = (
    40.0  # so are few tips, and badly taught TCPs are off by 8 mm and more: worth a remark
)
_TOLD = 5  # touches that are left out, each in a line of its own: more tell nobody anything
_FAR_OFF = 1.5  # times what was stated: a stated sigma is right within it in two of three cases


def judge(file: TouchFile, levelled: Levelled, tolerance_mm: float | None) -> Iterator[Finding]:
    """Every finding, what refuses the TCP first."""
    estimate = levelled.estimate
    noisy = any(level.ratio > 1 and is_far_off(level) for level in levelled.levels)
    contradiction = find_contradiction(file, levelled, noisy=noisy)
    if contradiction:
        yield contradiction
        return
    yield from _level_findings(file, levelled.levels)
    if levelled.alike:
        yield finding(
            "touches_alike",
            f"the touches scatter {levelled.rms_mm:.2g} mm rms, and those of like orientation are off "
            "alike, which more touches do not average out: at 95 % the tip is known to within "
            f"{radius95(estimate.covariance):.2g} mm",
        )
    yield from _unproven(estimate)
    yield from _no_tool(estimate)
    yield from _weakness(estimate.covariance, len(file.names))
    yield from _tolerance(estimate.covariance, tolerance_mm)
    yield from _outliers(file, estimate)


def reports(file: TouchFile, estimate: Estimate) -> Sequence[TouchReport]:
    """Every touch's fate."""
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


def is_far_off(level: Level) -> bool:
    """Whether the touches tell another level than was stated, beyond chance and beyond its prior."""
    ratio = abs(float(np.log(level.ratio)))
    return ratio > max(float(np.log(_FAR_OFF)), _CLEARLY_OFF * level.log_sigma)


def _level_findings(file: TouchFile, levels: Sequence[Level]) -> Iterator[Finding]:
    told = [level for level in levels if is_far_off(level)]
    if not any(file.sigma_given):  # a default that was too careful is no news
        told = [level for level in told if level.ratio > 1]
    if told:
        source = "the file says" if any(file.sigma_given) else "a file without sigma_mm means"
        found = " and ".join(
            f"{level.found:.2g} mm {level.name.removeprefix('touches ')} ({source} {level.stated:.2g})"
            for level in told
        )
        yield finding("touches_scatter", f"you touch to {found}")


def _unproven(estimate: Estimate) -> Iterator[Finding]:
    proof = estimate.certificate
    if proof is not None and not proof.tight:
        message = f"another solution may fit better (gap {proof.gap:.1e})"
        yield finding("not_proven", message, fatal=True)


def _no_tool(estimate: Estimate) -> Iterator[Finding]:
    distance = float(np.linalg.norm(estimate.tcp_in_wrist))
    if distance >= _SHORT_TOOL_MM or radius95(estimate.covariance) >= WEAK_TCP_MM:
        return
    where = f"the TCP is {distance:.1f} mm from the flange's origin"
    if distance < _NO_TOOL_MM:
        message = f"{where}: were these poses of an active TCP"
        yield finding("tcp_at_flange", message, fatal=True)
    else:
        message = (
            f"{where}: is the tool so short, or were these poses of an active TCP taught wrong"
        )
        yield finding("tool_short", message)


def _weakness(covariance: Array, count: int) -> Iterator[Finding]:
    radius = radius95(covariance)
    if radius < WEAK_TCP_MM:
        return
    x, y, z = np.linalg.eigh(covariance)[1][:, -1]
    message = (
        f"the TCP is known to {radius:.0f} mm only (95 %), least along ({x:.2f}, {y:.2f}, {z:.2f}) "
        f"of the flange: add to the {count} touches some with the wrist tilted further, "
        "to several sides"
    )
    yield finding("weak_motion", message, fatal=True)


def _tolerance(covariance: Array, tolerance_mm: float | None) -> Iterator[Finding]:
    radius = radius95(covariance)
    if tolerance_mm is not None and radius > tolerance_mm:
        yield finding(
            "tcp_beyond_tolerance",
            f"at 95 % the tip is known to within {radius:.2f} mm, the tolerance is {tolerance_mm:g} mm",
            fatal=True,
        )


def _outliers(file: TouchFile, estimate: Estimate) -> Iterator[Finding]:
    left_out = [report for report in reports(file, estimate) if not report.used]
    for report in left_out[:_TOLD]:
        yield finding("touch_outlier", f"touch {report.name}: {report.reason}")
    if len(left_out) > _TOLD:
        yield finding(
            "touch_outlier",
            f"{len(left_out) - _TOLD} more of {len(file.names)} touches were left out",
        )
