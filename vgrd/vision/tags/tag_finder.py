"""Find the cell's tags in pictures of one camera and measure their poses, with covariance.

Corners come from the photometric fit where the picture is as it should be, from an edge fit where light
or motion disturb it; both solutions of the pose are weighed by the corners' covariance.
Conventions: `vgrd.model.TagObservation`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np

from vgrd.devices import Grey, Pixels, Region
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel
from vgrd.model import Finding, TagObservation, TagSpec, frozen_array
from vgrd.vision.alignment.quality import disturbance_of_tag
from vgrd.vision.alignment.refinement import Refined, RefinementMethod, refine
from vgrd.vision.images.pictures import as_8_bit
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.codes import SQUARE_FAMILIES, code_count, square_corners
from vgrd.vision.print.raster import Raster, tag_raster
from vgrd.vision.print.tolerance import PrintTolerance
from vgrd.vision.tags.detection import FoundTag, read_tag, search_tags, tags_within
from vgrd.vision.tags.planar_pose import (
    LEAST_TILT_DEG,
    MOST_MISFIT_PX,
    PlanarPose,
    is_ambiguous,
    planar_poses,
)

_REGION_MARGIN = 0.25  # of a tag's extent, around its last place: two cells of a 36h11


@dataclass(frozen=True, slots=True, eq=False)
class TagSighting:
    """A tag in a picture: its observation, None where it is not trustworthy, and remarks."""

    observation: TagObservation | None
    refined: Refined | None
    findings: tuple[Finding, ...]

    @property
    def is_of_all_pixels(self) -> bool:
        """True for an observation that the photometric fit made."""
        is_photometric = (
            self.refined is not None and self.refined.method is RefinementMethod.PHOTOMETRIC
        )
        return self.observation is not None and is_photometric


class TagDetector:
    """Finds the given tags in pictures of one camera; the result depends on no earlier picture.

    camera_matrix (3, 3) px, distortion in OpenCV order (may be empty), size (width, height) px. sigmas_mm: how
    well the sizes of tags are known, by id; others as `PrintTolerance` says. Errors of a print's size are
    not in the covariances, since all its pictures share them: `vgrd.geometry.print_size` tells what they do.
    Compiles (or loads) its loops when it is made. Not thread-safe: one detector per thread. Close
    it, or use it as a context manager. Raises InputError for an unknown family or id.
    """

    def __init__(
        self,
        camera_matrix: Array,
        distortion: Array,
        tags: Sequence[TagSpec],
        size: tuple[int, int],
        sigmas_mm: Mapping[int, float] | None = None,
    ) -> None:
        self._camera = CameraModel(camera_matrix, distortion, size)
        self._lens = lens_vector(self._camera)
        if len({tag.id for tag in tags}) != len(tags):
            raise InputError("tags: every tag needs an id of its own; print one with another id")
        self._tags = {tag.id: tag for tag in tags}
        self._sizes = {tag.id: PrintTolerance().size for tag in tags}
        self._sizes |= {
            tag_id: sigma_mm / self._tags[tag_id].size_mm
            for tag_id, sigma_mm in (sigmas_mm or {}).items()
        }
        self._wanted = {(tag.family, tag.id) for tag in tags}
        self._rasters = {tag.id: _raster(tag) for tag in tags}
        self._threads: ThreadPoolExecutor | None = ThreadPoolExecutor(
            max(len(tags), 1), thread_name_prefix="tag"
        )
        self._frame: Grey | None = None
        self._framed_region: Region | None = None
        warm_up()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the threads; may be called more than once."""
        if self._threads is not None:
            self._threads.shutdown()
        self._threads = None

    def detect(
        self,
        pixels: Pixels,
        previous: Mapping[int, TagObservation] | None = None,
        region: Region | None = None,
    ) -> dict[int, TagObservation]:
        """Find tags in a picture (height, width), uint8 or uint16; returns observations by tag id.

        previous: an earlier result; its tags are looked for at their earlier place first, then
        everywhere, as all others are. region: where the pixels lie in the whole picture, in which the
        corners count. Left out: tags that appear twice, have a damaged code, miss their pose by more
        than 0.5 px rms, or fit two poses. Raises InputError when the picture has another size than
        the camera.
        """
        return {
            tag_id: sighting.observation
            for tag_id, sighting in self.examine(pixels, previous, region).items()
            if sighting.observation is not None
        }

    def examine(
        self,
        pixels: Pixels,
        previous: Mapping[int, TagObservation] | None = None,
        region: Region | None = None,
    ) -> dict[int, TagSighting]:
        """As `detect`, for every tag that is to be seen, with the reasons why one is left out."""
        if self._threads is None:
            raise InputError("the tag detector was closed")
        self._check_size(pixels, region)
        part = np.ascontiguousarray(as_8_bit(pixels))
        grey = part if region is None else self._framed(part, region)
        earlier = {
            tag_id: last for tag_id, last in (previous or {}).items() if tag_id in self._tags
        }
        tracked = self._threads.map(lambda last: self._track(grey, last), earlier.values())
        sightings = {
            tag_id: sighting
            for tag_id, sighting in zip(earlier, tracked, strict=True)
            if sighting is not None
        }
        rest = {pair for pair in self._wanted if pair[1] not in sightings}
        if rest:
            origin = (0, 0) if region is None else (region.x, region.y)
            sightings |= self._search(grey, part, origin, rest)
        return dict(sorted(sightings.items()))

    def _check_size(self, pixels: Pixels, region: Region | None) -> None:
        """Refuse a picture that is not of the configured camera."""
        width, height = self._camera.size_px
        if region is None and pixels.shape != (height, width):
            raise InputError(
                f"picture of {pixels.shape[1]} x {pixels.shape[0]} px, the camera is configured with "
                f"{width} x {height}: correct [camera] size_px"
            )
        if region is not None and (
            pixels.shape != (region.height, region.width)
            or min(region.x, region.y) < 0
            or region.x + region.width > width
            or region.y + region.height > height
        ):
            raise InputError(
                f"picture of {pixels.shape[1]} x {pixels.shape[0]} px for {region} of a camera that "
                f"is configured with {width} x {height}: correct [camera] size_px"
            )

    def _framed(self, part: Grey, region: Region) -> Grey:
        """The whole picture, black outside of `region`; its memory serves the next one again."""
        frame, last = self._frame, self._framed_region
        if frame is None:
            frame = self._frame = np.zeros(self._camera.size_px[::-1], np.uint8)
        if last is not None:
            frame[last.y : last.y + last.height, last.x : last.x + last.width] = 0
        self._framed_region = region
        frame[region.y : region.y + region.height, region.x : region.x + region.width] = part
        return frame

    def _track(self, grey: Grey, earlier: TagObservation) -> TagSighting | None:
        """Look for a tag at its earlier place: measure it from there, else search around.

        A moved tag can lead the fit of edges to a wrong place, so only the photometric fit counts.
        """
        tag = self._tags[earlier.tag.id]
        sighting = self._measured(grey, tag, earlier.corners_px)
        if sighting is not None and sighting.is_of_all_pixels:
            return sighting
        tags = tags_within(grey, {(tag.family, tag.id)}, earlier.corners_px, _REGION_MARGIN)
        if len(tags) != 1 or tags[0].hamming:
            return None
        return self._measured(grey, tag, tags[0].corners_px)

    def _search(
        self, grey: Grey, part: Grey, origin_px: tuple[int, int], ids: set[tuple[str, int]]
    ) -> dict[int, TagSighting]:
        """Look for tags everywhere in the part of a picture that there is."""
        tags = [
            replace(tag, corners_px=tag.corners_px + origin_px) for tag in search_tags(part, ids)
        ]
        counts = Counter(tag.id for tag in tags)
        sightings = {tag.id: _not_readable(tag, counts[tag.id]) for tag in tags}
        good = [tag for tag in tags if counts[tag.id] == 1 and tag.hamming == 0]
        if self._threads is not None:
            measured = self._threads.map(
                lambda tag: self._measured(grey, self._tags[tag.id], tag.corners_px), good
            )
            sightings |= {
                tag.id: sighting or _unfit() for tag, sighting in zip(good, measured, strict=True)
            }
        return sightings

    def _measured(self, grey: Grey, tag: TagSpec, corners_px: Array) -> TagSighting | None:
        """Measure a tag from rough corners; None when there is no such tag at that place."""
        refined = refine(grey, self._rasters[tag.id], corners_px, self._lens)
        if refined is None:
            return None
        read = read_tag(grey, tag.family, tag.id, refined.corners_px)
        if read is None or read.hamming:
            return None
        poses = planar_poses(
            self._camera,
            square_corners(tag.size_mm),
            refined.corners_px,
            refined.covariance,
            self._sizes[tag.id],
        )
        return self._judged(tag, refined, poses)

    def _judged(self, tag: TagSpec, refined: Refined, poses: Sequence[PlanarPose]) -> TagSighting:
        """The observation, unless no pose fits or two do."""
        trouble = disturbance_of_tag(refined)
        findings = () if trouble is None else (Finding(*trouble),)
        if not poses:
            return TagSighting(None, refined, (*findings, *_unfit().findings))
        best = poses[0]
        rms = best.misfit_px(self._camera, square_corners(tag.size_mm), refined.corners_px)
        if rms > MOST_MISFIT_PX:
            return TagSighting(None, refined, (*findings, *_unfit().findings))
        if is_ambiguous(poses):
            two = Finding("ambiguous", "two poses fit it: tilt it by 10 degrees")
            return TagSighting(None, refined, (*findings, two))
        if best.tilt_deg < LEAST_TILT_DEG:
            frontal = f"tilt {best.tilt_deg:.0f} degrees: too frontal, tilt it by 10"
            findings = (*findings, Finding("frontal", frontal))
        observation = TagObservation(
            tag,
            best.pose,
            frozen_array(best.inflated_covariance, 6, 6),
            frozen_array(refined.corners_px, 4, 2),
            rms,
            1.0 if refined.fit is None else refined.fit.chi2,
        )
        return TagSighting(observation, refined, findings)


def warm_up() -> None:
    """Compile the loops, or load them from their cache, so that no request has to wait for it."""
    cells = np.kron(tag_raster("36h11", 0, 8.0).cells, np.ones((12, 12)))
    picture = np.pad(cells * 150 + 50, 20, mode="edge").astype(np.uint8)
    picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), dtype=np.uint8)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) * 96 + 31.5
    refined = refine(picture, tag_raster("36h11", 0, 8.0), corners, lens_vector(None))
    if refined is not None:
        camera = CameraModel(np.diag([500.0, 500.0, 1.0]), np.zeros(0), picture.shape[::-1])
        planar_poses(camera, square_corners(8.0), refined.corners_px, refined.covariance)


def _raster(tag: TagSpec) -> Raster:
    if tag.family not in SQUARE_FAMILIES:
        raise InputError(
            f"tag family {tag.family} is unknown; known: {', '.join(SQUARE_FAMILIES)}"
        )
    if not 0 <= tag.id < code_count(tag.family):
        raise InputError(
            f"tag {tag.id}: family {tag.family} has the ids 0 to {code_count(tag.family) - 1}"
        )
    return tag_raster(tag.family, tag.id, tag.size_mm)


def _not_readable(tag: FoundTag, times: int) -> TagSighting:
    """Why a tag that was found is not measured."""
    if times > 1:
        repeated = f"in the picture {times} times: cover or remove the others"
        return TagSighting(None, None, (Finding("repeated", repeated),))
    damaged = (
        f"{tag.hamming} cells of its code read wrongly: clean it, uncover it or print it anew"
    )
    return TagSighting(None, None, (Finding("damaged", damaged),))


def _unfit() -> TagSighting:
    message = (
        "its corners do not fit a flat square: is it bent, half hidden, or the camera file wrong?"
    )
    return TagSighting(None, None, (Finding("misfit", message),))
