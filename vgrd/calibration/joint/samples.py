"""A recording as evidence for the joint estimate, whatever order its samples came in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.camera_corrections import CameraCorrections, PriorSigmas
from vgrd.calibration.joint.problem import (
    CameraPlaces,
    EvidenceKind,
    HolePixel,
    Holes,
    Indices,
    JointData,
    Looks,
    Tags,
    Turntable,
    inexact_of,
    points_of,
    target_of,
)
from vgrd.calibration.touches import TouchSet, touch_set, turned_touches
from vgrd.errors import InputError, TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import sqrt_information
from vgrd.model import (
    CellFacts,
    Motion,
    Mount,
    Observation,
    Recording,
    Stability,
    TagObservation,
    Touch,
)
from vgrd.model.arm import ArmModel

_STILL = -1  # instead of the number of a spin

Named = tuple[str, Observation | None]


def gather(
    recording: Recording,
    sightings: Sequence[HolePixel] = (),
    arm: ArmModel | None = None,
    turntable: Turntable | None = None,
    refine: PriorSigmas | None = None,
    moves_s: Sequence[float] = (),
) -> JointData:
    """Bring all samples into arrays; verifications stay out.

    Samples are sorted by what they are, so that a recording in another order gives the same to the
    last bit; the order of time is that of the stamps. moves_s: stamps of the first pictures after a
    fixed camera was knocked; a movable one may stand elsewhere in every picture. Raises InputError
    (eye-in-hand, unknown target) or TooFewObservations with what is missing.
    """
    facts = recording.facts
    if facts.mount is not Mount.EYE_TO_HAND:
        raise InputError("the joint estimate needs a camera that stands still (eye-to-hand)")
    if not recording.touches:
        raise TooFewObservations("nothing was touched: touch at least 3 targets of the object")
    samples = _Samples.of(recording, sightings)
    pictures, of_a, turned = samples.pictures, samples.of_a, samples.turned
    targets = [target_of(facts, touch.target) for _, touch in samples.touches]
    bare = tuple(sorted({t.name for t in targets if t.point_in_object is None}))
    cad, bare_of = points_of(targets, bare)
    inexact = _inexact(facts)
    stations, m = _stations([picture for _, picture in pictures]), len(samples.touches)
    holes = [hole for _, hole in samples.holes]
    return JointData(
        recording=recording,
        looks=_looks(pictures, of_a, stations),
        touches=_touch_set(recording, [touch for _, touch in samples.touches]),
        cad=cad,
        bare=bare,
        bare_of=bare_of,
        inexact=inexact,
        inexact_of=inexact_of([target.name for target in targets], inexact),
        touch_stations=stations[:m],
        touch_spins=samples.touch_spins(),
        points=_touch_set(recording, [touch for _, touch in samples.points]),
        point_stations=stations[m : m + len(samples.points)],
        reference=_tags([_tag_b(picture) for _, picture in samples.reference]),
        spins=_tags([picture.tag_b for _, picture in turned]),
        holes=_holes(recording, holes, [name for name, _ in turned], inexact),
        center=_center(recording) if turned else None,
        turntable=turntable or Turntable(facts.object.center_sigma_mm),
        flange_at=samples.flange_at(),
        arm=arm or facts.arm,
        names=samples.names(),
        stamps_s=samples.stamps_s(recording),
        corrections=CameraCorrections.of(facts, refine or PriorSigmas.of_print(facts)),
        cad_sigma_mm=facts.object.cad_sigma_mm,
        cad_factors=np.ones(len(inexact)),
        places=_places(facts, [seen for _, seen in pictures if seen is not None], moves_s),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Everything with its name, sorted by what it is.

    reference: pictures of touches that show the object as it stood in most of them; turned: of the turned
    object, spins and touches alike.
    """

    touches: list[tuple[str, Touch]]
    points: list[tuple[str, Touch]]
    looks: list[tuple[str, Observation]]
    spins: list[tuple[str, Observation]]
    reference: list[tuple[str, Observation]]
    turned: list[tuple[str, Observation]]
    holes: list[tuple[str, HolePixel]]

    @classmethod
    def of(cls, recording: Recording, sightings: Sequence[HolePixel]) -> "_Samples":
        motion = recording.facts.object.motion
        touches, points = (
            _touched("touch", recording.touches),
            _touched("point", recording.fixed_points),
        )
        looks, spins = _pictures("look", recording.looks), _pictures("spin", recording.spins)
        of_turned = {
            _touch_name("touch", i, recording.touches[i]) for i in turned_touches(recording)
        }
        shown = [
            (name, touch.observation)
            for name, touch in touches
            if touch.observation is not None and touch.observation.tag_b is not None
        ]
        spun = [] if motion is Motion.FREE else [one for one in spins if one[1].tag_b is not None]
        holes = [s for s in sightings if s.spin is None or motion is not Motion.FREE]
        return cls(
            touches=touches,
            points=points,
            looks=looks,
            spins=spins,
            reference=[one for one in shown if one[0] not in of_turned],
            turned=[*spun, *(one for one in shown if one[0] in of_turned)],
            holes=sorted(
                zip(_hole_names(holes), holes, strict=True), key=lambda one: _hole_key(one[1])
            ),
        )

    @property
    def pictures(self) -> list[Named]:
        """Of every stand of the arm, touches first; None where none was taken."""
        touched = [(name, touch.observation) for name, touch in (*self.touches, *self.points)]
        return [*touched, *self.looks, *self.spins]

    @property
    def of_a(self) -> list[int]:
        """Which of the pictures show tag A."""
        return [
            i for i, (_, s) in enumerate(self.pictures) if s is not None and s.tag_a is not None
        ]

    def touch_spins(self) -> Indices:
        """(m,): number of the picture of the turned object that each touch belongs to, or -1."""
        turns = {name: k for k, (name, _) in enumerate(self.turned)}
        return np.array([turns.get(name, _STILL) for name, _ in self.touches], dtype=np.intp)

    def flange_at(self) -> Array:
        """(s, 3): where the arm stood for each of the pictures."""
        poses = [touch.base_from_wrist for _, touch in (*self.touches, *self.points)]
        poses += [picture.base_from_wrist for _, picture in (*self.looks, *self.spins)]
        return np.array([pose.translation for pose in poses])

    def names(self) -> dict[EvidenceKind, tuple[str, ...]]:
        """By kind of evidence."""
        pictures = self.pictures
        named: Mapping[EvidenceKind, Sequence[tuple[str, object]]] = {
            EvidenceKind.TOUCHES: self.touches,
            EvidenceKind.POINTS: self.points,
            EvidenceKind.REFERENCE: self.reference,
            EvidenceKind.SPINS: self.turned,
            EvidenceKind.HOLES: self.holes,
        }
        of_a = tuple(pictures[i][0] for i in self.of_a)
        return {EvidenceKind.HAND_EYE: of_a} | {
            kind: tuple(name for name, _ in samples) for kind, samples in named.items()
        }

    def stamps_s(self, recording: Recording) -> dict[EvidenceKind, Array]:
        """Of their pictures, by kind of evidence."""
        pictures = self.pictures
        return {
            EvidenceKind.HAND_EYE: _stamps([pictures[i][1] for i in self.of_a]),
            EvidenceKind.TOUCHES: _stamps([touch.observation for _, touch in self.touches]),
            EvidenceKind.POINTS: _stamps([touch.observation for _, touch in self.points]),
            EvidenceKind.REFERENCE: _stamps([picture for _, picture in self.reference]),
            EvidenceKind.SPINS: _stamps([picture for _, picture in self.turned]),
            EvidenceKind.HOLES: _stamps([_picture_of(recording, hole) for _, hole in self.holes]),
        }


def _inexact(facts: CellFacts) -> tuple[str, ...]:
    """Targets that the part may have elsewhere than CAD."""
    spec = facts.object
    known = (name for name, target in spec.targets.items() if target.point_in_object is not None)
    return tuple(sorted(known)) if spec.cad_sigma_mm > 0 else ()


def _places(
    facts: CellFacts, pictures: Sequence[Observation], moves_s: Sequence[float]
) -> CameraPlaces:
    """Where the camera stood; the reference is the newest place that saw tag A.

    Pictures of one stamp were taken from one place.
    """
    first_s = tuple(sorted(moves_s))
    if facts.camera_stability is Stability.MOVABLE:
        first_s = tuple(sorted({picture.stamp_s for picture in pictures}))[1:]
    newest_s = max((seen.stamp_s for seen in pictures if seen.tag_a is not None), default=0.0)
    return CameraPlaces(first_s, int(np.searchsorted(first_s, newest_s, side="right")))


def _stamps(pictures: Sequence[Observation | None]) -> Array:
    return np.array([np.inf if picture is None else picture.stamp_s for picture in pictures])


def _touched(kind: str, touches: Sequence[Touch]) -> list[tuple[str, Touch]]:
    named = [(_touch_name(kind, i, touch), touch) for i, touch in enumerate(touches)]
    return sorted(named, key=lambda one: _touch_key(one[1]))


def _touch_name(kind: str, index: int, touch: Touch) -> str:
    return f"{kind} {index + 1} ({touch.target})"


def _pictures(kind: str, observations: Sequence[Observation]) -> list[tuple[str, Observation]]:
    named = [(f"{kind} {i + 1}", picture) for i, picture in enumerate(observations)]
    return sorted(named, key=lambda one: _picture_key(one[1]))


def _touch_key(touch: Touch) -> tuple[str, tuple[float, ...]]:
    sigmas = (touch.lateral_sigma_mm, touch.axial_sigma_mm)
    return touch.target, (
        *_numbers(touch.base_from_wrist),
        *sigmas,
        *_picture_key(touch.observation),
    )


def _picture_key(picture: Observation | None) -> tuple[float, ...]:
    if picture is None:
        return ()
    tags = [tag for tag in (picture.tag_b, picture.tag_a) if tag is not None]
    of_tags = [number for tag in tags for number in _numbers(tag.camera_from_tag)]
    return (*_numbers(picture.base_from_wrist), *of_tags)


def _hole_key(hole: HolePixel) -> tuple[str, tuple[float, ...]]:
    return hole.target, (*map(float, hole.pixel), hole.sigma_px)


def _numbers(pose: Pose) -> tuple[float, ...]:
    return tuple(np.concatenate([pose.translation, pose.rotation.ravel()]).tolist())


def _hole_names(sightings: Sequence[HolePixel]) -> list[str]:
    return [
        f"hole {hole.target}" + ("" if hole.spin is None else f" in spin {hole.spin + 1}")
        for hole in sightings
    ]


def _tag_b(picture: Observation | None) -> TagObservation | None:
    return None if picture is None else picture.tag_b


def _center(recording: Recording) -> Array | None:
    spec = recording.facts.object
    return spec.center_in_object if spec.motion is Motion.TURNTABLE else None


def _stations(pictures: Sequence[Observation | None]) -> Indices:
    """Where the arm stood for each sample (s,): the number of the first sample of the same rest."""
    first: dict[float, int] = {}
    since = [None if picture is None else picture.rest_since_s for picture in pictures]
    return np.array(
        [i if t is None else first.setdefault(t, i) for i, t in enumerate(since)], dtype=np.intp
    )


def _looks(seen: Sequence[Named], chosen: Sequence[int], stations: Indices) -> Looks:
    """Every picture of tag A; one taken while touching belongs to the stand of the touch."""
    if not chosen:
        raise TooFewObservations(
            "tag A was never seen, so the camera is not tied to the robot: bring it into view"
        )
    kept = [picture for _, picture in (seen[i] for i in chosen) if picture is not None]
    return Looks(
        _tags([picture.tag_a for picture in kept]),
        np.array([picture.base_from_wrist.rotation for picture in kept]),
        np.array([picture.base_from_wrist.translation for picture in kept]),
        stations[list(chosen)],
    )


def _tags(observations: Sequence[TagObservation | None]) -> Tags:
    seen = [tag for tag in observations if tag is not None]
    covariances = np.array([tag.covariance for tag in seen]).reshape(-1, 6, 6)
    return Tags(
        np.array([tag.camera_from_tag.rotation for tag in seen]).reshape(-1, 3, 3),
        np.array([tag.camera_from_tag.translation for tag in seen]).reshape(-1, 3),
        sqrt_information(covariances),
    )


def _picture_of(recording: Recording, hole: HolePixel) -> Observation | None:
    """Picture of the sample that shows the object as the hole's does; None where none is named."""
    if hole.spin is not None:
        return recording.spins[hole.spin] if hole.spin < len(recording.spins) else None
    return None if hole.touch is None else recording.touches[hole.touch].observation


def _touch_set(recording: Recording, touches: Sequence[Touch]) -> TouchSet:
    return touch_set(
        [touch.base_from_wrist for touch in touches],
        recording.facts.tool.axis_in_wrist,
        [touch.lateral_sigma_mm for touch in touches],
        [touch.axial_sigma_mm for touch in touches],
    )


def _holes(
    recording: Recording,
    sightings: Sequence[HolePixel],
    turned: Sequence[str],
    inexact: Sequence[str],
) -> Holes:
    """Holes; turned: names of the spins, in the order of the evidence."""
    facts = recording.facts
    cad, spins = [], []
    for sighting in sightings:
        cad.append(target_of(recording.facts, sighting.target).cad)
        name = "" if sighting.spin is None else f"spin {sighting.spin + 1}"
        if name and name not in turned:
            raise InputError(f"hole {sighting.target!r}: tag B is not in {name}")
        spins.append(turned.index(name) if name else _STILL)
    return Holes(
        np.array(cad).reshape(-1, 3),
        inexact_of([sighting.target for sighting in sightings], inexact),
        np.array(spins, dtype=np.intp),
        np.array([sighting.pixel for sighting in sightings]).reshape(-1, 2),
        np.array([sighting.sigma_px for sighting in sightings], dtype=np.float64),
        CameraCorrections.of(facts, None).camera,
    )
