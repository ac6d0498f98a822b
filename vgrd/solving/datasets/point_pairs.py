"""A dataset whose samples hold a point in the camera: solved, judged, told."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgrd.calibration.hand_eye import flange_motion_of
from vgrd.calibration.point_pairs import (
    PointPairs,
    PointPairsFit,
    SampleMiss,
    fit_point_pairs,
    is_mirrored,
    leave_one_out,
    scale_of,
    tool_point_change,
)
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CHANCE, CONTRADICTORY_MM, WEAK_DEG, WEAK_MM
from vgrd.model import Finding, Mount, Verdict
from vgrd.solving.datasets.loading import Dataset
from vgrd.solving.datasets.reading.sample_reading import PointInCamera
from vgrd.solving.datasets.solution import refusal

_SCALE_SIGMAS = 3.0  # the scale is told, not refused
_SCALE_MATTERS = 1e-3  # 0.5 mm over a cell of 500 mm
_OTHER_UNIT = 100.0  # between lengths: mm and m are 1000 apart, no camera is off by 100
_KEPT = 2 / 3  # of the samples: where fewer belong together, nobody knows which
_NEAR_WORST = 0.5  # of the largest miss: left out with it
_TOOL_POINT_MM = 0.5  # a shift of the tool's point below it is nobody's concern


@dataclass(frozen=True, slots=True, eq=False)
class PointPairSolution:
    """The camera's pose from places of one point, with what it may be believed for.

    u95_mm: of a point amid the samples by the calibration alone; look_u95_mm: with the noise of one more look.
    left_out: why samples are not in the fit, by name; misses of these are by the fit of the others, None where
    nothing was seen.
    """

    mount: Mount
    names: tuple[str, ...]
    fit: PointPairsFit
    point_is_known: bool
    misses: tuple[SampleMiss | None, ...]
    scale: tuple[float, float]
    u95_mm: float
    look_u95_mm: float
    tolerance_mm: float | None
    verdict: Verdict
    left_out: Mapping[str, str]

    @property
    def ok(self) -> bool | None:
        """Good enough? None where nothing is wrong but no tolerance says what good is."""
        return None if self.verdict.ok and self.tolerance_mm is None else self.verdict.ok

    @property
    def sentence(self) -> str:
        """Whether it is good, in words; what forbids its use comes first."""
        return refusal(self.verdict) or (
            f"at 95 % a point amid the samples is placed to within {_text(self.look_u95_mm)} mm, from "
            f"{len(self.names) - len(self.left_out)} samples; noise of one look and one robot pose "
            f"included, the calibration alone {_text(self.u95_mm)} mm; a sample that was left out is missed by "
            f"{_text(self._mean_mm())} mm on average"
        )

    def transforms(self) -> Mapping[str, Pose]:
        """The camera's pose by its full name."""
        on_arm = self.mount is Mount.EYE_IN_HAND
        return {"wrist_from_camera" if on_arm else "base_from_camera": self.fit.X}

    def to_json(self) -> dict[str, Any]:
        """Plain values for `--json`; unknown numbers are null; lengths mm."""
        point = "point_in_base" if self.mount is Mount.EYE_IN_HAND else "tcp_in_wrist"
        return {
            **{name: pose.matrix().tolist() for name, pose in self.transforms().items()},
            "covariance": _finite_or_none(self.fit.covariance),
            point: {"value": self.fit.tool_point.tolist(), "estimated": not self.point_is_known},
            "level_mm": _known(self.fit.level_mm),
            "u95_mm": _known(self.u95_mm),
            "look_u95_mm": _known(self.look_u95_mm),
            "tolerance_mm": self.tolerance_mm,
            "leave_one_out": {"deg": None, "mm": _known(self._mean_mm()), "px": None},
            "scale": {"value": self.scale[0], "sigma": self.scale[1]},
            "samples": [
                {
                    "name": name,
                    "used": name not in self.left_out,
                    "reason": reason,
                    "px": None,
                    "deg": None,
                    "mm": None if miss is None else miss.mm,
                }
                for name, miss, reason in zip(
                    self.names, self.misses, self._reasons(), strict=True
                )
            ],
            "verdict": {
                "ok": self.ok,
                "findings": [
                    {"code": found.code, "message": found.message}
                    for found in self.verdict.findings
                ],
            },
        }

    def summary_rows(self) -> list[tuple[str, str]]:
        """Rows (what, value with unit) for a table on a terminal."""
        sigmas = np.sqrt(np.diag(self.fit.covariance))
        rows: list[tuple[str, str]] = []
        for name, pose in self.transforms().items():
            x, y, z = pose.translation
            rx, ry, rz = (math.degrees(angle) for angle in pose.rotvec())
            rows.append(
                (name, f"{x:.2f} {y:.2f} {z:.2f} mm, rotvec {rx:.3f} {ry:.3f} {rz:.3f} deg")
            )
        degrees = np.degrees(sigmas[3:])
        rows += [
            ("1 sigma", f"{_triple(sigmas[:3])} mm at the frame's origin, {_triple(degrees)} deg"),
            (
                "noise found",
                f"{_text(self.fit.level_mm)} mm a coordinate, robot and camera together",
            ),
            ("camera scale", f"{self.scale[0]:.5f} +- {self.scale[1]:.5f}"),
        ]
        rows.append(("point", self._point_words()))
        rows.append(("verdict", self._verdict_words()))
        return rows + [(found.code, found.message) for found in self.verdict.findings]

    def _point_words(self) -> str:
        """Where the point seen is, and who says so."""
        if not self.point_is_known:
            return f"{_triple(self.fit.tool_point)} mm, estimated"
        if not self.fit.tool_point.any():
            return "the flange's centre, as is assumed; tcp_in_wrist tells another"
        return f"{_triple(self.fit.tool_point)} mm in the wrist, as given"

    def _verdict_words(self) -> str:
        if not self.verdict.ok:
            return "not to be used"
        if self.tolerance_mm is None:
            return f"no tolerance given, {_text(self.look_u95_mm)} mm at 95 % (--tolerance-mm)"
        return f"ok, within {self.tolerance_mm:g} mm"

    def _mean_mm(self) -> float:
        seen = [
            miss
            for name, miss in zip(self.names, self.misses, strict=True)
            if name not in self.left_out
        ]
        known = [miss.mm for miss in self.misses if miss is not None]
        return math.nan if any(miss is None for miss in seen) else float(np.mean(known))

    def _reasons(self) -> Iterator[str]:
        for name, miss in zip(self.names, self.misses, strict=True):
            is_odd = miss is not None and miss.chance < CHANCE
            odd = f"{miss.mm:.2f} mm off the fit of the others" if is_odd and miss else ""
            yield self.left_out.get(name, odd)


def solve_point_pairs(
    dataset: Dataset, method: str | None = None, tolerance_mm: float | None = None
) -> PointPairSolution:
    """Solve and judge; raises as `fit_point_pairs`, and InputError where a published method is asked for.

    tolerance_mm: what a further look may miss by at 95 %.
    """
    if method is not None:
        raise InputError(
            f"{dataset.path}: method '{method}' is of poses; points have one: leave it out"
        )
    seen, unseen = _pairs(dataset)
    pairs, strays = _belonging_together(seen)
    fit = fit_point_pairs(pairs)
    misses = dict(zip(pairs.names, leave_one_out(pairs), strict=True))
    scale = scale_of(pairs, fit)
    middle = pairs.points.mean(0)
    look_mm = fit.u95_mm(middle, of_a_look=True)
    findings = list(_findings(pairs, fit, tuple(misses.values()), scale))
    if tolerance_mm is not None and not look_mm <= tolerance_mm:
        told = f"{_text(look_mm)} mm at 95 %, the tolerance is {tolerance_mm:g} mm"
        findings.append(finding("tolerance_exceeded", f"a look is placed to {told}", fatal=True))
    rejected = {n: f"{miss.mm:.1f} mm off the fit of the others" for n, miss in strays.items()}
    findings += [finding("target_not_seen", f"sample {n}: {why}") for n, why in unseen.items()]
    findings += [
        finding("sample_rejected", f"sample {n}: left out, {why}") for n, why in rejected.items()
    ]
    names = tuple(sample.name for sample in dataset.samples)
    return PointPairSolution(
        mount=dataset.mount,
        names=names,
        fit=fit,
        point_is_known=pairs.tool_point is not None,
        misses=tuple((misses | strays).get(name) for name in names),
        scale=scale,
        u95_mm=fit.u95_mm(middle),
        look_u95_mm=look_mm,
        tolerance_mm=tolerance_mm,
        verdict=Verdict(tuple(findings)),
        left_out=unseen | rejected,
    )


def _belonging_together(pairs: PointPairs) -> tuple[PointPairs, dict[str, SampleMiss]]:
    """The pairs without those that the others contradict, and by how much; all where these are too many."""
    kept, strays = pairs, dict[str, SampleMiss]()
    while True:
        misses = zip(kept.names, leave_one_out(kept), strict=True)
        odd = {n: miss for n, miss in misses if miss is not None and miss.chance < CHANCE}
        if not odd:
            return kept, strays
        largest = max(miss.mm for miss in odd.values())
        strays |= {n: miss for n, miss in odd.items() if miss.mm >= _NEAR_WORST * largest}
        if len(pairs.names) - len(strays) < _KEPT * len(pairs.names):
            return pairs, {}
        kept = pairs.chosen([i for i, n in enumerate(pairs.names) if n not in strays])


def _pairs(dataset: Dataset) -> tuple[PointPairs, dict[str, str]]:
    """The pairs, and why samples show no point."""
    points = [(s, s.source) for s in dataset.samples if isinstance(s.source, PointInCamera)]
    seen = [(sample, point) for sample, point in points if point.place.any()]
    unseen = {
        sample.name: "point_in_camera is 0 0 0, the camera itself: 3D cameras write it where they see nothing"
        for sample, point in points
        if not point.place.any()
    }
    is_known = dataset.mount is Mount.EYE_TO_HAND and dataset.tcp_in_wrist is not None
    pairs = PointPairs(
        [sample.name for sample, _ in seen],
        [flange_motion_of(dataset.mount, sample.base_from_wrist) for sample, _ in seen],
        np.array([point.place for _, point in seen]).reshape(-1, 3),
        dataset.tcp_in_wrist if is_known else None,
    )
    return pairs, unseen


def _findings(
    pairs: PointPairs,
    fit: PointPairsFit,
    misses: tuple[SampleMiss | None, ...],
    scale: tuple[float, float],
) -> Iterator[Finding]:
    typical = float(np.median(np.linalg.norm(fit.residuals, axis=1)))
    contradiction = _contradiction(pairs, fit, typical, scale)
    if contradiction is not None:
        yield finding("contradictory", contradiction, fatal=True)
        return
    sigmas = np.sqrt(np.diag(fit.covariance))
    mm, deg = float(sigmas[:3].max()), float(np.degrees(sigmas[3:].max()))
    if not (mm < WEAK_MM and deg < WEAK_DEG):
        yield finding(
            "weak_motion",
            f"the camera's pose is uncertain by {mm:.0f} mm and {deg:.1f} deg (1 sigma): add points, far "
            "from each other and in three directions",
            fatal=True,
        )
    yield from _size(scale)
    yield from _tool_point(pairs, fit)
    for name, miss in zip(pairs.names, misses, strict=True):
        if miss is not None and miss.chance < CHANCE:
            yield finding(
                "sample_doubtful", f"sample {name}: {miss.mm:.2f} mm off the fit of the others"
            )
    if any(miss is None for miss in misses):
        yield finding(
            "no_leave_one_out",
            "without one of the samples the rest does not determine a fit, the errors are unknown",
        )


def _contradiction(
    pairs: PointPairs, fit: PointPairsFit, typical: float, scale: tuple[float, float]
) -> str | None:
    """Why the pairs are no pairs, in words; None where they are."""
    head = f"the points contradict each other: typically {typical:.1f} mm off"
    if not 1 / _OTHER_UNIT < scale[0] < _OTHER_UNIT:
        return (
            f"{head}: lengths of the camera are {scale[0]:.4g} times those of the robot: one side is in m, "
            "the other in mm; correct unit in [poses] or [camera_poses]"
        )
    if typical < CONTRADICTORY_MM and not is_mirrored(pairs, fit):
        return None
    if is_mirrored(pairs, fit):
        return (
            f"{head}: they fit with one axis of the camera turned round: its frame is left-handed; "
            "write all points with that axis negated"
        )
    change = None if pairs.tool_point is None else tool_point_change(pairs, fit)
    if change is not None and change.chance < CHANCE and change.typical_mm < CONTRADICTORY_MM:
        return (
            f"{head}: they agree to {change.typical_mm:.1f} mm where the point seen is at "
            f"{_triple(change.place)} mm in the wrist, not at {_triple(fit.tool_point)}: correct tcp_in_wrist, or "
            'write tcp_in_wrist = "unknown"; a TCP that is active in the robot shifts it too'
        )
    return f"{head}: check that points and poses belong together, in one order, and tcp_in_wrist"


def _size(scale: tuple[float, float]) -> Iterator[Finding]:
    deviation, sigma = scale[0] - 1, scale[1]
    if abs(deviation) > max(_SCALE_SIGMAS * sigma, _SCALE_MATTERS):
        yield finding(
            "camera_scale",
            f"lengths of the camera are {100 * deviation:+.2f} +- {100 * sigma:.2f} % off those of the robot",
        )


def _tool_point(pairs: PointPairs, fit: PointPairsFit) -> Iterator[Finding]:
    """The point of the tool is elsewhere than given, where wrists that turned say it."""
    change = None if pairs.tool_point is None else tool_point_change(pairs, fit)
    if change is None or pairs.tool_point is None:
        return
    shift_mm = float(np.linalg.norm(change.place - pairs.tool_point))
    if change.chance < CHANCE and shift_mm > _TOOL_POINT_MM:
        yield finding(
            "tool_point",
            f"the samples say that the point seen is at {_triple(change.place)} mm in the wrist, not at "
            f"{_triple(pairs.tool_point)}",
        )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _finite_or_none(matrix: np.ndarray[Any, Any]) -> list[list[float]] | None:
    return matrix.tolist() if np.isfinite(matrix).all() else None


def _text(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "unknown"


def _triple(values: np.ndarray[Any, Any]) -> str:
    return " ".join(f"{value:.3f}" for value in values)
