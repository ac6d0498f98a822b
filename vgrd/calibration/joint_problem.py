"""What a recording holds for the joint estimate, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.touches import TouchSet, touch_set
from vgrd.errors import InputError, TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import whitener
from vgrd.model import Motion, Mount, Observation, Recording, TagObservation, Target, Touch

Indices = NDArray[np.intp]

_REPEATABILITY = 0.3
_STILL = -1


class Link(StrEnum):
    """Kinds of evidence, in the order of their rows."""

    HAND_EYE = "tag A"
    TOUCHES = "touches"
    POINTS = "fixed point"
    REFERENCE = "tag B while touching"
    SPINS = "tag B in spins"
    HOLES = "holes"
    TURNTABLE = "turntable in CAD"


@dataclass(frozen=True, slots=True)
class ArmModel:
    """Errors of the arm: a new draw at every stand, and a smooth field over the workspace.

    sigma_mm, field_mm: per axis, of the flange; turns are rad_per_mm times as large. The field's
    correlation over a distance d is exp(-d^2 / 2 length_mm^2).
    """

    sigma_mm: float = 0.0
    field_mm: float = 0.0
    length_mm: float = 200.0
    rad_per_mm: float = 2e-3

    @classmethod
    def of(cls, robot_sigma_mm: float) -> "ArmModel":
        """An arm of which only one figure is known: repeatability is the lesser part of it."""
        repeats = _REPEATABILITY * robot_sigma_mm
        return cls(repeats, float(np.sqrt(robot_sigma_mm**2 - repeats**2)))

    @property
    def is_exact(self) -> bool:
        """True when the arm is taken to be where it reports."""
        return self.sigma_mm == 0 and self.field_mm == 0

    def field(self, a: Array, b: Array) -> Array:
        """mm^2 (n, m): covariance per axis between flange positions a (n, 3) and b (m, 3)."""
        squared = np.sum((a[:, None] - b[None]) ** 2, axis=2)
        return np.asarray(self.field_mm**2 * np.exp(-0.5 * squared / self.length_mm**2))

    def prior(self, flange_at: Array) -> Array:
        """mm^2 (s, s): covariance per axis of all stands, at flange positions (s, 3)."""
        own = self.sigma_mm**2 * np.eye(len(flange_at))
        return np.asarray(own + self.field(flange_at, flange_at))

    def scales(self) -> Array:
        """(6,): what 1 mm of error means for a deviation (mm, rad) of the flange."""
        return np.array([1.0] * 3 + [self.rad_per_mm] * 3)


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
    """n sightings of a tag: rotations (n, 3, 3), translations (n, 3), whiteners (n, 6, 6)."""

    rotations: Array
    translations: Array
    whiteners: Array

    def __len__(self) -> int:
        return len(self.rotations)

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
        tags = self.tags
        return Looks(
            Tags(tags.rotations[chosen], tags.translations[chosen], tags.whiteners[chosen]),
            self.rotations[chosen],
            self.translations[chosen],
            self.stands[chosen],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """h sightings: cad (h, 3), spin (h,) with -1 while touching, pixels (h, 2), sigma_px (h,)."""

    cad: Array
    spin: Indices
    pixels: Array
    sigma_px: Array
    camera: CameraModel


@dataclass(frozen=True, slots=True, eq=False)
class JointData:
    """All evidence. Stands are where the arm stood, one per sample: flange_at (s, 3); cad: (m, 3), one per touch.

    center: of the turntable in CAD, or None.
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


def gather(
    recording: Recording,
    sightings: Sequence[Sighting] = (),
    arm: ArmModel | None = None,
    turntable: Turntable | None = None,
) -> JointData:
    """Bring all samples into arrays; verifications stay out.

    Raises InputError (eye-in-hand, unknown target) or TooFewObservations with what is missing.
    """
    facts, touches = recording.facts, recording.touches
    if facts.mount is not Mount.EYE_TO_HAND:
        raise InputError("the joint estimate needs a camera that stands still (eye-to-hand)")
    if not touches:
        raise TooFewObservations("nothing was touched: touch at least 3 targets of the object")
    m, k = len(touches), len(recording.points)
    samples: list[Touch | Observation] = [*touches, *recording.points]
    samples += [*recording.looks, *recording.spins]
    references = [touch.observation for touch in touches]
    motion = facts.object.motion
    free = motion is Motion.FREE
    spins = _tags([] if free else [seen.tag_b for seen in recording.spins])
    return JointData(
        motion=motion,
        looks=_looks(recording),
        touches=_touch_set(recording, touches),
        cad=np.array([target_of(recording, t.target).point_in_object for t in touches]),
        touch_stands=np.arange(m),
        points=_touch_set(recording, recording.points),
        point_stands=np.arange(m, m + k),
        reference=_tags([None if seen is None else seen.tag_b for seen in references]),
        spins=spins,
        holes=_holes(recording, [s for s in sightings if s.spin is None or not free]),
        center=_center(recording) if len(spins) else None,
        turntable=turntable or Turntable(),
        flange_at=np.array([sample.base_from_wrist.translation for sample in samples]),
        arm=arm or ArmModel.of(facts.robot_sigma_mm),
    )


def target_of(recording: Recording, name: str) -> Target:
    """Target of that name; InputError with the known names."""
    targets = recording.facts.object.targets
    if name not in targets:
        raise InputError(f"target {name!r} is not in CAD; there are: {', '.join(sorted(targets))}")
    return targets[name]


def _center(recording: Recording) -> Array | None:
    spec = recording.facts.object
    return spec.center_in_object if spec.motion is Motion.TURNTABLE else None


def _looks(recording: Recording) -> Looks:
    """Every picture of tag A; one taken while touching belongs to the stand of the touch."""
    touches = (*recording.touches, *recording.points)
    seen = [*(touch.observation for touch in touches), *recording.looks, *recording.spins]
    kept = [(i, s) for i, s in enumerate(seen) if s is not None and s.tag_a is not None]
    if not kept:
        raise TooFewObservations(
            "tag A was never seen, so the camera is not tied to the robot: bring it into view"
        )
    poses = [s.base_from_wrist for _, s in kept]
    return Looks(
        _tags([s.tag_a for _, s in kept]),
        np.array([pose.rotation for pose in poses]),
        np.array([pose.translation for pose in poses]),
        np.array([i for i, _ in kept], dtype=np.intp),
    )


def _tags(observations: Sequence[TagObservation | None]) -> Tags:
    seen = [tag for tag in observations if tag is not None]
    covariances = np.array([tag.covariance for tag in seen]).reshape(-1, 6, 6)
    return Tags(
        np.array([tag.camera_from_tag.rotation for tag in seen]).reshape(-1, 3, 3),
        np.array([tag.camera_from_tag.translation for tag in seen]).reshape(-1, 3),
        whitener(covariances),
    )


def _touch_set(recording: Recording, touches: Sequence[Touch]) -> TouchSet:
    return touch_set(
        [touch.base_from_wrist for touch in touches],
        recording.facts.tool.axis_in_wrist,
        [touch.lateral_sigma_mm for touch in touches],
        [touch.axial_sigma_mm for touch in touches],
    )


def _holes(recording: Recording, sightings: Sequence[Sighting]) -> Holes:
    facts = recording.facts
    seen = [i for i, spin in enumerate(recording.spins) if spin.tag_b is not None]
    cad, spins = [], []
    for sighting in sightings:
        cad.append(target_of(recording, sighting.target).point_in_object)
        if sighting.spin is not None and sighting.spin not in seen:
            raise InputError(f"hole {sighting.target!r}: tag B is not in spin {sighting.spin + 1}")
        spins.append(_STILL if sighting.spin is None else seen.index(sighting.spin))
    return Holes(
        np.array(cad).reshape(-1, 3),
        np.array(spins, dtype=np.intp),
        np.array([sighting.pixel for sighting in sightings]).reshape(-1, 2),
        np.array([sighting.sigma_px for sighting in sightings], dtype=np.float64),
        CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px),
    )
