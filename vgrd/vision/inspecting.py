"""What a picture holds, for a person: tags with corners, poses, and remarks that name the remedy."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.point_pose import pose_from_points
from vgrd.model import Finding
from vgrd.vision.codes import marker_cells, square_corners
from vgrd.vision.drawing import TagMark, axes_px
from vgrd.vision.finding import FoundTag, find_tags
from vgrd.vision.pictures import Picture, as_8_bit

_SIGMA_PX = 0.1
_LEAST_CELL_PX = 5.0
_LEAST_CONTRAST = 40.0
_LEAST_TILT_DEG = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class TagReport:
    """A tag in a picture.

    corners_px (4, 2) and corner_covariance (8, 8) px^2, order x0 y0 x1 y1 ...; camera_from_tag and
    its covariance (6, 6), left tangent, mm and rad, where size and camera are known.
    """

    found: FoundTag
    corners_px: Array
    corner_covariance: Array
    findings: tuple[Finding, ...]
    size_mm: float | None = None
    camera_from_tag: Pose | None = None
    covariance: Array | None = None

    @property
    def tilt_deg(self) -> float | None:
        """Angle between the tag's normal and the line of sight to it."""
        if self.camera_from_tag is None:
            return None
        return tilt_deg(self.camera_from_tag)

    def to_json(self) -> dict[str, object]:
        """As `vgrd detect --json` writes it."""
        quality: dict[str, object] = {
            "side_px": self.found.side_px,
            "contrast": self.found.contrast,
        }
        if self.tilt_deg is not None:
            quality["tilt_deg"] = self.tilt_deg
        quality["findings"] = _as_json(self.findings)
        out: dict[str, object] = {
            "dictionary": self.found.family,
            "id": self.found.id,
            "corners_px": self.corners_px.tolist(),
            "corner_covariance_px2": self.corner_covariance.tolist(),
            "quality": quality,
        }
        if self.camera_from_tag is not None and self.covariance is not None:
            out["camera_from_tag"] = self.camera_from_tag.matrix().tolist()
            out["covariance"] = self.covariance.tolist()
        return out


@dataclass(frozen=True, slots=True, eq=False)
class PictureReport:
    """All tags of a picture, and remarks on the whole of it."""

    tags: tuple[TagReport, ...]
    findings: tuple[Finding, ...]
    camera: CameraModel | None

    def to_json(self) -> dict[str, object]:
        """As `vgrd detect --json` writes it."""
        return {
            "tags": [tag.to_json() for tag in self.tags],
            "findings": _as_json(self.findings),
        }

    def marks(self) -> list[TagMark]:
        """The tags as they are drawn."""
        return [
            TagMark(
                str(tag.found.id),
                tag.corners_px,
                axes_px(self.camera, tag.camera_from_tag, tag.size_mm / 2)
                if self.camera and tag.camera_from_tag and tag.size_mm
                else None,
                doubtful=bool(tag.findings),
            )
            for tag in self.tags
        ]


def inspect_picture(
    picture: Picture, families: Sequence[str], size_mm: float | None, camera: CameraModel | None
) -> PictureReport:
    """Find and measure all tags of the families."""
    grey = as_8_bit(picture.pixels)
    found = find_tags(grey, families)
    counts = Counter((tag.family, tag.id) for tag in found)
    tags = tuple(_measured(tag, size_mm, camera, counts[tag.family, tag.id]) for tag in found)
    findings = []
    if not tags:
        findings.append(Finding("no_tag", f"no tag found; looked for {', '.join(families)}"))
    if picture.turned:
        findings.append(
            Finding("turned", "the file asks viewers to turn it; pixels here are as stored")
        )
    return PictureReport(tags, tuple(findings), camera)


def tilt_deg(camera_from_tag: Pose) -> float:
    """Angle between the tag's normal and the line of sight to its centre."""
    sight = camera_from_tag.translation / np.linalg.norm(camera_from_tag.translation)
    cosine = abs(float(sight @ camera_from_tag.rotation[:, 2]))
    return float(np.degrees(np.arccos(min(cosine, 1.0))))


def _measured(
    tag: FoundTag, size_mm: float | None, camera: CameraModel | None, count: int
) -> TagReport:
    pose = covariance = None
    if size_mm is not None and camera is not None:
        fit = pose_from_points(square_corners(size_mm), tag.corners_px, camera, sigma_px=_SIGMA_PX)
        pose, covariance = fit.camera_from_target, fit.covariance
    findings = tuple(_findings(tag, pose, count))
    corner_covariance = _SIGMA_PX**2 * np.eye(8)
    return TagReport(tag, tag.corners_px, corner_covariance, findings, size_mm, pose, covariance)


def _findings(tag: FoundTag, pose: Pose | None, count: int) -> list[Finding]:
    """Remarks in the operator's terms."""
    name, side = f"tag {tag.id}: {tag.side_px:.0f} px", tag.side_px
    out = []
    if count > 1:
        out.append(
            Finding("twice", f"{name}: {count} of this id in the picture; print another id", True)
        )
    if side / len(marker_cells(tag.family, tag.id)) < _LEAST_CELL_PX:
        out.append(Finding("small", f"{name}: too small; use a larger tag or come nearer"))
    if tag.contrast < _LEAST_CONTRAST:
        out.append(Finding("contrast", f"{name}: only {tag.contrast:.0f} grey levels; more light"))
    if pose is not None and tilt_deg(pose) < _LEAST_TILT_DEG:
        out.append(
            Finding(
                "frontal", f"{name}, tilt {tilt_deg(pose):.0f} degrees: too frontal, tilt it by 10"
            )
        )
    return out


def _as_json(findings: Sequence[Finding]) -> list[dict[str, str]]:
    return [{"code": finding.code, "message": finding.message} for finding in findings]
