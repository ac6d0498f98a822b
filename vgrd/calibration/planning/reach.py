"""Where an arm may stand for a sample, and all the samples worth a thought there."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from vgrd.calibration.joint import JointFit, target_of, taught_place, turn_of
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.touches import touched_orientation
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import Motion, Plan, Recording, Stability

_SLACK_RAD = 1e-6  # rounding
_LIFT_MM = 100.0  # above the target, so that the way there is seen
_PLACES = 6  # farthest from each other: more proposals nobody compares
_INCIDENCE = 0.35  # cosine of 70 degrees: a flatter tag is not found
_DISTINCT_YAWS = 3  # fewer do not tell that an arm only yaws
_CIRCLE = tuple(float(a) for a in np.arange(12) * np.pi / 6)  # nearer turns tell much the same


@dataclass(frozen=True, slots=True)
class Touching:
    """Touch a target with the wrist oriented as base_from_wrist (3, 3).

    turn_rad: of the object on its table since most targets were touched.
    """

    target: str
    base_from_wrist: Array
    turn_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Looking:
    """Look at tag A from a flange pose."""

    base_from_wrist: Pose


@dataclass(frozen=True, slots=True)
class Spinning:
    """Take a picture of the object turned by an angle since it was touched."""

    angle_rad: float


Candidate = Touching | Looking | Spinning


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Flange positions between two corners (3,), base, mm."""

    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        if np.shape(self.lower) != (3,) or np.shape(self.upper) != (3,):
            raise InputError("a box has two corners of three coordinates in mm")
        if not (np.asarray(self.lower) < np.asarray(self.upper)).all():
            raise InputError(f"a box from {self.lower} to {self.upper} is empty: swap the corners")

    def holds(self, point: Array) -> bool:
        """Whether a flange position (3,) lies in it."""
        return bool((self.lower <= point).all() and (point <= self.upper).all())

    def places(self) -> list[Array]:
        """Its middle, and eight places half-way to the corners."""
        middle = (np.asarray(self.lower) + self.upper) / 2
        quarter = (np.asarray(self.upper) - self.lower) / 4
        return [middle, *(middle + quarter * np.array(s) for s in product((-1, 1), repeat=3))]


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """What the arm may do for a sample.

    max_tilt_rad: of the tool's axis from `axis_in_base` (3,), None: from how it touches as a rule (`usual_wrist`);
    0 for an arm of four axes. max_yaw_rad: about the tool's axis, either way. boxes: at least one
    holds the flange (3,), base, mm; () allows every place. within_joints: whether the arm can stand
    at a flange pose; None: always. turns_rad: turns of the object for spins, () for none. Raises
    InputError for angles below 0 or beyond 180 degrees.
    """

    max_tilt_rad: float = float(np.radians(30))  # a guess: cables and neighbours rarely allow more
    max_yaw_rad: float = float(np.radians(90))  # a guess: half a turn in all
    axis_in_base: Array | None = None
    boxes: Sequence[Box] = ()
    within_joints: Callable[[Pose], bool] | None = None
    turns_rad: Sequence[float] = _CIRCLE

    def __post_init__(self) -> None:
        for angle in (self.max_tilt_rad, self.max_yaw_rad):
            if not 0 <= angle <= np.pi + _SLACK_RAD:
                raise InputError(f"tilt and yaw are 0 to 180 degrees, got {np.degrees(angle):.1f}")

    @classmethod
    def of(cls, recording: Recording) -> "Reach":
        """The usual one; no tilt for an arm that only ever yawed, as one of four axes does."""
        rotations = [sample.base_from_wrist.rotation for sample in recording.looks]
        rotations += [touch.base_from_wrist.rotation for touch in recording.touches]
        planes = np.round([R[:, :2].ravel() for R in rotations], 2)
        yaws = np.unique(planes, axis=0) if rotations else ()
        upright = len(yaws) >= _DISTINCT_YAWS and turned_axes(rotations)[0] is Axes.ONE
        return cls(max_tilt_rad=0.0) if upright else cls()

    def allows(self, flange: Pose, tool_axis: Array, nominal_axis: Array) -> bool:
        """Whether the arm may stand there; axes (3,): the tool's in the wrist, nominal in the base."""
        axis = flange.rotation @ tool_axis
        tilt = np.arctan2(np.linalg.norm(np.cross(axis, nominal_axis)), axis @ nominal_axis)
        if tilt > self.max_tilt_rad + _SLACK_RAD:
            return False
        if self.boxes and not any(box.holds(flange.translation) for box in self.boxes):
            return False
        return self.within_joints is None or self.within_joints(flange)

    def orientations(
        self, straight: Array, tool_axis: Array, tilts: Sequence[float] = (0.5, 1.0)
    ) -> list[Array]:  # half-way between, since errors grow smoothly with tilt
        """Wrists (3, 3): upright, and tilted by shares of the most to eight sides, at all yaws."""
        turn = straight
        if self.axis_in_base is not None:
            turn = _shortest(straight @ tool_axis, np.asarray(self.axis_in_base)) @ straight
        across = np.linalg.svd(tool_axis[None])[2][1:]
        sides = [np.array([np.cos(a), np.sin(a)]) @ across for a in np.arange(8) * np.pi / 4]
        turns = [np.zeros(3)]
        if self.max_tilt_rad > 0:
            turns += [share * self.max_tilt_rad * side for share in tilts for side in sides]
        return [
            turn @ exp_rotation(tilt) @ exp_rotation(yaw * tool_axis)
            for tilt in turns
            for yaw in self._yaws()
        ]

    def _yaws(self) -> list[float]:
        if self.max_yaw_rad == 0:
            return [0.0]
        if self.max_yaw_rad > 0.75 * np.pi:
            return [0.0, -np.pi / 2, np.pi / 2, np.pi]
        return [0.0, -self.max_yaw_rad, self.max_yaw_rad]


def flange_of(result: JointFit, candidate: Candidate) -> Pose | None:
    """base_from_wrist at which the sample is taken, by the present estimate.

    None for a spin and for a touch of the turned object: people turn it by eye.
    """
    if isinstance(candidate, Looking):
        return candidate.base_from_wrist
    if isinstance(candidate, Spinning) or candidate.turn_rad:
        return None
    return touch_pose(result, candidate)


def touch_pose(result: JointFit, touching: Touching) -> Pose:
    """base_from_wrist of a touch, the object turned by as much as it says."""
    R, state = touching.base_from_wrist, result.state
    target = target_of(result.recording.facts, touching.target)
    point, _ = taught_place(
        target, state.base_from_object, state.bare_in_base, state.offsets_in_object, result.layout
    )
    if touching.turn_rad:
        turn = turn_of(state.camera_from_axis, touching.turn_rad)
        point = state.base_from_camera @ (turn @ (state.base_from_camera.inverse() @ point))
    return Pose(R, point - R @ state.tcp_in_wrist)


def usual_wrist(recording: Recording, target: str | None = None) -> Array:
    """How the wrist stands (3, 3): as configured for the target, else as it did in most touches."""
    configured = None if target is None else target_of(recording.facts, target).base_from_work
    if configured is not None:
        return np.asarray(configured)
    return touched_orientation(recording.touches)


def known_targets(result: JointFit) -> list[str]:
    """Names of the targets whose place CAD or a touch tells."""
    targets = result.recording.facts.object.targets
    return sorted(n for n in targets if result.layout.knows(targets[n]))


def touches_within(
    result: JointFit, reach: Reach, targets: Sequence[str] | None = None
) -> list[Touching]:
    """Touches of every target (None: all whose place is known) that the reach allows."""
    touches, tool = [], np.asarray(result.recording.facts.tool.axis_in_wrist)
    for name in targets or known_targets(result):
        straight = usual_wrist(result.recording, name)
        for touching in (Touching(name, R) for R in reach.orientations(straight, tool)):
            if _is_allowed(result, reach, touching, straight):
                touches.append(touching)
    return touches


def looks_within(result: JointFit, reach: Reach) -> list[Looking]:
    """Looks at tag A that the reach allows: in its boxes, else where the arm already stood."""
    recording = result.recording
    straight = usual_wrist(recording)
    places = [place for box in reach.boxes for place in box.places()]
    wrists = reach.orientations(straight, np.asarray(recording.facts.tool.axis_in_wrist), (1.0,))
    every = [
        Looking(Pose(R, place))
        for place in places or list(_known_places(result, straight))
        for R in wrists
    ]
    return [look for look in every if _is_allowed(result, reach, look, straight)]


def spins_within(result: JointFit, reach: Reach) -> list[Spinning]:
    """Turns of the object, where it turns or slides on a plane."""
    if result.recording.facts.object.motion is Motion.FREE:
        return []
    return [Spinning(angle) for angle in reach.turns_rad]


def turned_touches_within(result: JointFit, reach: Reach) -> list[Touching]:
    """Touches of every target with the wrist as usual and the object turned as far as the spins.

    They tell the centre best half round. None where nothing shows the turn: a camera that people move, an
    object that lies anywhere, no spin yet.
    """
    facts = result.recording.facts
    turns_rad = [turn for turn in reach.turns_rad if turn]
    is_movable = facts.camera_stability is Stability.MOVABLE
    if (
        not (result.layout.axis and turns_rad)
        or is_movable
        or result.recording.plan is not Plan.JOINT
    ):
        return []
    turn_rad = min(turns_rad, key=np.cos)
    wrists = {name: usual_wrist(result.recording, name) for name in known_targets(result)}
    touches = [Touching(name, straight, turn_rad) for name, straight in wrists.items()]
    return [one for one in touches if _is_allowed(result, reach, one, one.base_from_wrist)]


def samples_within(result: JointFit, reach: Reach) -> list[Candidate]:
    """Touches, looks and spins that the reach allows, always in the same order."""
    return [
        *touches_within(result, reach),
        *turned_touches_within(result, reach),
        *looks_within(result, reach),
        *spins_within(result, reach),
    ]


def camera_sees_tag_a(result: JointFit) -> Callable[[Pose], bool]:
    """Whether a camera_from_tag_a shows the whole tag in the picture, from its printed side."""
    facts, camera = result.recording.facts, result.data.holes.camera
    edge = 0.5 * (facts.tag_a or facts.tag_b).size_mm
    corners = edge * np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    size = np.array(facts.image_size_px)
    side = np.sign(np.median([_incidence(tag) for tag in result.data.looks.tags.poses()]))

    def sees(camera_from_tag: Pose) -> bool:
        points = camera_from_tag @ corners
        if points[:, 2].min() <= edge or side * _incidence(camera_from_tag) < _INCIDENCE:
            return False
        pixels = camera.project(points)
        return bool((pixels >= 0).all() and (pixels <= size - 1).all())

    return sees


def _incidence(camera_from_tag: Pose) -> float:
    """Cosine between the tag's normal and the line of sight."""
    t = camera_from_tag.translation
    return float(camera_from_tag.rotation[:, 2] @ t / np.linalg.norm(t))


def _is_allowed(result: JointFit, reach: Reach, candidate: Candidate, straight: Array) -> bool:
    axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
    nominal = straight @ axis if reach.axis_in_base is None else np.asarray(reach.axis_in_base)
    if isinstance(candidate, Touching):
        return reach.allows(touch_pose(result, candidate), axis, nominal)
    flange = flange_of(result, candidate)
    return flange is None or reach.allows(flange, axis, nominal)


def _known_places(result: JointFit, straight: Array) -> Iterator[Array]:
    """Flange positions (3,) of looks so far, at most six far apart; else above the touches."""
    recording = result.recording
    places = [np.asarray(look.base_from_wrist.translation) for look in recording.looks]
    if not places:
        back = -_LIFT_MM * straight @ np.asarray(recording.facts.tool.axis_in_wrist)
        places = [t.base_from_wrist.translation + back for t in recording.touches]
    chosen = [places[0]]
    while len(chosen) < min(_PLACES, len(places)):
        apart = [min(float(np.linalg.norm(s - c)) for c in chosen) for s in places]
        chosen.append(places[int(np.argmax(apart))])
    yield from chosen


def _shortest(start: Array, end: Array) -> Array:
    """Rotation (3, 3) that takes one unit vector to another the shortest way."""
    cross, cosine = np.cross(start, end), float(start @ end)
    sine = float(np.linalg.norm(cross))
    if sine > _SLACK_RAD:
        return exp_rotation(cross / sine * np.arctan2(sine, cosine))
    flip = np.linalg.svd(start[None])[2][1] * np.pi
    return np.eye(3) if cosine > 0 else exp_rotation(flip)
