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
from vgrd.model import CellFacts, TagObservation, frozen_array

TAG_A, TAG_B = "size of tag A", "size of tag B"
STRETCH_A, STRETCH_B = "stretch of tag A", "stretch of tag B"
FOCAL, CENTER_X, CENTER_Y, K1 = "focal length", "cx", "cy", "k1"

PRINTED = (TAG_A, TAG_B, STRETCH_A, STRETCH_B)

_STRETCHES: Mapping[str, str] = MappingProxyType({TAG_A: STRETCH_A, TAG_B: STRETCH_B})
"""By which a tag is wider than high: half of it more in x, half of it less in y."""

_SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
_FRONTAL_RAD = (
    0.02  # a tag seen under less is seen from the front: perspective alone tells its tilt
)
_TURNS = 5  # fixed-point steps; each leaves a stretch over an angle of sight, so a tenth or less
_RESECTIONS = 4  # Gauss-Newton steps from a pose that is right to a pixel
_INTRINSIC: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {FOCAL: (0, 1), CENTER_X: (2,), CENTER_Y: (3,), K1: (4,)}
)
"""Which of `CameraModel.intrinsics` each one moves; fx and fy in their ratio."""


@dataclass(frozen=True, slots=True)
class PriorSigmas:
    """Sigma of what is known beforehand of the numbers to refine; None holds one at its value.

    tag_a_mm, tag_b_mm: of the printed edge; stretch_a_mm, stretch_b_mm: of width minus
    height; focal_px, center_px (both cx and cy), k1.
    """

    tag_a_mm: float | None = None
    tag_b_mm: float | None = None
    focal_px: float | None = None
    center_px: float | None = None
    k1: float | None = None
    stretch_a_mm: float | None = None
    stretch_b_mm: float | None = None

    @classmethod
    def of_print(cls, facts: CellFacts) -> "PriorSigmas":
        """What the cell says of the printed edges, along and across the paper each."""
        a_mm, b_mm = facts.tag_a_sigma_mm, facts.tag_b_sigma_mm
        half, twice = np.sqrt(0.5), np.sqrt(2.0)  # of a mean of two, and of a difference
        return cls(
            tag_a_mm=half * a_mm if facts.tag_a else None,
            tag_b_mm=half * b_mm,
            stretch_a_mm=twice * a_mm if facts.tag_a else None,
            stretch_b_mm=twice * b_mm,
        )

    @property
    def without_stretches(self) -> "PriorSigmas":
        """The same with square tags."""
        return replace(self, stretch_a_mm=None, stretch_b_mm=None)

    def sigmas(self) -> dict[str, float]:
        """Of what is refined, by name."""
        every = {
            TAG_A: self.tag_a_mm,
            TAG_B: self.tag_b_mm,
            FOCAL: self.focal_px,
            CENTER_X: self.center_px,
            CENTER_Y: self.center_px,
            K1: self.k1,
            STRETCH_A: self.stretch_a_mm,
            STRETCH_B: self.stretch_b_mm,
        }
        return {name: sigma for name, sigma in every.items() if sigma}


@dataclass(frozen=True, slots=True, eq=False)
class RefinedTags:
    """n tags as refined: rotations (n, 3, 3), translations (n, 3).

    back: (n, 6, 6), tangents as refined to measured ones.
    """

    rotations: Array
    translations: Array
    back: Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraCorrections:
    """camera: as assumed; sizes_mm: by name of the tag; sigmas: of what is refined, by name."""

    camera: CameraModel
    sizes_mm: Mapping[str, float]
    sigmas: Mapping[str, float]

    @classmethod
    def of(cls, facts: CellFacts, refinement: PriorSigmas | None) -> "CameraCorrections":
        """What a cell says, and what is to be refined of it."""
        return cls.with_sigmas(facts, (refinement or PriorSigmas()).sigmas())

    @classmethod
    def with_sigmas(cls, facts: CellFacts, sigmas: Mapping[str, float]) -> "CameraCorrections":
        """The same, by the names of what is refined."""
        camera = CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px)
        sizes = {TAG_A: (facts.tag_a or facts.tag_b).size_mm, TAG_B: facts.tag_b.size_mm}
        return cls(camera, sizes, sigmas)

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

    def value(self, name: str, values: Array) -> float:
        """A refined number, in its unit, beyond what was assumed; 0 where it is held."""
        if name not in self.sigmas:
            return 0.0
        return self.sigmas[name] * float(values[list(self.sigmas).index(name)])

    def size_mm(self, tag: str, values: Array) -> float:
        """Refined edge of TAG_A or TAG_B."""
        return self.sizes_mm[tag] + self.value(tag, values)

    def applied(self, values: Array) -> Array:
        """(e,): the values that `refine` applies; stretches count by their tangents at 0 alone.

        A tag that is seen from the front turns by much for a little stretch, and its noise with it: moved
        about a stretch that is not near the true one, residuals would shrink without being right.
        """
        return np.where([name in _STRETCHES.values() for name in self.sigmas], 0.0, values)

    def refine(
        self, rotations: Array, translations: Array, tag: str, values: Array
    ) -> RefinedTags:
        """Poses (n, 3, 3), (n, 3) of TAG_A or TAG_B as measured, with refined numbers (e,) as `applied`."""
        nominal_mm, size_mm = self.sizes_mm[tag], self.size_mm(tag, values)
        R, t = rotations, translations
        if self._of_camera():
            pixels = self.camera.project(_corners(R, t, nominal_mm))
            R, t = _resected(R, t, pixels, self.camera_at(values), nominal_mm)
        t = t * (size_mm / nominal_mm)
        turn = rotations @ np.swapaxes(R, 1, 2)
        back = translations - np.einsum("nij,nj->ni", turn, t)
        return RefinedTags(R, t, adjoints(turn, back))

    def measured(self, pose: Pose, tag: str, values: Array) -> Pose:
        """The other way round: a refined camera_from_tag as a detector that trusts the cell file measures it."""
        nominal_mm, size_mm = self.sizes_mm[tag], self.size_mm(tag, values)
        R, t = pose.rotation[None], pose.translation[None] * (nominal_mm / size_mm)
        if self._of_camera():
            pixels = self.camera_at(values).project(_corners(R, t, nominal_mm))
            R, t = _resected(R, t, pixels, self.camera, nominal_mm)
        return Pose(R[0], t[0])

    def tangents_as_seen(
        self, rotations: Array, translations: Array, tag: str, values: Array
    ) -> Array:
        """As `tangents`, of poses as measured."""
        refined = self.refine(rotations, translations, tag, values)
        return self.tangents(refined.rotations, refined.translations, tag, values)

    def tangents(self, R: Array, t: Array, tag: str, values: Array) -> Array:
        """Left tangents (n, 6, e) by which refined poses (n, 3, 3), (n, 3) of a tag move per sigma."""
        out, names = np.zeros((len(R), 6, self.count)), list(self.sigmas)
        camera, size_mm, stretch = (
            self.camera_at(values),
            self.size_mm(tag, values),
            _STRETCHES[tag],
        )
        if self._of_camera():
            out += _by_intrinsics(R, t, camera, size_mm) @ self.intrinsics()
        if tag in self.sigmas:
            out[:, :3, names.index(tag)] += t * self.sigmas[tag] / size_mm
        if stretch in self.sigmas:
            by_stretch = _by_stretch(R, t, camera, size_mm)
            out[:, :, names.index(stretch)] += by_stretch * self.sigmas[stretch]
        return out

    def curvatures(self, R: Array, t: Array, tag: str, tangents: Array) -> Array:
        """What tangents (n, 6, e) of a stretch leave out, as it turns a tag: (n, 6), times one noise each.

        Seen under an angle a, a stretch s turns a tag by s / a, and so by the square of that over 2 a less than
        the tangent says. That counts as noise: tags seen from the front tell no tilt then.
        """
        if _STRETCHES[tag] not in self.sigmas:
            return np.zeros((len(R), 6))
        j = tangents[:, :, list(self.sigmas).index(_STRETCHES[tag])]
        sight = t / np.linalg.norm(t, axis=1, keepdims=True)
        angles = np.linalg.norm(np.cross(R[:, :, 2], sight), axis=1)
        shares = np.linalg.norm(j[:, 3:], axis=1) / (2 * np.maximum(angles, _FRONTAL_RAD))
        return np.asarray(shares[:, None] * j)

    def _of_camera(self) -> bool:
        return any(name in _INTRINSIC for name in self.sigmas)


@dataclass(frozen=True, slots=True, eq=False)
class RefinedCorrections:
    """Tag sizes and intrinsics as a calibration refined them; values: (e,) in sigmas."""

    corrections: CameraCorrections
    values: Array

    def corrected(self, tag: TagObservation, name: str) -> TagObservation:
        """TAG_A or TAG_B as seen with the refined numbers but stretches, its noise carried along."""
        if not self.corrections.count:
            return tag
        refined = self._refine(tag, name)
        A = np.linalg.inv(refined.back[0])
        pose = Pose(refined.rotations[0], refined.translations[0])
        curvature = self.corrections.curvatures(
            refined.rotations, refined.translations, name, self.tangent(pose, name)[None]
        )
        own = np.outer(curvature[0], curvature[0])
        covariance = frozen_array(A @ tag.covariance @ A.T + own, 6, 6)
        return replace(tag, camera_from_tag=pose, covariance=covariance)

    @property
    def stretches(self) -> Array:
        """(e,): the values that `corrected` does not apply."""
        return np.asarray(self.values - self.corrections.applied(self.values))

    def measured(self, camera_from_tag: Pose, name: str) -> Pose:
        """The other way round: how a tag that is there is measured by who trusts the cell file.

        Its stretch turns it first, by the tangent where it is then seen, as pictures are judged.
        """
        turned = camera_from_tag
        for _ in range(_TURNS):
            turned = Pose.exp(-self.tangent(turned, name) @ self.stretches) @ camera_from_tag
        return self.corrections.measured(turned, name, self.values)

    def tangent(self, camera_from_tag: Pose, name: str) -> Array:
        """(6, e): left tangent by which a corrected pose moves, per sigma of every number."""
        R, t = camera_from_tag.rotation[None], camera_from_tag.translation[None]
        return np.asarray(self.corrections.tangents(R, t, name, self.values)[0])

    def _refine(self, tag: TagObservation, name: str) -> RefinedTags:
        C = tag.camera_from_tag
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


def _by_stretch(R: Array, t: Array, camera: CameraModel, size_mm: float) -> Array:
    """Left tangents (n, 6) by which tags are seen elsewhere per mm of stretch."""
    corners = _corners(R, t, size_mm)
    shifts = (_SQUARE * np.array([0.5, -0.5, 0.0])) @ np.swapaxes(R, 1, 2)
    D = camera.linearize(corners)[1] @ shifts.reshape(-1, 3, 1)
    P = _by_pose(camera, corners)
    P_T = P.transpose(0, 2, 1)
    return np.asarray(-np.linalg.solve(P_T @ P, P_T @ D.reshape(-1, 8, 1))[:, :, 0])


def _by_intrinsics(R: Array, t: Array, camera: CameraModel, size_mm: float) -> Array:
    """Left tangents (n, 6, 6) by which tags are seen elsewhere per fx, fy, cx, cy, k1, k2."""
    corners = _corners(R, t, size_mm)
    J_camera = camera.intrinsics_jacobian(corners).reshape(-1, 8, 6)
    return np.asarray(-np.linalg.pinv(_by_pose(camera, corners)) @ J_camera)
