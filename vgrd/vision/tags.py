"""Find AprilTags in a picture and measure their poses, with covariance.

Corners come from pyapriltags (0.007 to 0.02 px, the best that is published),
poses from both solutions of IPPE, each refined by Levenberg-Marquardt with distortion.
Conventions: `vgrd.model.TagObservation`.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pyapriltags import Detector

from vgrd.devices import Pixels
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.model import TagObservation, TagSpec, frozen_array

FAMILIES = ("16h5", "25h9", "36h11")  # those whose outer edge is the black square
CORNER_SIGMA_PX = 0.02
_WORST_RMS_PX = 0.5
_BRANCH_MARGIN = 25.0  # chi-square by which the second solution must be worse: 5 sigma
_SAME_MINIMUM_RAD = np.radians(1.0)
_COARSE_WIDTH_PX = 1300  # wider pictures are halved until they are not wider, then searched
_REGION_MARGIN = 0.25  # of a tag's extent, around where it was


@dataclass(frozen=True, slots=True, eq=False)
class _Quad:
    """A decoded tag: family without prefix, id, corners (4, 2) in the model's order and convention."""

    family: str
    id: int
    corners_px: Array


class TagDetector:
    """Finds the given tags in pictures of one camera; keeps nothing between pictures.

    camera_matrix (3, 3) px, distortion in OpenCV order (may be empty), size (width, height) px.
    Not thread-safe: one detector per thread. Close it, or use it as a context manager. Raises
    InputError for an unknown family.
    """

    def __init__(
        self,
        camera_matrix: Array,
        distortion: Array,
        tags: Sequence[TagSpec],
        size: tuple[int, int],
    ) -> None:
        self._matrix = np.asarray(camera_matrix, dtype=np.float64)
        self._distortion = np.asarray(distortion, dtype=np.float64)
        self._tags = {(tag.family, tag.id): tag for tag in tags}
        self._size = size
        if len({tag.id for tag in tags}) != len(tags):
            raise InputError("tags: every tag needs an id of its own; print one with another id")
        self._engine: Detector | None = _engine({tag.family for tag in tags})

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the library's memory; may be called more than once."""
        self._engine = None

    def detect(
        self, pixels: Pixels, around: Mapping[int, TagObservation] | None = None
    ) -> dict[int, TagObservation]:
        """Find tags in a picture (height, width), uint8 or uint16; returns observations by tag id.

        around: an earlier result; its tags are looked for where they were, and everywhere when
        they are not there. Tags that were never seen are always looked for everywhere. Left out:
        tags that appear twice, have a damaged code, do not fit their pose by more than 0.5 px rms,
        or have two poses that fit. Raises InputError when the picture has another size than the
        camera.
        """
        if pixels.shape != self._size[::-1]:
            raise InputError(
                f"picture of {pixels.shape[1]} x {pixels.shape[0]} px, the camera is configured with "
                f"{self._size[0]} x {self._size[1]}: correct [camera] size_px"
            )
        grey = _as_uint8(pixels)
        quads = self._track(grey, around or {})
        missing = {spec.id for spec in self._tags.values()} - quads.keys()
        if missing:
            found = self._search(grey)
            quads |= {tag_id: found[tag_id] for tag_id in missing & found.keys()}
        measured = {
            tag_id: self._measure(self._tags[quad.family, quad.id], quad.corners_px)
            for tag_id, quad in sorted(quads.items())
        }
        return {tag_id: seen for tag_id, seen in measured.items() if seen is not None}

    def _track(
        self, grey: NDArray[np.uint8], around: Mapping[int, TagObservation]
    ) -> dict[int, _Quad]:
        """Look for each tag where it was."""
        tracked = {}
        for tag_id, earlier in around.items():
            found = self._in_region(grey, earlier.corners_px)
            if tag_id in found:
                tracked[tag_id] = found[tag_id]
        return tracked

    def _search(self, grey: NDArray[np.uint8]) -> dict[int, _Quad]:
        """Look everywhere, in a smaller picture if it is large, then measure the corners in the full one."""
        small, scale = grey, 1
        while small.shape[1] > _COARSE_WIDTH_PX:
            half = (small.shape[1] // 2, small.shape[0] // 2)
            small = np.asarray(cv2.resize(small, half, interpolation=cv2.INTER_AREA), np.uint8)
            scale *= 2
        coarse = self._read(small)
        if scale == 1:
            return coarse
        fine = {}
        for tag_id, quad in coarse.items():
            found = self._in_region(grey, scale * (quad.corners_px + 0.5) - 0.5)
            if tag_id in found:
                fine[tag_id] = found[tag_id]
        return fine

    def _in_region(self, grey: NDArray[np.uint8], corners_px: Array) -> dict[int, _Quad]:
        low, high = corners_px.min(0), corners_px.max(0)
        margin = _REGION_MARGIN * float((high - low).max()) + 8
        x0, y0 = np.maximum(np.floor(low - margin), 0).astype(int).tolist()
        x1, y1 = np.minimum(np.ceil(high + margin), self._size).astype(int).tolist()
        if x1 - x0 < 16 or y1 - y0 < 16:
            return {}
        return self._read(grey[y0:y1, x0:x1], np.array([x0, y0], dtype=np.float64))

    def _read(self, grey: NDArray[np.uint8], origin_px: Array | None = None) -> dict[int, _Quad]:
        """Decode our tags in (a part of) a picture; a tag that appears twice is ambiguous and left out."""
        if self._engine is None:
            raise InputError("the tag detector was closed")
        shift = -0.5 if origin_px is None else origin_px - 0.5
        quads = [
            # The library counts counter-clockwise from the bottom left, pixel centres at one half.
            _Quad(found.tag_family.decode().removeprefix("tag"), found.tag_id, corners + shift)
            for found in self._engine.detect(grey)
            for corners in [np.array(found.corners[::-1], dtype=np.float64)]
            if found.hamming == 0
        ]
        return _unambiguous(quad for quad in quads if (quad.family, quad.id) in self._tags)

    def _measure(self, tag: TagSpec, corners_px: Array) -> TagObservation | None:
        """Pose and covariance from four corners; None when the pose does not fit or is ambiguous."""
        candidates = self._solutions(tag, corners_px)
        if not candidates:
            return None
        rms, pose = candidates[0]
        if rms > _WORST_RMS_PX or _flips(candidates):
            return None
        sigma = np.hypot(
            CORNER_SIGMA_PX, 2 * rms
        )  # eight coordinates leave two degrees of freedom
        J = self._jacobian(pose.apply(_square(tag)))
        spread = np.linalg.inv(np.linalg.qr(J).R) * sigma  # J'J would square a condition of 1e5
        covariance = spread @ spread.T
        return TagObservation(
            tag,
            pose,
            frozen_array(covariance, 6, 6),
            frozen_array(corners_px, 4, 2),
            rms,
        )

    def _solutions(self, tag: TagSpec, corners_px: Array) -> list[tuple[float, Pose]]:
        """Both poses of a square, refined, as (reprojection rms in px, camera_from_tag), best first."""
        square, camera = _square(tag), (self._matrix, self._distortion)
        _, rotvecs, translations, _ = cv2.solvePnPGeneric(
            square, corners_px, *camera, flags=cv2.SOLVEPNP_IPPE
        )
        solutions = []
        for start in zip(rotvecs, translations, strict=True):
            rotvec, translation = cv2.solvePnPRefineLM(square, corners_px, *camera, *start)
            projected, _ = cv2.projectPoints(square, rotvec, translation, *camera)
            rms = float(np.sqrt(np.mean((projected[:, 0] - corners_px) ** 2)))
            if np.isfinite(rms) and translation[2] > 0:
                solutions.append((rms, Pose.from_rotvec(rotvec[:, 0], translation[:, 0])))
        return sorted(solutions, key=lambda solution: solution[0])

    def _jacobian(self, points_in_camera: Array) -> Array:
        """Derivative (2n, 6) of the pixels by a left tangent perturbation (v, w) of the pose."""
        zero = np.zeros(3)
        _, derivatives = cv2.projectPoints(
            points_in_camera, zero, zero, self._matrix, self._distortion
        )
        return np.asarray(np.hstack([derivatives[:, 3:6], derivatives[:, :3]]))


def _engine(families: Set[str]) -> Detector:
    names = sorted(f"tag{family}" for family in families)
    unknown = sorted(set(families) - set(FAMILIES))
    if unknown:
        raise InputError(
            f"tag family {', '.join(unknown)} is unknown; known: {', '.join(FAMILIES)}"
        )
    return Detector(families=" ".join(names), nthreads=1, quad_decimate=2.0, refine_edges=1)


def _as_uint8(pixels: Pixels) -> NDArray[np.uint8]:
    """Grey levels as 8 bits; uint16 is scaled by its brightest pixel (10, 12 and 16 bit cameras)."""
    if pixels.dtype == np.uint8:
        return np.asarray(pixels, dtype=np.uint8)
    brightest = max(int(pixels.max()), 1)
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / brightest), dtype=np.uint8)


def _square(tag: TagSpec) -> Array:
    """Corners (4, 3) of a tag's black square in its own frame, mm."""
    half = tag.size_mm / 2
    return half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


def _unambiguous(quads: Iterable[_Quad]) -> dict[int, _Quad]:
    kept = list(quads)
    counts = Counter(quad.id for quad in kept)
    return {quad.id: quad for quad in kept if counts[quad.id] == 1}


def _flips(candidates: Sequence[tuple[float, Pose]]) -> bool:
    """Tell whether a second, different pose explains the corners nearly as well (small tilt)."""
    if len(candidates) < 2:
        return False
    (best, pose), (second, other) = candidates[:2]
    if pose.distance(other)[1] < _SAME_MINIMUM_RAD:
        return False
    corner_coordinates = 8
    worse = corner_coordinates * (second**2 - best**2)
    return bool(worse < _BRANCH_MARGIN * max(CORNER_SIGMA_PX, best) ** 2)
