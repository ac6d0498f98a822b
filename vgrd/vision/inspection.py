"""What a picture holds, for a person: tags and boards, poses, and remarks that name the remedy."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np

from vgrd.devices import Grey
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import Finding
from vgrd.vision.alignment.quality import disturbance_of_tag
from vgrd.vision.alignment.refinement import Refined, refine
from vgrd.vision.boards.fit import MeasurableBoard
from vgrd.vision.boards.inspection import BoardReport, findings_json, inspect_board
from vgrd.vision.images.drawing import TagMark, axes_px
from vgrd.vision.images.pictures import Picture, as_8_bit
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.codes import LIBRARY_FAMILIES, marker_cells, square_corners
from vgrd.vision.print.raster import tag_raster
from vgrd.vision.print.tolerance import PrintTolerance
from vgrd.vision.tags.causes import cause_for_family
from vgrd.vision.tags.detection import FoundTag, find_tags
from vgrd.vision.tags.library_tags import CELLS_ACROSS, find_library_tags
from vgrd.vision.tags.planar_pose import (
    LEAST_TILT_DEG,
    MOST_MISFIT_PX,
    PlanarPose,
    is_ambiguous,
    planar_poses,
)

_UNREFINED_SIGMA_PX = 0.3  # a guess: as if rounded to whole pixels (0.29 px)
LEAST_CELL_PX = 5.0  # a guess: below 3.6 px the narrowest profile of an edge is too wide
_LEAST_CONTRAST = 40.0  # grey levels; a guess: 20 sigma of white's noise at 40 dB
_MOST_BLUR_PX = 2.0  # a guess: 2.5 times the usual blur of 0.8 px
_CLIPPED, _CLIPPED_SHARE = 254, 0.2  # 255 less a level of rounding; a guess: more than a glint
_NO_BOARDS: Mapping[str, MeasurableBoard] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class TagReport:
    """A tag in a picture.

    corners_px (4, 2) and corner_covariance (8, 8) px^2, order x0 y0 x1 y1 ...; refined: the fit they come
    from, None where only the detection's are there; poses: both solutions, the better first, where
    size and camera are known.
    """

    tag: FoundTag
    corners_px: Array
    corner_covariance: Array
    refined: Refined | None
    poses: tuple[PlanarPose, ...]
    findings: tuple[Finding, ...]

    @property
    def camera_from_tag(self) -> Pose | None:
        """The better pose, mm."""
        return self.poses[0].pose if self.poses else None

    def to_json(self) -> dict[str, object]:
        """As `vgrd detect --json` writes it."""
        document: dict[str, object] = {
            "dictionary": self.tag.family,
            "id": self.tag.id,
            "corners_px": self.corners_px.tolist(),
            "corner_covariance_px2": self.corner_covariance.tolist(),
            "quality": self._quality(),
        }
        if self.poses:
            document["camera_from_tag"] = self.poses[0].pose.matrix().tolist()
            document["covariance"] = self.poses[0].inflated_covariance.tolist()
        return document

    def _quality(self) -> dict[str, object]:
        sigma = float(np.sqrt(np.diag(self.corner_covariance).max()))
        quality: dict[str, object] = {
            "side_px": self.tag.side_px,
            "corner_sigma_px": sigma,
            "contrast": self.tag.contrast,
            "method": "detection" if self.refined is None else str(self.refined.method),
        }
        fit = None if self.refined is None else self.refined.fit
        if fit is not None:
            quality |= {"chi2": fit.chi2, "blur_px": _blur_px(fit.blur), "bloom_px": fit.bloom_px}
        if self.poses:
            quality["tilt_deg"] = self.poses[0].tilt_deg
        return quality | {"findings": findings_json(self.findings)}


@dataclass(frozen=True, slots=True, eq=False)
class PictureReport:
    """All tags of a picture, its boards, and remarks on the whole of it."""

    boards: tuple[BoardReport, ...]
    tags: tuple[TagReport, ...]
    findings: tuple[Finding, ...]
    camera: CameraModel | None
    size_mm: float | None

    def to_json(self) -> dict[str, object]:
        """As `vgrd detect --json` writes it."""
        return {
            "boards": [board.to_json() for board in self.boards],
            "tags": [tag.to_json() for tag in self.tags],
            "findings": findings_json(self.findings),
        }

    def marks(self) -> list[TagMark]:
        """The boards and the tags as they are drawn."""
        boards = [mark for board in self.boards if (mark := board.mark()) is not None]
        return boards + [
            TagMark(
                str(report.tag.id), report.corners_px, self._axes(report), bool(report.findings)
            )
            for report in self.tags
        ]

    def _axes(self, tag: TagReport) -> Array | None:
        pose = tag.camera_from_tag
        if self.camera is None or self.size_mm is None or pose is None:
            return None
        return axes_px(self.camera, pose, self.size_mm / 2)


def inspect_picture(
    picture: Picture,
    families: Sequence[str],
    size_mm: float | None,
    camera: CameraModel | None,
    boards: Mapping[str, MeasurableBoard] = _NO_BOARDS,
) -> PictureReport:
    """Find and measure all tags of the families; poses where size_mm and camera are given.

    boards: by name, measured as wholes; the markers inside of one that is found are no tags of the
    picture. Raises InputError for boards without a camera.
    """
    grey = as_8_bit(picture.pixels)
    if boards and camera is None:
        raise InputError("a board is measured through a known lens: give its camera")
    reports = tuple(
        inspect_board(grey, name, board, camera) for name, board in boards.items() if camera
    )
    square = [family for family in families if family not in LIBRARY_FAMILIES]
    everything = find_tags(grey, square) if square else []
    everything += find_library_tags(grey, [f for f in families if f in LIBRARY_FAMILIES])
    lone_tags = [tag for tag in everything if not any(_is_within(tag, board) for board in reports)]
    counts = Counter((tag.family, tag.id) for tag in lone_tags)
    tags = tuple(
        _measured(grey, tag, size_mm, camera, counts[tag.family, tag.id]) for tag in lone_tags
    )
    findings = []
    if families and not everything:
        cause = cause_for_family(grey, families)
        ending = "" if cause is None else f"; {cause}"
        findings.append(
            Finding("no_tag", f"no tag found; looked for {', '.join(families)}{ending}")
        )
    if picture.is_turned:
        findings.append(
            Finding("turned", "the file asks viewers to turn it; pixels here are as stored")
        )
    return PictureReport(reports, tags, tuple(findings), camera, size_mm)


def remarks(findings: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """What to do about each kind of finding, told once, by the first message of the kind.

    findings: of all tags of a picture, as `TagReport.to_json` writes them.
    """
    counts = Counter(finding["code"] for finding in findings)
    for finding in findings:
        count = counts.pop(finding["code"], 0) - 1
        if count >= 0:
            also = f" (and {count} more)" if count else ""
            yield f"{finding['code']}: {finding['message']}{also}"


def _measured(
    grey: Grey, tag: FoundTag, size_mm: float | None, camera: CameraModel | None, count: int
) -> TagReport:
    refined = None
    if tag.family not in LIBRARY_FAMILIES:
        raster = tag_raster(tag.family, tag.id, size_mm or 1.0)
        refined = refine(grey, raster, tag.corners_px, lens_vector(camera))
    corners, covariance = tag.corners_px, _UNREFINED_SIGMA_PX**2 * np.eye(8)
    if refined is not None:
        corners, covariance = refined.corners_px, refined.covariance
    poses: tuple[PlanarPose, ...] = ()
    misfit_px = 0.0
    if size_mm is not None and camera is not None:
        square = square_corners(size_mm)
        poses = tuple(planar_poses(camera, square, corners, covariance, PrintTolerance().size))
        if poses:
            misfit_px = poses[0].misfit_px(camera, square, corners)
    findings = tuple(
        Finding(code, f"tag {tag.id}: {message}")
        for code, message in [
            *_place_remarks(tag, count),
            *_light_remarks(grey, tag, refined),
            *_pose_remarks(tag, poses, misfit_px),
        ]
    )
    return TagReport(tag, corners, covariance, refined, poses, findings)


def _place_remarks(tag: FoundTag, count: int) -> list[tuple[str, str]]:
    remarks = []
    if count > 1:
        remarks.append(("repeated", f"in the picture {count} times: cover or remove the others"))
    if tag.mirrored:
        remarks.append(
            ("mirrored", "seen as in a mirror: printed wrongly, or the picture is flipped")
        )
    if _is_small(tag):
        remarks.append(
            ("small", f"{tag.side_px:.0f} px: too small, use a larger tag or come nearer")
        )
    return remarks


def _light_remarks(grey: Grey, tag: FoundTag, refined: Refined | None) -> list[tuple[str, str]]:
    """Remarks on focus and light."""
    remarks = []
    if tag.contrast < _LEAST_CONTRAST:
        remarks.append(("contrast", f"only {tag.contrast:.0f} grey levels: give it more light"))
    if _clipped_share(grey, tag.corners_px) > _CLIPPED_SHARE:
        remarks.append(("overexposed", "white is as bright as it can get: expose less"))
    if tag.family in LIBRARY_FAMILIES:
        rough = "corners of this family are rough, as the library finds them"
        return [*remarks, ("unmeasured", f"{rough}: print one of 36h11 for exact ones")]
    if refined is None:
        return [
            *remarks,
            ("unmeasured", "corners are rough: is it half hidden, bent or out of focus?"),
        ]
    fit = refined.fit
    if fit is not None and _blur_px(fit.blur) > _MOST_BLUR_PX:
        blur = f"blurred by {_blur_px(fit.blur):.1f} px"
        remarks.append(("blurred", f"{blur}: focus, or stand still"))
    trouble = disturbance_of_tag(refined)
    if trouble is not None and not _is_small(tag):
        remarks.append(trouble)
    return remarks


def _pose_remarks(
    tag: FoundTag, poses: Sequence[PlanarPose], misfit_px: float
) -> list[tuple[str, str]]:
    if not poses:
        return []
    remarks = []
    tilt = poses[0].tilt_deg
    if misfit_px > MOST_MISFIT_PX:
        deviation = f"its corners are off a square by {misfit_px:.2f} px"
        remarks.append(("misfit", f"{deviation}: is the camera file right, the tag flat?"))
    if is_ambiguous(poses):
        remedy = "tilt it by 10" if tilt < LEAST_TILT_DEG else "use a larger tag or come nearer"
        remarks.append(("ambiguous", f"two poses fit (tilt {tilt:.0f} degrees): {remedy}"))
    elif tilt < LEAST_TILT_DEG:
        side = f"{tag.side_px:.0f} px, tilt {tilt:.0f} degrees"
        remarks.append(("frontal", f"{side}: too frontal, tilt it by 10"))
    return remarks


def _is_within(tag: FoundTag, board: BoardReport) -> bool:
    """Whether a tag lies in the outline of a board that was measured."""
    if board.fit is None:
        return False
    outline, (x, y) = board.fit.refined.corners_px.astype(np.float32), tag.corners_px.mean(0)
    return cv2.pointPolygonTest(outline, (float(x), float(y)), measureDist=False) > 0


def _clipped_share(grey: Grey, corners_px: Array) -> float:
    """Share of the tag's pixels at the upper end of the range."""
    low = np.maximum(np.floor(corners_px.min(0)).astype(int), 0)
    high = np.ceil(corners_px.max(0)).astype(int) + 1
    region = grey[low[1] : high[1], low[0] : high[0]]
    return float(np.mean(region >= _CLIPPED)) if region.size else 0.0


def _is_small(tag: FoundTag) -> bool:
    is_square = tag.family not in LIBRARY_FAMILIES
    cells = len(marker_cells(tag.family, tag.id)) if is_square else CELLS_ACROSS[tag.family]
    return tag.side_px / cells < LEAST_CELL_PX


def _blur_px(blur: Array) -> float:
    """The larger standard deviation of the point spread."""
    return float(np.sqrt(np.linalg.eigvalsh(blur)[-1]))
