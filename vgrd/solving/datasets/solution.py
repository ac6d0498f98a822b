"""What solving a dataset gives: transforms, honest errors, every sample's fate, a verdict."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vgrd.calibration.levels import Level
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import Mount, Verdict
from vgrd.solving.datasets.fitting import TargetScale
from vgrd.solving.datasets.quality import Quality, figure


def refusal(verdict: Verdict) -> str:
    """Why it is not to be used, in words; "" where nothing forbids it."""
    reasons = [found.message for found in verdict.findings if found.fatal]
    return f"not to be used: {reasons[0]}" if reasons else ""


@dataclass(frozen=True, slots=True)
class SampleReport:
    """One sample; px, deg, mm: how far a fit without it missed it, NaN where that is unknown."""

    name: str
    used: bool
    reason: str
    px: float = math.nan
    deg: float = math.nan
    mm: float = math.nan


@dataclass(frozen=True, slots=True)
class LeaveOneOut:
    """Means over all samples in which the target was seen (px: rms); NaN where unknown."""

    deg: float
    mm: float
    px: float


@dataclass(frozen=True, slots=True, eq=False)
class AsGiven:
    """Poses for the intrinsics as given, where others are handed back; leave_one_out is through them."""

    mount_from_camera: Pose
    mount_from_target: Pose
    leave_one_out: LeaveOneOut


@dataclass(frozen=True, slots=True, eq=False)
class DatasetSolution:
    """The calibration that a dataset gives.

    mount_from_camera: base_from_camera (eye-to-hand) or wrist_from_camera (eye-in-hand);
    mount_from_target: wrist_from_target or base_from_target; camera: as given or refined; method: the
    named one that was asked for, None for the default; undetermined: what the motion leaves open, in
    words (both transforms are then given with the target at 0 mm along it); features: places (3,) on
    the target, mm, as estimated; covariance: (12, 12) of the left tangents of both transforms, mm and
    rad, the spread of the levels included; levels: of noise, as found; quality: what a further look is
    predicted to within; tolerance_mm: what it may be; as_given: what belongs to the intrinsics as given,
    where the samples demanded others.
    """

    mount: Mount
    mount_from_camera: Pose
    mount_from_target: Pose
    leave_one_out: LeaveOneOut
    samples: tuple[SampleReport, ...]
    target_scale: TargetScale
    camera: CameraModel | None
    refined: bool
    verdict: Verdict
    method: str | None = None
    undetermined: tuple[str, ...] = ()
    features: Mapping[str, Array] = field(default_factory=dict)
    covariance: Array = field(default_factory=lambda: np.full((12, 12), np.nan))
    levels: tuple[Level, ...] = ()
    quality: Quality | None = None
    tolerance_mm: float | None = None
    as_given: AsGiven | None = None

    @property
    def sentence(self) -> str:
        """Whether it is good, in words; what forbids its use comes first."""
        refused = refusal(self.verdict)
        told = "" if self.quality is None else self.quality.sentence
        return refused or told

    @property
    def ok(self) -> bool | None:
        """Good enough? None where nothing is wrong but no tolerance says what good is."""
        if not self.verdict.ok:
            return False
        return None if self.tolerance_mm is None else True

    def transforms(self) -> Mapping[str, Pose]:
        """The two poses by their full names."""
        return self._named(self.mount_from_camera, self.mount_from_target)

    def _named(self, mount_from_camera: Pose, mount_from_target: Pose) -> Mapping[str, Pose]:
        if self.mount is Mount.EYE_TO_HAND:
            names = ("base_from_camera", "wrist_from_target")
        else:
            names = ("wrist_from_camera", "base_from_target")
        return dict(zip(names, (mount_from_camera, mount_from_target), strict=True))

    def to_json(self) -> dict[str, Any]:
        """Plain values for `--json`; unknown numbers are null; lengths mm."""
        named = {} if self.method is None else {"method": self.method}
        return {
            **named,
            **{name: pose.matrix().tolist() for name, pose in self.transforms().items()},
            **self._where_any(),
            **self._goodness(),
            "leave_one_out": _errors(self.leave_one_out),
            "samples": [
                {
                    "name": sample.name,
                    "used": sample.used,
                    "reason": sample.reason,
                    "px": _known(sample.px),
                    "deg": _known(sample.deg),
                    "mm": _known(sample.mm),
                }
                for sample in self.samples
            ],
            "target_scale": {
                "value": _known(self.target_scale.value),
                "sigma": _known(self.target_scale.sigma),
            },
            "intrinsics": self._intrinsics(),
            **self._for_intrinsics_as_given(),
            "verdict": {
                "ok": self.ok,
                "tolerance_mm": self.tolerance_mm,
                "findings": [
                    {"code": finding.code, "message": finding.message}
                    for finding in self.verdict.findings
                ],
            },
        }

    def _for_intrinsics_as_given(self) -> dict[str, Any]:
        given = self.as_given
        if given is None:
            return {}
        poses = self._named(given.mount_from_camera, given.mount_from_target)
        told = {name: pose.matrix().tolist() for name, pose in poses.items()}
        return {"as_given": {**told, "leave_one_out": _errors(given.leave_one_out)}}

    def _goodness(self) -> dict[str, Any]:
        quality = self.quality
        known = np.isfinite(self.covariance).all()
        return {
            "quality": None
            if quality is None
            else {
                "within_mm": _known(quality.mm),
                "within_deg": _known(quality.deg),
                "calibration_mm": _known(quality.calibration_mm),
                "size_mm": quality.size_mm,
                "distance_mm": quality.distance_mm,
                "samples": quality.count,
                "limited_by": quality.limits,
                "advice": quality.advice,
            },
            "covariance": self.covariance.tolist() if known else None,
            "levels": [
                {
                    "name": level.name,
                    "unit": level.unit,
                    "assumed": level.stated,
                    "found": level.found,
                    "log_sigma": level.log_sigma,
                }
                for level in self.levels
            ],
        }

    def _goodness_rows(self) -> list[tuple[str, str]]:
        rows = []
        sigmas = np.sqrt(np.diag(self.covariance))
        for k, name in enumerate(self.transforms()):
            own = sigmas[6 * k : 6 * k + 6] * ([1.0] * 3 + [180 / np.pi] * 3)
            x, y, z, rx, ry, rz = (figure(float(value)) for value in own)
            told = f"{x} {y} {z} mm, {rx} {ry} {rz} deg"
            rows.append((f"sigma of {name}", told))
        for level in self.levels:
            scale, unit = (180 / np.pi, "deg") if level.unit == "rad" else (1.0, level.unit)
            assumed, found = scale * level.stated, scale * level.found
            rows.append(
                (
                    f"noise: {level.name}",
                    f"assumed {figure(assumed)}, found {figure(found)} {unit}",
                )
            )
        if self.quality is not None and self.quality.limits:
            rows.append(("limited by", f"{self.quality.limits}; helps: {self.quality.advice}"))
        return rows

    def _where_any(self) -> dict[str, Any]:
        entries: dict[str, Any] = {}
        if self.undetermined:
            entries["undetermined"] = list(self.undetermined)
        if self.features:
            entries["features"] = {name: place.tolist() for name, place in self.features.items()}
        return entries

    def _intrinsics(self) -> dict[str, Any] | None:
        if self.camera is None:
            return None
        K = self.camera.matrix
        return {
            "matrix": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
            "distortion": self.camera.distortion.tolist(),
            "refined": self.refined,
        }

    def summary_rows(self) -> list[tuple[str, str]]:
        """Rows (what, value with unit) for a table on a terminal."""
        loo = self.leave_one_out
        count = sum(not math.isnan(sample.mm) for sample in self.samples)
        inlier_count = sum(sample.used for sample in self.samples)
        rows = [("samples", f"{inlier_count} of {len(self.samples)} used")]
        for name, pose in self.transforms().items():
            x, y, z = pose.translation
            rx, ry, rz = (math.degrees(angle) for angle in pose.rotvec())
            rows.append(
                (name, f"{x:.2f} {y:.2f} {z:.2f} mm, rotvec {rx:.3f} {ry:.3f} {rz:.3f} deg")
            )
        rows += [("undetermined", words) for words in self.undetermined]
        rows += [
            (f"feature {name}", f"{x:.2f} {y:.2f} {z:.2f} mm")
            for name, (x, y, z) in self.features.items()
        ]
        rows.append(("leave-one-out", f"{_in_words(loo)} over {count} samples"))
        scale = self.target_scale
        told = (
            f"{scale.value:.5f} +- {scale.sigma:.5f}" if math.isfinite(scale.sigma) else "unknown"
        )
        rows.append(("target scale", told))
        intrinsics = self._intrinsics()
        if intrinsics is not None:
            numbers = " ".join(f"{n:.2f}" for n in intrinsics["matrix"])
            rest = " ".join(f"{n:.4f}" for n in intrinsics["distortion"]) or "none"
            state = "refined" if self.refined else "as given"
            rows.append(("intrinsics", f"{numbers} px, distortion {rest} ({state})"))
        if self.as_given is not None:
            errors = _in_words(self.as_given.leave_one_out)
            rows.append(("intrinsics as given", f"leave-one-out {errors}; poses in --json"))
        rows += self._goodness_rows()
        rows.append(("verdict", self._verdict()))
        rows += [(finding.code, finding.message) for finding in self.verdict.findings]
        return rows

    def _verdict(self) -> str:
        if self.ok is None:
            told = "" if self.quality is None else f", {_text(self.quality.mm, 2)} mm at 95 %"
            return f"no tolerance given{told} (--tolerance-mm)"
        return f"ok, within {self.tolerance_mm:g} mm" if self.ok else "not to be used"


def _errors(errors: LeaveOneOut) -> dict[str, float | None]:
    return {"deg": _known(errors.deg), "mm": _known(errors.mm), "px": _known(errors.px)}


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _in_words(errors: LeaveOneOut) -> str:
    return f"{_text(errors.deg, 3)} deg, {_text(errors.mm, 2)} mm, {_text(errors.px, 2)} px"


def _text(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "unknown"
