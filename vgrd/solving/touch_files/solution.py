"""What `vgrd tcp` answers: the TCP, how far it is known, every touch's fate and a verdict."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vgrd.calibration.levels import Level
from vgrd.calibration.tcp import ToolOrientation
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import radius95
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.geometry.rotation_relaxation import Certificate
from vgrd.model import Verdict


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

    certificate: None where a method has none (unknown plane, ball). levels: of the touches, stated and
    found. tolerance_mm: None where none was given. orientation: of the tool, where the file asks for it, and
    rotation_format: how the file writes rotations.
    """

    tcp_in_wrist: Array
    covariance: Array
    object_from_base: Pose | None
    touches: tuple[TouchReport, ...]
    certificate: Certificate | None
    verdict: Verdict
    levels: tuple[Level, ...]
    tolerance_mm: float | None = None
    orientation: ToolOrientation | None = None
    rotation_format: RotationFormat = RotationFormat.ROTVEC

    @property
    def u95_mm(self) -> float:
        """Radius in which the tip is at 95 %, the spread of the levels included."""
        return radius95(self.covariance)

    @property
    def headline(self) -> str:
        """Whether it is good, in one line."""
        if not self.verdict.ok:
            worst = next(one for one in self.verdict.findings if one.fatal)
            return f"not to be used: {worst.message}"
        count = sum(touch.used for touch in self.touches)
        known = f"at 95 % the tip is known to within {self.u95_mm:.2f} mm, from {count} touches"
        if self.tolerance_mm is None:
            return f"{known}; no tolerance given"
        return f"{known}; the tolerance is {self.tolerance_mm:g} mm"

    def to_json(self) -> dict[str, Any]:
        """Plain values for `--json`: mm, poses 4x4 by rows."""
        X, proof = self.object_from_base, self.certificate
        return {
            "summary": self.headline,
            "u95_mm": self.u95_mm,
            "tolerance_mm": self.tolerance_mm,
            "tcp_in_wrist": self.tcp_in_wrist.tolist(),
            "covariance": self.covariance.tolist(),
            **({"object_from_base": X.matrix().tolist()} if X is not None else {}),
            **self._orientation(),
            "touches": [
                {
                    "name": touch.name,
                    "used": touch.used,
                    "reason": touch.reason,
                    "residual_mm": touch.residual_mm,
                }
                for touch in self.touches
            ],
            "levels": [_plain(level) for level in self.levels],
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
        }

    def _orientation(self) -> dict[str, Any]:
        if self.orientation is None:
            return {}
        R, covariance = self.orientation.wrist_from_tool, self.orientation.covariance
        return {
            "wrist_from_tool": Pose(R, self.tcp_in_wrist).matrix().tolist(),
            "tool_rotation": rotation_to(R, self.rotation_format).tolist(),
            "rotation_covariance": covariance.tolist(),
            "rotation_u95_deg": float(np.degrees(radius95(covariance))),
        }


def _plain(level: Level) -> dict[str, Any]:
    """Stated and found side by side, with the 95 % interval of the found one."""
    low, high = level.interval
    return {
        "what": level.name,
        "unit": level.unit,
        "stated": level.stated,
        "found": level.found,
        "low": low,
        "high": high,
    }
