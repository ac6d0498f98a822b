"""What a recording holds for the joint estimate, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from vgrd.calibration.joint.camera_corrections import TAG_A, TAG_B, CameraCorrections
from vgrd.calibration.joint.sightings import Holes, Indices, Looks, Tags, renumbered
from vgrd.calibration.touches import TouchSet
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.model import CellFacts, Motion, Recording, Target
from vgrd.model.arm import ArmModel

__all__ = [
    "CameraPlaces",
    "EvidenceKind",
    "HolePixel",
    "Holes",
    "Indices",
    "JointData",
    "Looks",
    "Tags",
    "Turntable",
    "inexact_of",
    "points_of",
    "renumbered",
    "target_of",
]


class EvidenceKind(StrEnum):
    """Kinds of evidence, in the order of their rows."""

    HAND_EYE = "tag A"
    TOUCHES = "touches"
    POINTS = "fixed point"
    REFERENCE = "tag B while touching"
    SPINS = "tag B in spins"
    HOLES = "holes"
    TURNTABLE = "turntable in CAD"
    CAD = "targets in CAD"
    REFINED = "print and intrinsics"


SAMPLED: Mapping[EvidenceKind, int] = MappingProxyType(
    {
        EvidenceKind.HAND_EYE: 6,
        EvidenceKind.TOUCHES: 3,
        EvidenceKind.POINTS: 3,
        EvidenceKind.REFERENCE: 6,
        EvidenceKind.SPINS: 6,
        EvidenceKind.HOLES: 2,
    }
)
"""Kinds that are measured sample by sample, and the rows of one sample."""


@dataclass(frozen=True, slots=True, eq=False)
class Turntable:
    """How well CAD knows the axis of turning, in the object's frame.

    center_sigma_mm: of `ObjectSpec.center_in_object`, across the axis. axis_in_object: (3,) unit
    vector, None where CAD does not tell; axis_sigma_rad: its tilt about each direction.
    """

    center_sigma_mm: float = 0.2  # as `object.center_sigma_mm` of the cell file
    axis_in_object: Array | None = None
    axis_sigma_rad: float = 5e-4  # a guess: 0.04 mm at a radius of 80 mm


@dataclass(frozen=True, slots=True, eq=False)
class HolePixel:
    """A hole of the object in a picture.

    pixel: (2,), sigma_px of each coordinate; spin: index of the picture among the spins, None
    where the object stood as it was touched. touch: index of the touch that shows the object alike,
    which only a camera that moved asks for; None: where it stands in the end.
    """

    target: str
    pixel: Array
    sigma_px: float
    spin: int | None = None
    touch: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlaces:
    """Where the camera stood: pictures in the order of time, a new place from each stamp of `first_s` on.

    reference: number of the place that every pose of the camera is stated for, counted from the first.
    The camera is displaced in the others, which are numbered in their order.
    """

    first_s: tuple[float, ...] = ()
    reference: int = 0

    @property
    def displaced(self) -> int:
        """How many places there are beside the reference."""
        return len(self.first_s)

    def of(self, stamps_s: Array) -> Indices:
        """(n,): displaced place of the pictures with these stamps, -1 for the reference."""
        number = np.searchsorted(self.first_s, stamps_s, side="right")
        displaced = np.where(number > self.reference, number - 1, number)
        return np.where(number == self.reference, -1, displaced)


@dataclass(frozen=True, slots=True, eq=False)
class JointData:
    """All evidence, samples in an order that does not depend on the recording's.

    Stations are where the arm stood, one per rest: flange_at (s, 3) of all samples; cad: (m, 3), one per touch.
    bare: names of the touched targets without CAD; bare_of: (m,) which of them each touch is of, -1 for
    one in CAD. inexact: names of the targets in CAD, which the part has elsewhere by cad_sigma_mm times
    cad_factors (c,); inexact_of: (m,) the same for these; none where CAD is exact. touch_spins: (m,) number of
    the spin that shows the object as it was touched, -1 where it stood as in most touches.
    center: of the turntable in CAD, or None. names: of the samples of every kind. corrections: what is
    refined of tag sizes and intrinsics; refined_values: (e,) values of it at which tags are seen here.
    stamps_s: (n,) of the pictures of the samples, by kind, inf where there is none; places: of the camera.
    """

    recording: Recording
    looks: Looks
    touches: TouchSet
    cad: Array
    bare: tuple[str, ...]
    bare_of: Indices
    inexact: tuple[str, ...]
    inexact_of: Indices
    touch_stations: Indices
    touch_spins: Indices
    points: TouchSet
    point_stations: Indices
    reference: Tags
    spins: Tags
    holes: Holes
    center: Array | None
    turntable: Turntable
    flange_at: Array
    arm: ArmModel
    names: Mapping[EvidenceKind, tuple[str, ...]]
    stamps_s: Mapping[EvidenceKind, Array]
    corrections: CameraCorrections
    cad_sigma_mm: float
    cad_factors: Array
    refined_values: Array = field(default_factory=lambda: np.zeros(0))
    places: CameraPlaces = field(default_factory=CameraPlaces)

    @property
    def motion(self) -> Motion:
        """How the object can move."""
        return self.recording.facts.object.motion

    def places_of(self, kind: EvidenceKind) -> Indices | None:
        """Places of the camera in the pictures of a kind, as `CameraPlaces.of`."""
        return self.places.of(self.stamps_s[kind]) if self.places.displaced else None

    def row_stamps(self) -> Array:
        """(k,): stamp of the picture that each row is of, inf for one of none; the rows of samples."""
        return np.concatenate(
            [np.repeat(self.stamps_s[kind], width) for kind, width in SAMPLED.items()]
        )

    def row_places(self) -> Indices:
        """(k,): the same for the place of the camera."""
        return self.places.of(self.row_stamps())

    @property
    def axis(self) -> Array | None:
        """Axis of turning in CAD, where it counts."""
        turns = self.motion is not Motion.FREE and len(self.spins) > 0
        return self.turntable.axis_in_object if turns else None

    @property
    def counts(self) -> Mapping[EvidenceKind, int]:
        """Rows of every kind, in their order."""
        return {
            EvidenceKind.HAND_EYE: 6 * len(self.looks.tags),
            EvidenceKind.TOUCHES: 3 * len(self.touches),
            EvidenceKind.POINTS: 3 * len(self.points),
            EvidenceKind.REFERENCE: 6 * len(self.reference),
            EvidenceKind.SPINS: 6 * len(self.spins),
            EvidenceKind.HOLES: 2 * len(self.holes.cad),
            EvidenceKind.TURNTABLE: 2 * (self.center is not None) + 2 * (self.axis is not None),
            EvidenceKind.CAD: 3 * len(self.inexact),
            EvidenceKind.REFINED: self.corrections.count,
        }

    def rows_of(self, link: EvidenceKind) -> slice:
        """Where the rows of one kind stand."""
        kinds = list(self.counts)
        start = sum(self.counts[kind] for kind in kinds[: kinds.index(link)])
        return slice(start, start + self.counts[link])

    @property
    def arm_rows(self) -> int:
        """How many rows, the first ones, feel the errors of the arm."""
        return int(self.rows_of(EvidenceKind.POINTS).stop)

    def measured(self) -> int:
        """Rows that measured something (a sigma may be infinite)."""
        blind = 3 * (len(self.touches) + len(self.points))
        equations = self.touches.equations() + self.points.equations()
        return sum(self.counts.values()) - blind + equations

    def weighted(self, weights: Mapping[EvidenceKind, Array]) -> "JointData":
        """Variances divided by the weights of the samples of every kind; 0 leaves one out.

        A hole seen in a spin goes with it, and so does a touch of the turned object.
        """
        weights = self.in_use(weights)
        touched, pointed, spun, holes = (
            weights[kind]
            for kind in (
                EvidenceKind.TOUCHES,
                EvidenceKind.POINTS,
                EvidenceKind.SPINS,
                EvidenceKind.HOLES,
            )
        )
        return replace(
            self,
            looks=self.looks.weighted(weights[EvidenceKind.HAND_EYE]),
            touches=self.touches.weighted(touched).subset(np.flatnonzero(touched)),
            cad=self.cad[touched > 0],
            bare_of=self.bare_of[touched > 0],
            inexact_of=self.inexact_of[touched > 0],
            touch_stations=self.touch_stations[touched > 0],
            touch_spins=renumbered(self.touch_spins, spun)[touched > 0],
            points=self.points.weighted(pointed).subset(np.flatnonzero(pointed)),
            point_stations=self.point_stations[pointed > 0],
            reference=self.reference.weighted(weights[EvidenceKind.REFERENCE]),
            spins=self.spins.weighted(spun),
            holes=self.holes.weighted(holes, spun),
            names={
                link: tuple(name for name, w in zip(names, weights[link], strict=True) if w > 0)
                for link, names in self.names.items()
            },
            stamps_s={link: s[weights[link] > 0] for link, s in self.stamps_s.items()},
        )

    def in_use(self, weights: Mapping[EvidenceKind, Array]) -> Mapping[EvidenceKind, Array]:
        """The weights as they count: what a spin shows goes with it."""
        spun = np.append(weights[EvidenceKind.SPINS], 1) > 0
        return {
            **weights,
            EvidenceKind.TOUCHES: weights[EvidenceKind.TOUCHES] * spun[self.touch_spins],
            EvidenceKind.HOLES: weights[EvidenceKind.HOLES] * spun[self.holes.spin],
        }

    def refined(self, values: Array) -> "JointData":
        """The same, gathered with nothing refined, as seen with refined values (e,), without derivatives."""
        if not len(values):
            return self
        corrections, values = self.corrections, self.corrections.applied(values)
        tags = self.looks.tags.refined(corrections, TAG_A, values)
        return replace(
            self,
            looks=replace(self.looks, tags=tags),
            reference=self.reference.refined(corrections, TAG_B, values),
            spins=self.spins.refined(corrections, TAG_B, values),
            holes=replace(self.holes, camera=corrections.camera_at(values)),
            refined_values=values,
        )

    def with_tangents(self, predicted: Mapping[EvidenceKind, tuple[Array, Array]]) -> "JointData":
        """With derivatives by the refined numbers at predicted poses (n, 3, 3), (n, 3) of the tags.

        At measured ones their noise would be in derivative and residual alike, which biases a stretch.
        """

        def seen(tags: Tags, kind: EvidenceKind, name: str) -> Tags:
            R, t = predicted[kind]
            tangents = self.corrections.tangents(R, t, name, self.refined_values)
            return tags.with_tangents(tangents, self.corrections.curvatures(R, t, name, tangents))

        return replace(
            self,
            looks=replace(self.looks, tags=seen(self.looks.tags, EvidenceKind.HAND_EYE, TAG_A)),
            reference=seen(self.reference, EvidenceKind.REFERENCE, TAG_B),
            spins=seen(self.spins, EvidenceKind.SPINS, TAG_B),
        )


def inexact_of(names: Sequence[str], inexact: Sequence[str]) -> Indices:
    """(n,): which of the inexact targets each one of these is, -1 for none of them."""
    return np.array([inexact.index(n) if n in inexact else -1 for n in names], dtype=np.intp)


def points_of(targets: Sequence[Target], bare: Sequence[str]) -> tuple[Array, Indices]:
    """CAD (m, 3) of touched targets, 0 where there is none, and (m,) which of the bare ones each is, or -1."""
    points = [target.point_in_object for target in targets]
    numbers = [
        bare.index(target.name) if target.point_in_object is None else -1 for target in targets
    ]
    cad = np.array([np.zeros(3) if point is None else point for point in points])
    return cad.reshape(-1, 3), np.array(numbers, dtype=np.intp)


def target_of(facts: CellFacts, name: str) -> Target:
    """Target of that name; InputError with the known names."""
    targets = facts.object.targets
    if name not in targets:
        raise InputError(
            f"the object has no target {name!r}; there are: {', '.join(sorted(targets))}"
        )
    return targets[name]
