"""A nominal cell and its teaching session without any noise, drawn from a cell's facts.

::

                                  camera: leans by the tag's tilt, so that tag B, which lies flat,
       arm                   .[o]    is seen under that angle
     [flange]-[A]       . '          tag A, on the camera's side of the flange, faces it under the same
        |          . '
       tip    . '   distance
    ___ V _P1x_____P2____[B]___   table, its axis through x up; CAD's z is up

The base's z is up. Both tags are in every picture.
"""

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.geometry.camera import CameraModel
from vgrd.model import (
    CellFacts,
    Motion,
    ObjectSpec,
    Observation,
    Plan,
    Recording,
    TagObservation,
    Touch,
)
from vgrd.solving.expectation.assumptions import Assumptions
from vgrd.solving.expectation.sight import incidence_rad, is_in_picture, sight_of

_DOWN, _UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
_OBJECT_AT = np.array([450.0, 0.0, 60.0])  # in front of the robot's foot; nothing depends on it
_BRACKET_MM = 60.0  # a guess: tag A beside the flange, so much aside and so much below it
_TURN_RAD = np.radians(25)  # of a look and of a tilted touch, as people are asked for
_REACH_MM = 60.0  # a guess: looks lie within so much either way,
_REACH_SHARE = 0.15  # and within this share of the picture's shorter side, so that they show tag A
_TRIES = 8  # poses to choose every look from
_LOOK_TILT_RAD = np.radians([10, 65])  # under which a tag is found and has one pose
_ABOVE_MM = 80.0  # of the flange in looks and aside, over a touch
_SECONDS = 5.0  # between samples; any: stamps only have to differ
_LATER_S = 1e4  # after all of them


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Where everything is: facts of the cell, every target with a place; base, mm.

    base_from_object: as touched; base_from_axis: z is the axis of turning.
    """

    facts: CellFacts
    touch_sigmas_mm: tuple[float, float]
    assumed: Assumptions
    points: MappingProxyType[str, Array]
    camera: CameraModel
    base_from_object: Pose
    base_from_axis: Pose
    object_from_tag_b: Pose
    base_from_camera: Pose
    straight: Array
    tcp_in_wrist: Array
    wrist_from_tag_a: Pose

    @classmethod
    def of(
        cls, facts: CellFacts, touch_sigmas_mm: tuple[float, float], assumed: Assumptions
    ) -> "Scene":
        """Lay it out; raises InputError for a cell that cannot be foreseen."""
        assumed.check(facts)
        if facts.tag_a is None:
            raise InputError("the cell has no tag A: its looks cannot be foreseen")
        points = _places(facts.object, assumed.radius_mm)
        middle = _middle(facts.object, points)
        base_from_object = Pose(np.eye(3), _OBJECT_AT - middle)
        outermost = max(float(np.linalg.norm((p - middle)[:2])) for p in points.values())
        aside = outermost if assumed.tag_b_mm is None else assumed.tag_b_mm
        base_from_camera = _camera(assumed)
        axis = np.asarray(facts.tool.axis_in_wrist)
        straight = _straight(facts.object, axis)
        tcp = axis * assumed.tool_mm
        nominal = Pose(straight, _OBJECT_AT + _ABOVE_MM * _UP - straight @ tcp)
        return cls(
            facts=facts,
            touch_sigmas_mm=touch_sigmas_mm,
            assumed=assumed,
            points=MappingProxyType(points),
            camera=CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px),
            base_from_object=base_from_object,
            base_from_axis=Pose(np.eye(3), _OBJECT_AT),
            object_from_tag_b=Pose(_facing_down(), middle + np.array([aside, 0.0, 0.0])),
            base_from_camera=base_from_camera,
            straight=straight,
            tcp_in_wrist=tcp,
            wrist_from_tag_a=_tag_a(nominal, base_from_camera, assumed),
        )

    def recording(self) -> Recording:
        """The session that teaches it, no sample off."""
        assumed = self.assumed
        stamps = iter(np.arange(1, _LATER_S / _SECONDS) * _SECONDS)
        looks = [self._picture(pose, 0.0, next(stamps)) for pose in self._looks(assumed.looks)]
        since_s = float(next(stamps))
        spins = [
            replace(self._picture(self.aside, turn, next(stamps)), rest_since_s=since_s)
            for turn in np.arange(1, assumed.spins + 1) * 2 * np.pi / (assumed.spins + 1)
        ]
        touches = [
            self._touch(name, wrist, turn, next(stamps)) for name, wrist, turn in self._wished()
        ]
        return Recording(
            "expected", Plan.JOINT, self.facts, tuple(looks), tuple(spins), tuple(touches)
        )

    @property
    def aside(self) -> Pose:
        """base_from_wrist away from the object, for spins and for the picture of an answer."""
        return self._above(self.straight, np.array([-_REACH_MM, 0.0, _ABOVE_MM]))

    @property
    def tag_b_mm(self) -> float:
        """From tag B to the axis of turning."""
        place = (self.base_from_axis.inverse() @ self.base_from_object) @ self.object_from_tag_b
        return float(np.linalg.norm(place.translation[:2]))

    def answer(self, turn_rad: float) -> Observation:
        """The picture of an answer, the object turned so far since it was touched, the arm aside."""
        return self._picture(self.aside, turn_rad, _LATER_S)

    def field_mm(self) -> tuple[float, float]:
        """Width and height of what the camera sees at the object, across the line of sight."""
        (fx, fy), (width, height) = np.diag(self.camera.matrix)[:2], self.camera.size_px
        distance = self.assumed.distance_mm
        return distance * width / float(fx), distance * height / float(fy)

    def looks_seen(self) -> list[TagObservation]:
        """Tag A as the looks show it."""
        poses = self._looks(self.assumed.looks)
        return [self._tag_a(pose) for pose in poses]

    def _wished(self) -> list[tuple[str, Array, float]]:
        """Target, wrist and turn of every touch: each as it works, then the object half round, then tilted."""
        names, assumed = list(self.points), self.assumed
        plain = assumed.touches - assumed.tilted
        straight = [names[i % len(names)] for i in range(plain)]
        turns = [0.0] * (plain - assumed.turned) + [np.pi] * assumed.turned
        wished = [
            (name, self._wrist(name), turn) for name, turn in zip(straight, turns, strict=True)
        ]
        for i in range(assumed.tilted):
            name, side = straight[i % len(straight)], np.eye(3)[i % 2] * (-1) ** (i // 2)
            wished.append((name, self._turned(side) @ self._wrist(name), 0.0))
        return wished

    def _turned(self, axis: Array) -> Array:
        """Turn (3, 3) of the wrist about an axis (3,); an arm of four axes turns about the vertical instead."""
        if self.assumed.four_axes:
            axis = _UP * float(np.sum(axis))
        return np.asarray(exp_rotation(_TURN_RAD * axis))

    def _wrist(self, name: str) -> Array:
        """As it works at that target."""
        configured = self.facts.object.targets[name].base_from_work
        return self.straight if configured is None else np.asarray(configured)

    def _touch(self, name: str, R: Array, turn_rad: float, stamp_s: float) -> Touch:
        point = self._object(turn_rad) @ self.points[name]
        flange = Pose(R, point - R @ self.tcp_in_wrist)
        lateral, axial = self.touch_sigmas_mm
        return Touch(name, flange, lateral, axial, self._picture(flange, turn_rad, stamp_s))

    def _picture(self, flange: Pose, turn_rad: float, stamp_s: float) -> Observation:
        return Observation(flange, float(stamp_s), self._tag_a(flange), self._tag_b(turn_rad))

    def _tag_a(self, flange: Pose) -> TagObservation:
        tag = self.facts.tag_a or self.facts.tag_b
        seen = self._camera_from_base @ flange @ self.wrist_from_tag_a
        return sight_of(self.camera, tag, seen, self.assumed.corner_px)

    def _tag_b(self, turn_rad: float) -> TagObservation:
        seen = self._camera_from_base @ self._object(turn_rad) @ self.object_from_tag_b
        return sight_of(self.camera, self.facts.tag_b, seen, self.assumed.corner_px)

    def _looks(self, count: int) -> list[Pose]:
        """Poses that show tag A well and whole, as far as there are any, the wrist turned about every axis."""
        reach = min(_REACH_MM, _REACH_SHARE * min(self.field_mm()))
        poses = []
        for k in range(_TRIES * count):
            turn = self._turned(_SIDES[k % len(_SIDES)])
            poses.append(self._above(turn @ self.straight, reach * _CORNERS[k % len(_CORNERS)]))
        return sorted(poses, key=lambda pose: not self._shows_tag_a(pose))[:count]

    def _shows_tag_a(self, flange: Pose) -> bool:
        seen = self._tag_a(flange)
        low, high = _LOOK_TILT_RAD
        is_whole = is_in_picture(seen, self.camera)
        return is_whole and bool(low <= incidence_rad(seen.camera_from_tag) <= high)

    def _above(self, R: Array, shift: Array) -> Pose:
        """Flange from which the tip would be over the middle of the object, shifted (3,) and not lower."""
        tip = _OBJECT_AT + _ABOVE_MM * _UP
        return Pose(R, tip - self.straight @ self.tcp_in_wrist + shift)

    def _object(self, turn_rad: float) -> Pose:
        """base_from_object after a turn."""
        turn = Pose(exp_rotation(turn_rad * _UP), np.zeros(3))
        axis = self.base_from_axis
        return axis @ turn @ axis.inverse() @ self.base_from_object

    @property
    def _camera_from_base(self) -> Pose:
        return self.base_from_camera.inverse()


# Turns of looks: about each axis of the base either way, and about two at once.
_SIDES = np.array(
    [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [-1, 0, 0],
        [0, -1, 0],
        [0, 0, -1],
        [0.7, 0, 0.7],
        [0, 0.7, -0.7],
        [-0.7, 0, 0.7],
        [0.7, 0.7, 0],
    ],
    dtype=float,
)
_CORNERS = np.array(
    [[-1, -1, 0], [1, 1, 1], [-1, 1, 1], [1, -1, 0], [0, 0, 1], [1, 0, -0.5], [0, -1, 1]]
)


def _places(spec: ObjectSpec, radius_mm: float) -> dict[str, Array]:
    """Every target in the object: by CAD, those without on a circle, evenly."""
    count = len(spec.targets)
    circle = [
        radius_mm * np.array([np.cos(a), np.sin(a), 0.0])
        for a in np.arange(count) * 2 * np.pi / count
    ]
    return {
        name: place if target.point_in_object is None else np.asarray(target.point_in_object)
        for (name, target), place in zip(spec.targets.items(), circle, strict=True)
    }


def _middle(spec: ObjectSpec, points: dict[str, Array]) -> Array:
    """Where it turns, at the height of the targets; without a centre the mean of the targets."""
    mean = np.mean(list(points.values()), axis=0)
    center = spec.center_in_object
    if center is None or spec.motion is not Motion.TURNTABLE:
        return np.asarray(mean)
    return np.array([center[0], center[1], mean[2]])


def _camera(assumed: Assumptions) -> Pose:
    tilt = np.radians(assumed.tag_tilt_deg)
    view = np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
    return Pose(_frame(np.array([0.0, 1.0, 0.0]), view), _OBJECT_AT - assumed.distance_mm * view)


def _straight(spec: ObjectSpec, axis: Array) -> Array:
    """How the wrist works (3, 3): as configured for the first target, else the tool points down."""
    configured = [t.base_from_work for t in spec.targets.values() if t.base_from_work is not None]
    if configured:
        return np.asarray(configured[0])
    cross, cosine = np.cross(axis, _DOWN), float(axis @ _DOWN)
    length = float(np.linalg.norm(cross))
    if length < 1e-9:  # rounding
        aside = np.linalg.svd(axis[None])[2][1]
        return np.eye(3) if cosine > 0 else np.asarray(exp_rotation(np.pi * aside))
    return np.asarray(exp_rotation(cross / length * np.arctan2(length, cosine)))


def _tag_a(flange: Pose, base_from_camera: Pose, assumed: Assumptions) -> Pose:
    """wrist_from_tag_a: beside the flange on the camera's side, leaning outwards from the line of sight."""
    place = flange.translation + np.array([_BRACKET_MM, 0.0, -_BRACKET_MM])
    sight = place - base_from_camera.translation
    lean = exp_rotation(-np.radians(assumed.tag_tilt_deg) * np.array([0.0, 1.0, 0.0]))
    R = _frame(np.array([0.0, -1.0, 0.0]), lean @ sight)
    return flange.inverse() @ Pose(R, place)


def _facing_down() -> Array:
    """A tag that lies flat: z into the paper, so down."""
    return _frame(np.array([0.0, 1.0, 0.0]), _DOWN)


def _frame(x_axis: Array, z_axis: Array) -> Array:
    """Rotation (3, 3) with z column along z_axis, x column near x_axis."""
    z = z_axis / np.linalg.norm(z_axis)
    x = x_axis - (x_axis @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
