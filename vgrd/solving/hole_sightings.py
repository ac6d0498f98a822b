"""Holes of the object in the pictures of a session, as observations for the joint estimate.

A picture counts where the object stands as in a sample: while it was touched, or in a spin. The hole
in which the tool stands is never looked for.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, zip_longest

import numpy as np

from vgrd.calibration.joint import HolePixel, JointState, calibrate_joint, start_near_tag_plane
from vgrd.calibration.turntable import without_useless_spins
from vgrd.devices import CameraImage
from vgrd.errors import DidNotConverge
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import Motion, Observation, Recording, Stability, TagObservation
from vgrd.vision.holes.hole_finder import HoleSighting, HoleSpec, sight_holes
from vgrd.vision.holes.view import ring, turn_angles

SAME_PLACE_PX = 0.5  # between two searches
PICTURES, SEARCHES = 8, 64  # more tell little: CAD's tolerance is the same in all
_FEWEST_PICTURES = 2  # one alone may be wrong
_OUTLINE = 64  # points drawn on a rim
_TOOL_WITHIN = 2.0  # diameters of the hole
_NOT_SHOWN = "no picture shows its place without the tool"

Images = Callable[[Collection[float]], Iterable[CameraImage]]

Report = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Missed:
    """A hole that was looked for in vain: why, and its outline (m, 2) px where it should have been."""

    reason: str
    outline_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class SearchedPicture:
    """What came of the search in the picture of a stamp; spin: index of the object's, None: as touched."""

    stamp_s: float
    spin: int | None
    sightings: tuple[HoleSighting, ...]
    missed: Mapping[str, Missed]


@dataclass(frozen=True, slots=True, eq=False)
class HolesSeen:
    """sightings: for the joint estimate; unseen: by target, why; pictures: all that were searched."""

    sightings: tuple[HolePixel, ...] = ()
    unseen: Mapping[str, str] = field(default_factory=dict)
    pictures: tuple[SearchedPicture, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """A picture of tag B; spin: index of the spin that the object stands as in, None: as touched.

    touch: index of the touch that shows it alike, None of a spin.
    """

    observation: Observation
    tag_b: TagObservation
    spin: int | None
    touch: int | None


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Where object and tool are in a picture; spin, touch as in `_Shot`."""

    stamp_s: float
    camera_from_tag_b: Pose
    camera_from_object: Pose
    tip_in_object: Array
    spin: int | None
    touch: int | None


def holes_of(recording: Recording) -> dict[str, HoleSpec]:
    """The targets that are holes, by name."""
    return {
        name: HoleSpec(target.cad, target.hole_diameter_mm / 2)
        for name, target in recording.facts.object.targets.items()
        if target.hole_diameter_mm is not None
    }


def see_holes(
    recording: Recording,
    observations: Iterable[Observation],
    images: Images,
    report: Report | None = None,
) -> HolesSeen:
    """Look for the holes of the object in the pictures of a session.

    observations: what was observed in the pictures; `images` gives those of wanted stamps. PICTURES are
    searched, fewer where the object has many holes, and as many again for holes that were not seen
    there: more tell little, since CAD's tolerance is the same in all. Where to look comes from the
    joint estimate, first without holes, then with those found; raises what `calibrate_joint` does.
    report: called with (done, total) pictures.
    """
    usable, _ = without_useless_spins(recording)
    search = _Search(usable, observations)
    search.look(images, report, _without_holes(usable, search.holes))
    if search.unseen and search.hole_views:
        again = calibrate_joint(usable, search.sightings())
        search.look(images, report, again.state)
    return HolesSeen(search.sightings(), search.unseen, tuple(search.pictures))


def _without_holes(recording: Recording, holes: Mapping[str, HoleSpec]) -> JointState:
    """The joint estimate; its start where it leaves something open, since it wanders along that."""
    with suppress(DidNotConverge):
        result = calibrate_joint(recording, find_noise=False)  # a place to look at is enough
        if not result.undetermined.size:
            return result.state
    points = np.array([hole.point_in_object for hole in holes.values()])
    return start_near_tag_plane(recording, points)


class _Search:
    """What came of the searches so far; unseen: reasons by target."""

    def __init__(self, recording: Recording, observations: Iterable[Observation]) -> None:
        facts = recording.facts
        self._stability = facts.camera_stability
        self._camera = CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px)
        self._sigma_mm = facts.object.hole_sigma_mm
        self._shots = _shots(recording, observations)
        self.holes = holes_of(recording)
        self.hole_views: list[tuple[_View, HoleSighting]] = []
        self.pictures: list[SearchedPicture] = []
        self.unseen = dict.fromkeys(self.holes, _NOT_SHOWN)

    def look(self, images: Images, report: Report | None, state: JointState) -> None:
        """Look for what was not seen yet in the best pictures that were not taken before."""
        searches: dict[float, tuple[_View, list[str]]] = {}
        for shot in self._shots:
            view = _view(shot, state, self._stability)
            if names := [name for name in self.unseen if self._may_show(view, name)]:
                searches[view.stamp_s] = (view, names)
        count = int(np.clip(SEARCHES // max(len(self.holes), 1), _FEWEST_PICTURES, PICTURES))
        chosen = self._best_first([view for view, _ in searches.values()], count)[:count]
        stamps = {view.stamp_s for view in chosen}
        self._shots = [shot for shot in self._shots if shot.observation.stamp_s not in stamps]
        for number, image in enumerate(images(stamps), 1):
            self._look_at(image, *searches[image.stamp_s], state.object_from_tag_b)
            if report is not None:
                report(number, len(stamps))

    def sightings(self) -> tuple[HolePixel, ...]:
        """All that was seen, each hole's tolerance in CAD shared among its sightings."""
        counts = Counter(hole.target for _, hole in self.hole_views)
        return tuple(
            HolePixel(
                hole.target,
                hole.pixel,
                float(np.hypot(hole.sigma_px, self._cad_px(view, hole.target, counts))),
                view.spin,
                view.touch,
            )
            for view, hole in self.hole_views
        )

    def _look_at(
        self, image: CameraImage, view: _View, names: list[str], object_from_tag_b: Pose
    ) -> None:
        holes = {name: self.holes[name] for name in names}
        sightings, missing = sight_holes(
            image.pixels, self._camera, view.camera_from_tag_b, object_from_tag_b, holes
        )
        self.hole_views += [(view, hole) for hole in sightings]
        missed = {
            name: Missed(why, self._expected_px(view, name)) for name, why in missing.items()
        }
        self.pictures.append(SearchedPicture(view.stamp_s, view.spin, tuple(sightings), missed))
        for hole in sightings:
            self.unseen.pop(hole.target, None)
        self.unseen.update((name, why) for name, why in missing.items() if name in self.unseen)

    def _expected_px(self, view: _View, name: str) -> Array:
        """Outline (m, 2) of a hole where it should be, parallel to the object's xy plane."""
        hole = self.holes[name]
        flat = np.column_stack([ring(turn_angles(_OUTLINE)), np.zeros(_OUTLINE)])
        rim = hole.point_in_object + hole.radius_mm * flat
        return self._camera.project(view.camera_from_object @ rim)

    def _may_show(self, view: _View, name: str) -> bool:
        """Whether the place of a hole is in the picture and the tool not in it."""
        hole = self.holes[name]
        pixel = self._camera.project((view.camera_from_object @ hole.point_in_object)[None])[0]
        inside = (pixel > 0).all() and (pixel < np.array(self._camera.size_px)).all()
        return bool(inside and _tool_mm(view, hole) > 2 * _TOOL_WITHIN * hole.radius_mm)

    def _best_first(self, views: list[_View], count: int) -> list[_View]:
        """Spins, spread over all of them, and in turn other pictures, the tool far from all holes first."""
        spun = [view for view in views if view.spin is not None]
        stride = max(1, -(-2 * len(spun) // count))
        spread = [view for first in range(stride) for view in spun[first::stride]]
        still = [view for view in views if view.spin is None]
        still.sort(key=lambda view: -min(_tool_mm(view, hole) for hole in self.holes.values()))
        in_turn = chain.from_iterable(zip_longest(spread, still))
        return [view for view in in_turn if view is not None]

    def _by_object(self, view: _View, place: Array) -> Array:
        """Derivative (2, 3), px / mm, of the pixel by a place in the object."""
        J = self._camera.linearize((view.camera_from_object @ place)[None])[1][0]
        return np.asarray(J @ view.camera_from_object.rotation)

    def _cad_px(self, view: _View, name: str, counts: Mapping[str, int]) -> float:
        """CAD's tolerance, the same in all pictures of a hole, as each of n would have it by itself."""
        J = self._by_object(view, self.holes[name].point_in_object)
        return float(self._sigma_mm * np.linalg.norm(J) * np.sqrt(counts[name] / 2))


def _view(shot: _Shot, state: JointState, stability: Stability) -> _View:
    """Where object and tool are, the tool by tag A where the camera may stand anywhere."""
    camera_from_tag_b = shot.tag_b.camera_from_tag
    camera_from_object = camera_from_tag_b @ state.object_from_tag_b.inverse()
    tag_a = shot.observation.tag_a
    camera_from_wrist = state.base_from_camera.inverse() @ shot.observation.base_from_wrist
    if stability is Stability.MOVABLE and tag_a is not None:
        camera_from_wrist = tag_a.camera_from_tag @ state.wrist_from_tag_a.inverse()
    tip_in_camera = camera_from_wrist @ state.tcp_in_wrist
    return _View(
        shot.observation.stamp_s,
        camera_from_tag_b,
        camera_from_object,
        camera_from_object.inverse() @ tip_in_camera,
        shot.spin,
        shot.touch,
    )


def _shots(recording: Recording, observations: Iterable[Observation]) -> list[_Shot]:
    """The pictures in which the object stands as in a sample."""
    samples = _samples(recording)
    shots = []
    for observation in observations:
        if observation.tag_b is None or not samples:
            continue
        corners = observation.tag_b.corners_px
        shifts = [float(np.abs(corners - sample.tag_b.corners_px).max()) for sample in samples]
        if min(shifts) <= SAME_PLACE_PX:
            alike = samples[int(np.argmin(shifts))]
            shots.append(_Shot(observation, observation.tag_b, alike.spin, alike.touch))
    return shots


def _samples(recording: Recording) -> list[_Shot]:
    """The samples that tell how the object stood, and where tag B was in them."""
    touched = [
        _Shot(touch.observation, touch.observation.tag_b, None, k)
        for k, touch in enumerate(recording.touches)
        if touch.observation is not None and touch.observation.tag_b is not None
    ]
    if recording.facts.object.motion is Motion.FREE:
        return touched
    spun = [
        _Shot(spin, spin.tag_b, k, None)
        for k, spin in enumerate(recording.spins)
        if spin.tag_b is not None
    ]
    return [*touched, *spun]


def _tool_mm(view: _View, hole: HoleSpec) -> float:
    """How far the tool's tip is from a hole."""
    return float(np.linalg.norm(view.tip_in_object - hole.point_in_object))
