"""What a recording holds for the joint estimate, as arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.joint.camera_corrections import TAG_A, TAG_B, Optics
from vgrd.calibration.touches.touch_set import TouchSet
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import CellFacts, Motion, Target
from vgrd.model.estimate import ArmModel

__all__ = [
    "Holes",
    "Indices",
    "JointData",
    "Link",
    "Looks",
    "Sighting",
    "Tags",
    "Turntable",
    "target_of",
]

Indices = NDArray[np.intp]


class Link(StrEnum):
    """Kinds of evidence, in the order of their rows."""

    HAND_EYE = "tag A"
    TOUCHES = "touches"
    POINTS = "fixed point"
    REFERENCE = "tag B while touching"
    SPINS = "tag B in spins"
    HOLES = "holes"
    TURNTABLE = "turntable in CAD"
    REFINED = "print and intrinsics"


SAMPLED: Mapping[Link, int] = MappingProxyType(
    {
        Link.HAND_EYE: 6,
        Link.TOUCHES: 3,
        Link.POINTS: 3,
        Link.REFERENCE: 6,
        Link.SPINS: 6,
        Link.HOLES: 2,
    }
)
"""Kinds that are measured sample by sample, and the rows of one sample."""


@dataclass(frozen=True, slots=True, eq=False)
class Turntable:
    """How well CAD knows the axis of turning, in the object's frame.

    center_sigma_mm: of `ObjectSpec.center_in_object`, across the axis. axis_in_object: (3,) unit
    vector, None where CAD does not tell; axis_sigma_rad: its tilt about each direction.
    """

    center_sigma_mm: float = 0.02
    axis_in_object: Array | None = None
    axis_sigma_rad: float = 5e-4


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A hole of the object in a picture.

    pixel: (2,), sigma_px of each coordinate; spin: index of the picture among the spins, None
    where the object stood as it was touched.
    """

    target: str
    pixel: Array
    sigma_px: float
    spin: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Tags:
    """n sightings of a tag: rotations (n, 3, 3), translations (n, 3), whiteners (n, 6, 6).

    by_refined: (n, 6, e), left tangent by which they are seen elsewhere as tag sizes and intrinsics
    are refined; None where they are held.
    """

    rotations: Array
    translations: Array
    whiteners: Array
    by_refined: Array | None = None

    def __len__(self) -> int:
        return len(self.rotations)

    def some(self, chosen: Indices) -> "Tags":
        """Those with the given indices."""
        by = None if self.by_refined is None else self.by_refined[chosen]
        return Tags(self.rotations[chosen], self.translations[chosen], self.whiteners[chosen], by)

    def weighted(self, weights: Array) -> "Tags":
        """Variances divided by weights (n,); those of weight 0 are left out."""
        some = self.some(np.flatnonzero(weights))
        root = np.sqrt(weights[weights > 0])[:, None, None]
        return replace(some, whiteners=root * some.whiteners)

    def refined(self, optics: Optics, size_of: str, values: Array) -> "Tags":
        """As seen with refined tag sizes and intrinsics, values (e,)."""
        seen = optics.seen(self.rotations, self.translations, size_of, values)
        whiteners = self.whiteners @ np.linalg.inv(seen.shifts)
        return Tags(seen.rotations, seen.translations, whiteners, seen.by_refined)

    def poses(self) -> list[Pose]:
        """camera_from_tag of all."""
        return [Pose(R, t) for R, t in zip(self.rotations, self.translations, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Tag A and the flange poses (n, 3, 3), (n, 3) it was seen from; stands: (n,)."""

    tags: Tags
    rotations: Array
    translations: Array
    stands: Indices

    def poses(self) -> list[Pose]:
        """base_from_wrist of all."""
        return [Pose(R, t) for R, t in zip(self.rotations, self.translations, strict=True)]

    def some(self, chosen: Indices) -> "Looks":
        """Those with the given indices."""
        return Looks(
            self.tags.some(chosen),
            self.rotations[chosen],
            self.translations[chosen],
            self.stands[chosen],
        )

    def weighted(self, weights: Array) -> "Looks":
        """Variances divided by weights (n,); those of weight 0 are left out."""
        some = self.some(np.flatnonzero(weights))
        return replace(some, tags=self.tags.weighted(weights))


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """h sightings: cad (h, 3), spin (h,) with -1 while touching, pixels (h, 2), sigma_px (h,)."""

    cad: Array
    spin: Indices
    pixels: Array
    sigma_px: Array
    camera: CameraModel

    def weighted(self, weights: Array, spins: Array) -> "Holes":
        """Variances divided by weights (h,), 0 leaves one out; spins (s,): which are left."""
        kept = weights > 0
        renumbered = np.where(
            self.spin >= 0, np.append(np.cumsum(spins > 0) - 1, 0)[self.spin], -1
        )
        sigma_px = self.sigma_px[kept] / np.sqrt(weights[kept])
        return Holes(self.cad[kept], renumbered[kept], self.pixels[kept], sigma_px, self.camera)


@dataclass(frozen=True, slots=True, eq=False)
class JointData:
    """All evidence, samples in an order that does not depend on the recording's.

    Stands are where the arm stood, one per sample: flange_at (s, 3); cad: (m, 3), one per touch.
    center: of the turntable in CAD, or None. names: of the samples of every kind. optics: what is
    refined of tag sizes and intrinsics; refined_at: (e,) values of it at which tags are seen here.
    """

    motion: Motion
    looks: Looks
    touches: TouchSet
    cad: Array
    touch_stands: Indices
    points: TouchSet
    point_stands: Indices
    reference: Tags
    spins: Tags
    holes: Holes
    center: Array | None
    turntable: Turntable
    flange_at: Array
    arm: ArmModel
    names: Mapping[Link, tuple[str, ...]]
    optics: Optics
    refined_at: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def axis(self) -> Array | None:
        """Axis of turning in CAD, where it counts."""
        turns = self.motion is not Motion.FREE and len(self.spins) > 0
        return self.turntable.axis_in_object if turns else None

    @property
    def counts(self) -> Mapping[Link, int]:
        """Rows of every kind, in their order."""
        return {
            Link.HAND_EYE: 6 * len(self.looks.tags),
            Link.TOUCHES: 3 * len(self.touches),
            Link.POINTS: 3 * len(self.points),
            Link.REFERENCE: 6 * len(self.reference),
            Link.SPINS: 6 * len(self.spins),
            Link.HOLES: 2 * len(self.holes.cad),
            Link.TURNTABLE: 2 * (self.center is not None) + 2 * (self.axis is not None),
            Link.REFINED: self.optics.count,
        }

    def rows_of(self, link: Link) -> slice:
        """Where the rows of one kind stand."""
        kinds = list(self.counts)
        start = sum(self.counts[kind] for kind in kinds[: kinds.index(link)])
        return slice(start, start + self.counts[link])

    @property
    def arm_rows(self) -> int:
        """How many rows, the first ones, feel the errors of the arm."""
        return int(self.rows_of(Link.POINTS).stop)

    def measured(self) -> int:
        """Rows that measured something (a sigma may be infinite)."""
        blind = 3 * (len(self.touches) + len(self.points))
        seen = self.touches.equations() + self.points.equations()
        return sum(self.counts.values()) - blind + seen

    def weighted(self, weights: Mapping[Link, Array]) -> "JointData":
        """Variances divided by the weights of the samples of every kind; 0 leaves one out.

        A hole seen in a spin goes with it.
        """
        touched, pointed, spun = (weights[k] for k in (Link.TOUCHES, Link.POINTS, Link.SPINS))
        holes = weights[Link.HOLES] * (np.append(spun, 1)[self.holes.spin] > 0)
        weights = {**weights, Link.HOLES: holes}
        return replace(
            self,
            looks=self.looks.weighted(weights[Link.HAND_EYE]),
            touches=self.touches.weighted(touched).some(np.flatnonzero(touched)),
            cad=self.cad[touched > 0],
            touch_stands=self.touch_stands[touched > 0],
            points=self.points.weighted(pointed).some(np.flatnonzero(pointed)),
            point_stands=self.point_stands[pointed > 0],
            reference=self.reference.weighted(weights[Link.REFERENCE]),
            spins=self.spins.weighted(spun),
            holes=self.holes.weighted(holes, spun),
            names={
                link: tuple(name for name, w in zip(names, weights[link], strict=True) if w > 0)
                for link, names in self.names.items()
            },
        )

    def refined(self, values: Array) -> "JointData":
        """The same, gathered with nothing refined, as seen with refined values (e,)."""
        if not len(values):
            return self
        optics = self.optics
        seen = self.looks.tags.refined(optics, TAG_A, values)
        return replace(
            self,
            looks=replace(self.looks, tags=seen),
            reference=self.reference.refined(optics, TAG_B, values),
            spins=self.spins.refined(optics, TAG_B, values),
            holes=replace(self.holes, camera=optics.camera_at(values)),
            refined_at=values,
        )


def target_of(facts: CellFacts, name: str) -> Target:
    """Target of that name; InputError with the known names."""
    targets = facts.object.targets
    if name not in targets:
        raise InputError(f"target {name!r} is not in CAD; there are: {', '.join(sorted(targets))}")
    return targets[name]
