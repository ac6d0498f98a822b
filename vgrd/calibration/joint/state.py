"""The unknowns of the joint estimate.

What the camera sees of the object is kept in the camera's frame, so that pictures and touches meet
in few equations: the tag while touching, and its motion N = G P G^-1 in every spin, with
G = camera_from_axis (its z is the axis of turning) and P planar (x, y, angle); x and y stay 0 on a
turntable.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.joint.problem import JointData
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, hat
from vgrd.model import Motion, Target

Columns = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class StepLayout:
    """Where the unknowns stand in a step.

    axis: which of the 6 body-frame moves of G are free; refined: how many tag sizes and intrinsics;
    places: in how many the camera was displaced. bare: names of the touched targets without CAD; inexact: of
    those in CAD that the part has elsewhere.
    """

    axis: tuple[int, ...]
    object_motions: tuple[int, ...]
    spins: int
    has_point: bool
    refined: int = 0
    places: int = 0
    bare: tuple[str, ...] = ()
    inexact: tuple[str, ...] = ()

    CAMERA = slice(0, 6)
    TAG_A = slice(6, 12)
    TCP = slice(12, 15)
    OBJECT = slice(15, 21)
    TAG_B = slice(21, 27)

    def bare_columns(self) -> Columns:
        """Columns (b, 3) of every touched target without CAD."""
        return 27 + np.arange(3 * len(self.bare)).reshape(-1, 3)

    def inexact_columns(self) -> Columns:
        """Columns (c, 3) of the offset of every target from CAD."""
        first = 27 + 3 * len(self.bare)
        return first + np.arange(3 * len(self.inexact)).reshape(-1, 3)

    def knows(self, target: Target) -> bool:
        """Whether CAD or a touch tells where a target is."""
        return target.point_in_object is not None or target.name in self.bare

    @property
    def axis_columns(self) -> slice:
        """Columns of the axis and centre of turning."""
        first = 27 + 3 * (len(self.bare) + len(self.inexact))
        return slice(first, first + len(self.axis))

    def spin_columns(self) -> Columns:
        """Columns (n, k) of the planar motion of every spin."""
        k = len(self.object_motions)
        first = self.axis_columns.stop
        return np.arange(first, first + k * self.spins).reshape(self.spins, k)

    @property
    def point_columns(self) -> slice:
        """Columns of the fixed point."""
        first = int(self.axis_columns.stop) + len(self.object_motions) * self.spins
        return slice(first, first + 3 * self.has_point)

    @property
    def refined_columns(self) -> slice:
        """Columns of the refined tag sizes and intrinsics."""
        first = int(self.point_columns.stop)
        return slice(first, first + self.refined)

    def place_columns(self) -> Columns:
        """Columns (p, 6) of every displacement of the camera."""
        first = int(self.refined_columns.stop)
        return np.arange(first, first + 6 * self.places).reshape(self.places, 6)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.refined_columns.stop) + 6 * self.places

    def is_length(self) -> NDArray[np.bool_]:
        """(n,): True for mm and what is refined (in sigmas known beforehand), False for rad."""
        pose = [True] * 3 + [False] * 3
        fixed = pose * 2 + [True] * 3 + pose * 2
        axis = [i < 3 for i in self.axis]
        object_motions = [i < 3 for i in self.object_motions] * self.spins
        return np.array(
            fixed
            + [True] * (3 * (len(self.bare) + len(self.inexact)))
            + axis
            + object_motions
            + [True] * (3 * self.has_point + self.refined)
            + pose * self.places
        )


def layout_of(data: JointData) -> StepLayout:
    """Unknowns that this evidence speaks of."""
    spins = len(data.spins)
    point, refined = len(data.points) > 0, data.corrections.count
    others = (point, refined, data.places.displaced, data.bare, data.inexact)
    if not spins:
        return StepLayout((), (), 0, *others)
    if data.motion is Motion.TURNTABLE:
        return StepLayout((3, 4, 0, 1), (5,), spins, *others)
    return StepLayout((3, 4), (5, 0, 1), spins, *others)


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Values of all unknowns; table_motion: (n, 3) x, y in mm and angle in rad of every spin.

    refined: (e,) tag sizes and intrinsics, in sigmas from what was assumed. taught_from_camera: (p),
    how the camera was displaced in each place beside the reference. bare_in_base: (b, 3) targets
    without CAD, as they stood while touched. offsets_in_object: (c, 3) of the targets in CAD, from there.
    """

    base_from_camera: Pose
    wrist_from_tag_a: Pose
    tcp_in_wrist: Array
    base_from_object: Pose
    camera_from_tag_b: Pose
    camera_from_axis: Pose
    table_motion: Array
    fixed_point_in_base: Array
    refined: Array = field(default_factory=lambda: np.zeros(0))
    taught_from_camera: tuple[Pose, ...] = ()
    bare_in_base: Array = field(default_factory=lambda: np.zeros((0, 3)))
    offsets_in_object: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def object_from_tag_b(self) -> Pose:
        """Tag B on the object."""
        base_from_tag_b = self.base_from_camera @ self.camera_from_tag_b
        return self.base_from_object.inverse() @ base_from_tag_b

    def retract(self, step: Array, layout: StepLayout) -> "JointState":
        """Left perturbations of poses, body-frame moves of the axis, planar moves of the spins."""
        twist = np.zeros(6)
        twist[list(layout.axis)] = step[layout.axis_columns]
        return replace(
            self,
            base_from_camera=Pose.exp(step[layout.CAMERA]) @ self.base_from_camera,
            wrist_from_tag_a=Pose.exp(step[layout.TAG_A]) @ self.wrist_from_tag_a,
            tcp_in_wrist=self.tcp_in_wrist + step[layout.TCP],
            base_from_object=Pose.exp(step[layout.OBJECT]) @ self.base_from_object,
            camera_from_tag_b=Pose.exp(step[layout.TAG_B]) @ self.camera_from_tag_b,
            camera_from_axis=self.camera_from_axis @ Pose.exp(twist),
            table_motion=_moved(self.table_motion, step[layout.spin_columns()], layout),
            fixed_point_in_base=self.fixed_point_in_base + step[layout.point_columns]
            if layout.has_point
            else self.fixed_point_in_base,
            bare_in_base=self.bare_in_base + step[layout.bare_columns()],
            offsets_in_object=self.offsets_in_object + step[layout.inexact_columns()],
            refined=self.refined + step[layout.refined_columns],
            taught_from_camera=tuple(
                Pose.exp(step[columns]) @ displacement
                for columns, displacement in zip(
                    layout.place_columns(), self.taught_from_camera, strict=True
                )
            ),
        )


def _moved(table_motion: Array, step: Array, layout: StepLayout) -> Array:
    if not layout.spins:
        return table_motion
    turn = step[:, 0]
    c, s = np.cos(turn), np.sin(turn)
    x, y = table_motion[:, 0], table_motion[:, 1]
    motions = np.column_stack([c * x - s * y, s * x + c * y, table_motion[:, 2] + turn])
    if len(layout.object_motions) > 1:
        motions[:, :2] += step[:, 1:]
    return motions


def taught_place(
    target: Target,
    base_from_object: Pose,
    bare_in_base: Array,
    offsets_in_object: Array,
    layout: StepLayout,
) -> tuple[Array, Array]:
    """Where a target stood while it was touched, (3,) base, and its derivative (3, n) by the unknowns.

    Raises NotObservable for one that nothing tells: without CAD, and not touched.
    """
    J = np.zeros((3, layout.size))
    if target.point_in_object is not None:
        point = target.point_in_object
        if target.name in layout.inexact:
            i = layout.inexact.index(target.name)
            point = point + offsets_in_object[i]
            J[:, layout.inexact_columns()[i]] = base_from_object.rotation
        place = base_from_object @ point
        J[:, layout.OBJECT] = left_jacobian(place[None])[0]
        return place, J
    if target.name not in layout.bare:
        raise NotObservable(untaught(target.name), rank=0, unknowns=3)
    i = layout.bare.index(target.name)
    J[:, layout.bare_columns()[i]] = np.eye(3)
    return bare_in_base[i], J


def untaught(name: str) -> str:
    """Why a target cannot be served of which neither CAD nor a touch tells anything."""
    return f"target {name!r} has no point_mm and was not touched, so nothing tells where it is: touch it"


def left_jacobian(points: Array) -> Array:
    """Derivative (n, 3, 6) of points (n, 3) by a left perturbation of the pose they came by."""
    lever = -hat(points)
    return np.concatenate([np.broadcast_to(np.eye(3), lever.shape), lever], axis=2)


def table_motion_of(camera_from_axis: Pose, motion: Pose, kind: Motion) -> Array:
    """(x, y, angle) of a motion in the camera, seen from the axis."""
    P = camera_from_axis.inverse() @ motion @ camera_from_axis
    angle = np.arctan2(P.rotation[1, 0], P.rotation[0, 0])
    x, y = P.translation[:2] * (kind is Motion.PLANAR)
    return np.array([x, y, angle])
