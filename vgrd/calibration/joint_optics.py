"""Tag sizes and intrinsics as unknowns: how a tag is seen when they are not what was assumed.

A tag's pose is measured from its corners. It is taken back to the pixels it came from, and from
these to the pose that explains them with the refined camera and size. Every refined number is
counted in sigmas of what was known about it before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.point_pose import linearize_points, pose_from_points
from vgrd.model import CellFacts, TagObservation, TagSpec, frozen_array

TAG_A, TAG_B = "size of tag A", "size of tag B"
FOCAL, CENTER_X, CENTER_Y, K1 = "focal length", "cx", "cy", "k1"

_SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
_INTRINSIC: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {FOCAL: (0, 1), CENTER_X: (2,), CENTER_Y: (3,), K1: (4,)}
)
"""Which of `CameraModel.intrinsics` each one moves; fx and fy in their ratio."""


@dataclass(frozen=True, slots=True)
class Refinement:
    """Sigma of what is known beforehand of the numbers to refine; None holds one at its value.

    tag_a_mm, tag_b_mm: of the printed edge; focal_px, center_px (both cx and cy), k1.
    """

    tag_a_mm: float | None = None
    tag_b_mm: float | None = None
    focal_px: float | None = None
    center_px: float | None = None
    k1: float | None = None

    def sigmas(self) -> dict[str, float]:
        """Of what is refined, by name."""
        every = {
            TAG_A: self.tag_a_mm,
            TAG_B: self.tag_b_mm,
            FOCAL: self.focal_px,
            CENTER_X: self.center_px,
            CENTER_Y: self.center_px,
            K1: self.k1,
        }
        return {name: sigma for name, sigma in every.items() if sigma}


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A tag's pose as refined; by_refined: (6, e), its left tangent; shift (6, 6): old to new."""

    pose: Pose
    by_refined: Array
    shift: Array

    def whitener(self, whitener: Array) -> Array:
        """The whitener (6, 6) of the pose as measured, for this one: the same noise on the tag."""
        return np.asarray(whitener @ np.linalg.inv(self.shift))


@dataclass(frozen=True, slots=True, eq=False)
class Optics:
    """camera: as assumed; sizes_mm: by name of the tag; sigmas: of what is refined, by name."""

    camera: CameraModel
    sizes_mm: Mapping[str, float]
    sigmas: Mapping[str, float]

    @classmethod
    def of(cls, facts: CellFacts, refinement: Refinement | None) -> "Optics":
        """What a cell says, and what is to be refined of it."""
        camera = CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px)
        sizes = {TAG_A: (facts.tag_a or facts.tag_b).size_mm, TAG_B: facts.tag_b.size_mm}
        return cls(camera, sizes, (refinement or Refinement()).sigmas())

    @property
    def count(self) -> int:
        """How many numbers are refined."""
        return len(self.sigmas)

    def camera_at(self, values: Array) -> CameraModel:
        """Camera with refined intrinsics; values: (e,) in sigmas."""
        if not self._of_camera():
            return self.camera
        return self.camera.with_intrinsics(self.camera.intrinsics() + self.intrinsics() @ values)

    def intrinsics(self) -> Array:
        """(6, e): how fx, fy, cx, cy, k1, k2 move with the refined numbers."""
        out = np.zeros((6, self.count))
        own = self.camera.intrinsics()
        for column, (name, sigma) in enumerate(self.sigmas.items()):
            for row in _INTRINSIC.get(name, ()):
                out[row, column] = sigma * (own[row] / own[0] if name == FOCAL else 1.0)
        return out

    def size_mm(self, tag: str, values: Array) -> float:
        """Refined edge of TAG_A or TAG_B."""
        known = self.sizes_mm[tag]
        if tag not in self.sigmas:
            return known
        return known + self.sigmas[tag] * float(values[list(self.sigmas).index(tag)])

    def at(self, measured: Pose, tag: str, values: Array) -> Seen:
        """The pose of TAG_A or TAG_B, measured as assumed, with refined numbers (e,)."""
        corners, size = _SQUARE * self.sizes_mm[tag], self.size_mm(tag, values)
        pose, camera = measured, self.camera_at(values)
        by = np.zeros((6, self.count))
        if self._of_camera():
            pixels = self.camera.project(measured @ corners)
            pose = pose_from_points(corners, pixels, camera, measured).camera_from_target
        pose = Pose(pose.rotation, pose.translation * (size / self.sizes_mm[tag]))
        if self._of_camera():
            by += by_intrinsics(camera, _SQUARE * size, pose) @ self.intrinsics()
        if tag in self.sigmas:
            by[:3, list(self.sigmas).index(tag)] += pose.translation * self.sigmas[tag] / size
        return Seen(pose, by, (pose @ measured.inverse()).adjoint())

    def _of_camera(self) -> bool:
        return any(name in _INTRINSIC for name in self.sigmas)


@dataclass(frozen=True, slots=True, eq=False)
class RefinedOptics:
    """Tag sizes and intrinsics as a calibration refined them; values: (e,) in sigmas."""

    optics: Optics
    values: Array
    tags: Mapping[TagSpec, str]

    def corrected(self, tag: TagObservation) -> TagObservation:
        """The same tag as seen with the refined numbers, its noise carried along."""
        if not self.optics.count:
            return tag
        seen = self.optics.at(tag.camera_from_tag, self.tags[tag.tag], self.values)
        covariance = frozen_array(seen.shift @ tag.covariance @ seen.shift.T, 6, 6)
        return replace(tag, camera_from_tag=seen.pose, covariance=covariance)

    def by_refined(self, tag: TagObservation) -> Array:
        """(6, e): left tangent by which `corrected(tag)` moves, per sigma of every number."""
        return self.optics.at(tag.camera_from_tag, self.tags[tag.tag], self.values).by_refined


def by_intrinsics(camera: CameraModel, points_in_target: Array, camera_from_target: Pose) -> Array:
    """Left tangent (6, 6) by which a target is seen elsewhere per fx, fy, cx, cy, k1, k2."""
    by_pose = linearize_points(camera, camera_from_target, points_in_target)[1].reshape(-1, 6)
    J = camera.intrinsics_jacobian(camera_from_target @ points_in_target).reshape(-1, 6)
    return np.asarray(-np.linalg.pinv(by_pose) @ J)
