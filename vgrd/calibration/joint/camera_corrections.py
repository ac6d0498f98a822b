"""Tag sizes and intrinsics as unknowns: how a tag is seen when they are not what was assumed.

A tag's pose is measured from its corners. It is taken back to the pixels it came from, and from
these to the pose that explains them with the refined camera and size. Every refined number is
counted in sigmas of what was known about it before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.model import CellFacts, TagObservation, TagSpec, frozen_array

TAG_A, TAG_B = "size of tag A", "size of tag B"
FOCAL, CENTER_X, CENTER_Y, K1 = "focal length", "cx", "cy", "k1"

_SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
_RESECTIONS = 4  # Gauss-Newton steps from a pose that is right to a pixel
_INTRINSIC: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {FOCAL: (0, 1), CENTER_X: (2,), CENTER_Y: (3,), K1: (4,)}
)
"""Which of `CameraModel.intrinsics` each one moves; fx and fy in their ratio."""


@dataclass(frozen=True, slots=True)
class PriorSigmas:
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
class RefinedTags:
    """n tags as refined: rotations (n, 3, 3), translations (n, 3).

    J_refined: (n, 6, e), left tangents; shifts: (n, 6, 6), tangents as measured to refined ones.
    """

    rotations: Array
    translations: Array
    J_refined: Array
    shifts: Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraCorrections:
    """camera: as assumed; sizes_mm: by name of the tag; sigmas: of what is refined, by name."""

    camera: CameraModel
    sizes_mm: Mapping[str, float]
    sigmas: Mapping[str, float]

    @classmethod
    def of(cls, facts: CellFacts, refinement: PriorSigmas | None) -> "CameraCorrections":
        """What a cell says, and what is to be refined of it."""
        camera = CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px)
        sizes = {TAG_A: (facts.tag_a or facts.tag_b).size_mm, TAG_B: facts.tag_b.size_mm}
        return cls(camera, sizes, (refinement or PriorSigmas()).sigmas())

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
        J = np.zeros((6, self.count))
        values = self.camera.intrinsics()
        for column, (name, sigma) in enumerate(self.sigmas.items()):
            for row in _INTRINSIC.get(name, ()):
                J[row, column] = sigma * (values[row] / values[0] if name == FOCAL else 1.0)
        return J

    def size_mm(self, tag: str, values: Array) -> float:
        """Refined edge of TAG_A or TAG_B."""
        nominal_mm = self.sizes_mm[tag]
        if tag not in self.sigmas:
            return nominal_mm
        return nominal_mm + self.sigmas[tag] * float(values[list(self.sigmas).index(tag)])

    def refine(
        self, rotations: Array, translations: Array, tag: str, values: Array
    ) -> RefinedTags:
        """Poses (n, 3, 3), (n, 3) of TAG_A or TAG_B as measured, with refined numbers (e,)."""
        nominal_mm, size_mm = self.sizes_mm[tag], self.size_mm(tag, values)
        R, t, J_refined = rotations, translations, np.zeros((len(rotations), 6, self.count))
        camera = self.camera_at(values)
        if self._of_camera():
            pixels = self.camera.project(_corners(R, t, nominal_mm))
            R, t = _resected(R, t, pixels, camera, nominal_mm)
        t = t * (size_mm / nominal_mm)
        if self._of_camera():
            J_refined += _by_intrinsics(R, t, camera, size_mm) @ self.intrinsics()
        if tag in self.sigmas:
            J_refined[:, :3, list(self.sigmas).index(tag)] += t * self.sigmas[tag] / size_mm
        turn = R @ np.swapaxes(rotations, 1, 2)
        back = t - np.einsum("nij,nj->ni", turn, translations)
        return RefinedTags(R, t, J_refined, adjoints(turn, back))

    def _of_camera(self) -> bool:
        return any(name in _INTRINSIC for name in self.sigmas)


@dataclass(frozen=True, slots=True, eq=False)
class RefinedCorrections:
    """Tag sizes and intrinsics as a calibration refined them; values: (e,) in sigmas."""

    corrections: CameraCorrections
    values: Array
    tags: Mapping[TagSpec, str]

    def corrected(self, tag: TagObservation) -> TagObservation:
        """The same tag as seen with the refined numbers, its noise carried along."""
        if not self.corrections.count:
            return tag
        refined = self._refine(tag)
        A = refined.shifts[0]
        pose = Pose(refined.rotations[0], refined.translations[0])
        covariance = frozen_array(A @ tag.covariance @ A.T, 6, 6)
        return replace(tag, camera_from_tag=pose, covariance=covariance)

    def corrected_jacobian(self, tag: TagObservation) -> Array:
        """(6, e): left tangent by which `corrected(tag)` moves, per sigma of every number."""
        return np.asarray(self._refine(tag).J_refined[0])

    def _refine(self, tag: TagObservation) -> RefinedTags:
        C = tag.camera_from_tag
        name = self.tags[tag.tag]
        return self.corrections.refine(C.rotation[None], C.translation[None], name, self.values)


def adjoints(R: Array, t: Array) -> Array:
    """Adjoints (n, 6, 6) of poses (n, 3, 3), (n, 3)."""
    A = np.zeros((len(R), 6, 6))
    A[:, :3, :3] = A[:, 3:, 3:] = R
    A[:, :3, 3:] = hat(t) @ R
    return A


def _corners(R: Array, t: Array, size_mm: float) -> Array:
    """Corners (4 n, 3) of tags in the camera."""
    corners = size_mm * _SQUARE @ np.swapaxes(R, 1, 2) + t[:, None]
    return np.asarray(corners.reshape(-1, 3))


def _resected(
    R: Array, t: Array, pixels: Array, camera: CameraModel, size_mm: float
) -> tuple[Array, Array]:
    """Poses near the ones given that put the corners of tags to pixels (4 n, 2): Gauss-Newton."""
    for _ in range(_RESECTIONS):
        corners = _corners(R, t, size_mm)
        residuals = (pixels - camera.project(corners)).reshape(-1, 8, 1)
        step = (np.linalg.pinv(_by_pose(camera, corners)) @ residuals)[:, :, 0]
        turn = Rotation.from_rotvec(step[:, 3:]).as_matrix()
        R, t = turn @ R, np.einsum("nij,nj->ni", turn, t) + step[:, :3]
    return R, t


def _by_pose(camera: CameraModel, corners: Array) -> Array:
    """Derivative (n, 8, 6) of pixels by left perturbations of the poses."""
    D = camera.linearize(corners)[1]
    return np.concatenate([D, -D @ hat(corners)], axis=2).reshape(-1, 8, 6)


def _by_intrinsics(R: Array, t: Array, camera: CameraModel, size_mm: float) -> Array:
    """Left tangents (n, 6, 6) by which tags are seen elsewhere per fx, fy, cx, cy, k1, k2."""
    corners = _corners(R, t, size_mm)
    J_camera = camera.intrinsics_jacobian(corners).reshape(-1, 8, 6)
    return np.asarray(-np.linalg.pinv(_by_pose(camera, corners)) @ J_camera)
