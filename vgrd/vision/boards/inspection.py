"""What a picture shows of a board, for a person: outline, pose, and remarks that name the remedy."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgrd.devices import Grey
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.pose import hat
from vgrd.model import Finding
from vgrd.vision.alignment.quality import disturbance
from vgrd.vision.boards.fit import BoardFit, MeasurableBoard, fit_board, sizes_remark
from vgrd.vision.images.drawing import TagMark, axes_px
from vgrd.vision.tags.planar_pose import MOST_MISFIT_PX, is_ambiguous

_WHOLE = 0.9  # share of its edges that are seen; a guess: dirt hides less than a tenth
_AXES_SHARE = 0.3  # of the board's shorter side, as drawn; a guess: seen, and hides little


@dataclass(frozen=True, slots=True, eq=False)
class BoardReport:
    """A board in a picture.

    fit: None where the board is not measured; pose: camera_from_board, None where it would be a guess;
    misfit_px: rms of the outline's corners against that pose; axes_px (4, 2), as drawn.
    """

    name: str
    fit: BoardFit | None
    pose: Pose | None
    misfit_px: float | None
    axes_px: Array | None
    findings: tuple[Finding, ...]

    def to_json(self) -> dict[str, object]:
        """As `vgrd detect --json` writes it."""
        document: dict[str, object] = {"board": self.name}
        if self.fit is not None:
            if self.pose is not None:
                document["covariance"] = self.fit.covariance.tolist()
                document["origin_sigma_mm"] = _origin_sigma_mm(self.pose, self.fit.covariance)
            refined = self.fit.refined
            document |= {
                "corners_px": refined.corners_px.tolist(),
                "corner_covariance_px2": refined.covariance.tolist(),
                "corner_sigma_px": float(np.sqrt(np.diag(refined.covariance).max())),
                "method": str(refined.method),
            }
            if refined.fit is not None:
                document["chi2"] = refined.fit.chi2
        if self.misfit_px is not None:
            document["misfit_px"] = self.misfit_px
        if self.pose is not None:
            document["camera_from_board"] = self.pose.matrix().tolist()
        return document | {"findings": findings_json(self.findings)}

    def mark(self) -> TagMark | None:
        """The board as it is drawn."""
        if self.fit is None:
            return None
        corners = self.fit.refined.corners_px
        return TagMark(Path(self.name).stem, corners, self.axes_px, bool(self.findings))


def inspect_board(
    grey: Grey, name: str, board: MeasurableBoard, camera: CameraModel
) -> BoardReport:
    """Find and measure a board in a grey 8-bit picture (h, w)."""
    try:
        fit = fit_board(grey, board, camera)
    except TagNotSeen as error:
        finding = Finding("not_measured", f"{Path(name).name}: {error}")
        return BoardReport(name, None, None, None, None, (finding,))
    best = fit.poses[0] if fit.poses else None
    misfit_px = (
        None if best is None else best.misfit_px(camera, fit.outline, fit.refined.corners_px)
    )
    doubts = _doubts(fit, misfit_px)
    findings = tuple(
        Finding(code, f"{Path(name).name}: {message}")
        for code, message in (*doubts, *_remarks(fit))
    )
    if best is None or doubts:
        return BoardReport(name, fit, None, misfit_px, None, findings)
    length_mm = _AXES_SHARE * float(np.ptp(fit.outline[:, :2], axis=0).min())
    return BoardReport(
        name, fit, best.pose, misfit_px, axes_px(camera, best.pose, length_mm), findings
    )


def findings_json(findings: Sequence[Finding]) -> list[dict[str, str]]:
    """Findings of a picture, as `vgrd detect --json` writes them."""
    return [{"code": finding.code, "message": finding.message} for finding in findings]


def _origin_sigma_mm(camera_from_board: Pose, covariance: Array) -> float:
    """1 sigma of the board's origin along the direction in which it is worst known."""
    origin_by_tangent = np.hstack([np.eye(3), -hat(camera_from_board.translation)])
    spread = origin_by_tangent @ covariance @ origin_by_tangent.T
    return float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))


def _remarks(fit: BoardFit) -> list[tuple[str, str]]:
    """What makes a pose worse than it could be."""
    remarks = [("sizes", sizes_remark(fit.excess))] if fit.excess else []
    share = fit.seen
    if share < _WHOLE:  # looks like a shadow to the fit of the light
        remark = (
            f"only {share:.0%} of its edges are seen: uncover it, or bring it into the picture"
        )
        return [*remarks, ("partial", remark)]
    cause = disturbance(fit.refined)
    return remarks if cause is None else [*remarks, cause]


def _doubts(fit: BoardFit, misfit_px: float | None) -> list[tuple[str, str]]:
    """Why a pose would be a guess."""
    doubts = []
    if misfit_px is None or misfit_px > MOST_MISFIT_PX:
        amount = "" if misfit_px is None else f" by {misfit_px:.2f} px"
        remedy = "is the camera file right, the board flat?"
        doubts.append(("misfit", f"its outline is off a rectangle{amount}: {remedy}"))
    if is_ambiguous(fit.poses):
        doubts.append(
            ("ambiguous", "two poses fit: tilt it by 10 degrees, come nearer, or uncover it")
        )
    return doubts
