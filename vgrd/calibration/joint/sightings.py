"""What pictures show, as arrays: tags, the flange that tag A was seen on, and holes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.joint.camera_corrections import CameraCorrections
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel

Indices = NDArray[np.intp]


def renumbered(spin: Indices, weights: Array) -> Indices:
    """Numbers (n,) among the spins whose weight is not 0; -1 stays."""
    return np.where(spin >= 0, np.append(np.cumsum(weights > 0) - 1, 0)[spin], -1)


@dataclass(frozen=True, slots=True, eq=False)
class Tags:
    """n sightings of a tag: rotations (n, 3, 3), translations (n, 3), whiteners (n, 6, 6).

    J_refined: (n, 6, e), left tangent by which they are seen elsewhere as tag sizes and intrinsics
    are refined; None where they are held.
    """

    rotations: Array
    translations: Array
    sqrt_informations: Array
    J_refined: Array | None = None

    def __len__(self) -> int:
        return len(self.rotations)

    def subset(self, chosen: Indices) -> "Tags":
        """Those with the given indices."""
        J_refined = None if self.J_refined is None else self.J_refined[chosen]
        return Tags(
            self.rotations[chosen],
            self.translations[chosen],
            self.sqrt_informations[chosen],
            J_refined,
        )

    def with_tangents(self, J_refined: Array, curvatures: Array) -> "Tags":
        """The same with other derivatives, and with noise, one times curvatures (n, 6), of what these leave out."""
        if not curvatures.any():
            return replace(self, J_refined=J_refined)
        W = self.sqrt_informations
        u = W @ curvatures[:, :, None]
        squares = u.transpose(0, 2, 1) @ u
        # (I + u u^T)^(-1/2) W, of which the square is the inverse of what W stands for and this noise.
        root = np.sqrt(1 + squares)
        W = W - u @ (u.transpose(0, 2, 1) @ W) / (root * (1 + root))
        return replace(self, J_refined=J_refined, sqrt_informations=W)

    def weighted(self, weights: Array) -> "Tags":
        """Variances divided by weights (n,); those of weight 0 are left out."""
        subset = self.subset(np.flatnonzero(weights))
        root = np.sqrt(weights[weights > 0])[:, None, None]
        return replace(subset, sqrt_informations=root * subset.sqrt_informations)

    def refined(self, corrections: CameraCorrections, size_of: str, values: Array) -> "Tags":
        """As seen with refined tag sizes and intrinsics, values (e,); derivatives by them are left to others."""
        refined = corrections.refine(self.rotations, self.translations, size_of, values)
        sqrt_informations = self.sqrt_informations @ refined.back
        return Tags(refined.rotations, refined.translations, sqrt_informations)

    def poses(self) -> list[Pose]:
        """camera_from_tag of all."""
        return [Pose(R, t) for R, t in zip(self.rotations, self.translations, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Tag A and the flange poses (n, 3, 3), (n, 3) it was seen from; stations: (n,)."""

    tags: Tags
    rotations: Array
    translations: Array
    stations: Indices

    def poses(self) -> list[Pose]:
        """base_from_wrist of all."""
        return [Pose(R, t) for R, t in zip(self.rotations, self.translations, strict=True)]

    def subset(self, chosen: Indices) -> "Looks":
        """Those with the given indices."""
        return Looks(
            self.tags.subset(chosen),
            self.rotations[chosen],
            self.translations[chosen],
            self.stations[chosen],
        )

    def weighted(self, weights: Array) -> "Looks":
        """Variances divided by weights (n,); those of weight 0 are left out."""
        subset = self.subset(np.flatnonzero(weights))
        return replace(subset, tags=self.tags.weighted(weights))


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """h sightings: cad (h, 3), spin (h,) with -1 while touching, pixels (h, 2), sigma_px (h,).

    inexact_of: (h,) as of `JointData`.
    """

    cad: Array
    inexact_of: Indices
    spin: Indices
    pixels: Array
    sigma_px: Array
    camera: CameraModel

    def weighted(self, weights: Array, spins: Array) -> "Holes":
        """Variances divided by weights (h,), 0 leaves one out; spins (s,): which are left."""
        chosen = weights > 0
        sigma_px = self.sigma_px[chosen] / np.sqrt(weights[chosen])
        return Holes(
            self.cad[chosen],
            self.inexact_of[chosen],
            renumbered(self.spin, spins)[chosen],
            self.pixels[chosen],
            sigma_px,
            self.camera,
        )
