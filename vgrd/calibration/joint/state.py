"""The unknowns of the joint estimate, and a first guess of them from closed forms.

What the camera sees of the object is kept in the camera's frame, so that pictures and touches meet
in few equations: the tag while touching, and its motion N = G P G^-1 in every spin, with
G = camera_from_axis (its z is the axis of turning) and P planar (x, y, angle); x and y stay 0 on a
turntable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.hand_eye import park_martin_start
from vgrd.calibration.joint.problem import EvidenceKind, JointData, Looks, Tags
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.turntable import RotationCenter, find_rotation_center
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.errors import CalibrationError, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, nearest_rotation
from vgrd.model import Motion

_UNIVERSAL_TOUCHES = 4  # what the universal method needs
_REFERENCE = -1  # as `CameraPlaces.of`
_LINEAR_RCOND = 1e-6  # directions that no sample tells apart from rounding

Columns = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class StepLayout:
    """Where the unknowns stand in a step.

    axis: which of the 6 body-frame moves of G are free; refined: how many tag sizes and intrinsics;
    places: in how many the camera was displaced.
    """

    axis: tuple[int, ...]
    object_motions: tuple[int, ...]
    spins: int
    has_point: bool
    refined: int = 0
    places: int = 0

    CAMERA = slice(0, 6)
    TAG_A = slice(6, 12)
    TCP = slice(12, 15)
    OBJECT = slice(15, 21)
    TAG_B = slice(21, 27)

    @property
    def axis_columns(self) -> slice:
        """Columns of the axis and centre of turning."""
        return slice(27, 27 + len(self.axis))

    def spin_columns(self) -> Columns:
        """Columns (n, k) of the planar motion of every spin."""
        k = len(self.object_motions)
        first = 27 + len(self.axis)
        return np.arange(first, first + k * self.spins).reshape(self.spins, k)

    @property
    def point_columns(self) -> slice:
        """Columns of the fixed point."""
        first = 27 + len(self.axis) + len(self.object_motions) * self.spins
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
            + axis
            + object_motions
            + [True] * (3 * self.has_point + self.refined)
            + pose * self.places
        )


def layout_of(data: JointData) -> StepLayout:
    """Unknowns that this evidence speaks of."""
    spins = len(data.spins)
    point, refined = len(data.points) > 0, data.corrections.count
    places = data.places.displaced
    if not spins:
        return StepLayout((), (), 0, point, refined, places)
    if data.motion is Motion.TURNTABLE:
        return StepLayout((3, 4, 0, 1), (5,), spins, point, refined, places)
    return StepLayout((3, 4), (5, 0, 1), spins, point, refined, places)


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Values of all unknowns; table_motion: (n, 3) x, y in mm and angle in rad of every spin.

    refined: (e,) tag sizes and intrinsics, in sigmas from what was assumed. taught_from_camera: (p),
    how the camera was displaced in each place beside the reference.
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


def guess(data: JointData) -> JointState:
    """First values from closed forms.

    Raises TooFewObservations where not even a guess is possible.
    """
    taught_from_camera: tuple[Pose, ...] = ()
    if data.places.displaced:
        base_from_camera, wrist_from_tag_a, taught_from_camera = _guess_places(data)
        data = _as_taught(data, taught_from_camera)
        camera_from_tag_b = _guess_reference(data.reference)
    else:
        camera_from_tag_b = _guess_reference(data.reference)
        base_from_camera, wrist_from_tag_a = _guess_hand_eye(data.looks)
    base_from_object, tcp, is_tied = _guess_object(data)
    center = _guess_center(data)
    if center is not None and data.center is not None and not is_tied:
        center_in_base = base_from_camera @ center.center_in_camera
        axis = base_from_camera.rotation @ center.axis_in_camera
        shift = center_in_base - base_from_object @ data.center
        shift = shift - axis * float(axis @ shift)
        R = data.touches.rotations[0]
        base_from_object = Pose(base_from_object.rotation, base_from_object.translation + shift)
        tcp = tcp + R.T @ shift
    camera_from_object = base_from_camera.inverse() @ base_from_object
    camera_from_axis = _guess_axis(data, center, camera_from_object)
    table_motion = [
        table_motion_of(
            camera_from_axis, camera_from_tag @ camera_from_tag_b.inverse(), data.motion
        )
        for camera_from_tag in data.spins.poses()
    ]
    points = data.points
    spike = (points.rotations @ tcp + points.translations).mean(axis=0) if len(points) else tcp
    return JointState(
        base_from_camera,
        wrist_from_tag_a,
        tcp,
        base_from_object,
        camera_from_tag_b,
        camera_from_axis,
        np.array(table_motion).reshape(-1, 3),
        spike,
        np.zeros(data.corrections.count),
        taught_from_camera,
    )


def table_motion_of(camera_from_axis: Pose, motion: Pose, kind: Motion) -> Array:
    """(x, y, angle) of a motion in the camera, seen from the axis."""
    P = camera_from_axis.inverse() @ motion @ camera_from_axis
    angle = np.arctan2(P.rotation[1, 0], P.rotation[0, 0])
    x, y = P.translation[:2] * (kind is Motion.PLANAR)
    return np.array([x, y, angle])


def _guess_reference(tags: Tags) -> Pose:
    if not len(tags):
        raise TooFewObservations(
            "tag B was not seen in any touch, so there is no reference picture: "
            "touch with tag B in view"
        )
    R = nearest_rotation(tags.rotations.sum(axis=0), tolerance=np.inf)
    return Pose(R, np.median(tags.translations, axis=0))


def _guess_hand_eye(looks: Looks) -> tuple[Pose, Pose]:
    rounded = np.round(np.column_stack([looks.translations, 1e3 * looks.rotations[:, 0]]), 1)
    distinct = np.unique(rounded, axis=0, return_index=True)[1]
    if len(distinct) < 3:
        raise TooFewObservations(
            f"tag A was seen from {len(distinct)} robot poses, at least 3 are needed: record looks, "
            "or touch with tag A in view"
        )
    looks = looks.subset(distinct)
    object_motions, tags = looks.poses(), looks.tags.poses()
    if turned_axes(list(looks.rotations))[0] is Axes.MANY:
        return park_martin_start(object_motions, tags)
    X, tag_in_wrist = linear_start(looks.rotations, looks.translations, looks.tags.translations)
    rotation_sum = sum(
        R.T @ X.rotation @ tag.rotation for R, tag in zip(looks.rotations, tags, strict=True)
    )
    return X, Pose(nearest_rotation(rotation_sum, tolerance=np.inf), tag_in_wrist)


def _guess_places(data: JointData) -> tuple[Pose, Pose, tuple[Pose, ...]]:
    """base_from_camera, wrist_from_tag_a, and how the camera was displaced in the other places.

    While it is touched the object stands still, so that tag B is a camera that does not move: what it
    sees of tag A is the hand-eye problem. Where too few touches show both tags, the place is taken from
    which tag A was seen most.
    """
    looks, places = data.looks, data.places.of(data.stamps_s[EvidenceKind.HAND_EYE])
    base_from_tag_b = None
    by_tag_b, seen = _seen_by_tag_b(data)
    try:
        base_from_tag_b, wrist_from_tag_a = _guess_hand_eye(
            replace(looks.subset(seen), tags=by_tag_b)
        )
    except TooFewObservations:
        most = np.bincount(places + 1).argmax() - 1
        wrist_from_tag_a = _guess_hand_eye(looks.subset(np.flatnonzero(places == most)))[1]
    chains = [
        wrist @ wrist_from_tag_a @ tag.inverse()
        for wrist, tag in zip(looks.poses(), looks.tags.poses(), strict=True)
    ]
    touched = data.places.of(data.stamps_s[EvidenceKind.REFERENCE])
    still = list(zip(touched, data.reference.poses(), strict=True))
    cameras = {
        int(place): _middle([c for c, p in zip(chains, places, strict=True) if p == place])
        for place in np.unique(places)
    }
    if base_from_tag_b is None:
        in_base = [cameras[place] @ tag for place, tag in still if place in cameras]
        base_from_tag_b = _middle(in_base) if in_base else None
    if base_from_tag_b is not None:
        for place, tag in still:
            cameras.setdefault(int(place), base_from_tag_b @ tag.inverse())
    camera = cameras[_REFERENCE]
    return (
        camera,
        wrist_from_tag_a,
        tuple(
            camera.inverse() @ cameras.get(place, camera) for place in range(data.places.displaced)
        ),
    )


def _seen_by_tag_b(data: JointData) -> tuple[Tags, Columns]:
    """Tag A from tag B in the touches that show both, and which of the looks these are."""
    of_b = {name: i for i, name in enumerate(data.names[EvidenceKind.REFERENCE])}
    seen = [i for i, name in enumerate(data.names[EvidenceKind.HAND_EYE]) if name in of_b]
    names = data.names[EvidenceKind.HAND_EYE]
    tags_a, tags_b = data.looks.tags.poses(), data.reference.poses()
    poses = [tags_b[of_b[names[i]]].inverse() @ tags_a[i] for i in seen]
    return _tags_at(poses), np.array(seen, dtype=np.intp)


def _as_taught(data: JointData, taught_from_camera: Sequence[Pose]) -> JointData:
    """Tag B as the camera in the reference would have seen it; its noise is left as it was."""
    displacements = [*taught_from_camera, Pose.identity()]

    def moved(tags: Tags, kind: EvidenceKind) -> Tags:
        poses = zip(data.places.of(data.stamps_s[kind]), tags.poses(), strict=True)
        return _tags_at([displacements[place] @ pose for place, pose in poses])

    return replace(
        data,
        reference=moved(data.reference, EvidenceKind.REFERENCE),
        spins=moved(data.spins, EvidenceKind.SPINS),
    )


def _tags_at(poses: Sequence[Pose]) -> Tags:
    """Tags (n) of which only the poses count."""
    R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    t = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    return Tags(R, t, np.broadcast_to(np.eye(6), (len(R), 6, 6)))


def _middle(poses: Sequence[Pose]) -> Pose:
    R = nearest_rotation(np.sum([pose.rotation for pose in poses], axis=0), tolerance=np.inf)
    return Pose(R, np.median([pose.translation for pose in poses], axis=0))


def _guess_object(data: JointData) -> tuple[Pose, Array, bool]:
    """base_from_object, TCP, and whether touches alone tell the TCP."""
    touches, points = data.touches, data.points
    axes = turned_axes(list(touches.rotations))[0]
    if axes is Axes.MANY and len(touches) >= _UNIVERSAL_TOUCHES:
        try:
            result = calibrate_universal(UniversalProblem(data.cad, touches))
        except CalibrationError:
            pass
        else:
            return result.object_from_base.inverse(), result.tcp_in_wrist, True
    pose, tcp = linear_start(touches.rotations, touches.translations, data.cad)
    if axes is Axes.NONE and len(points) and turned_axes(list(points.rotations))[0] is Axes.MANY:
        point_tcp = linear_start(points.rotations, points.translations, 0 * points.translations)[1]
        shift = touches.rotations[0] @ (point_tcp - tcp)
        return Pose(pose.rotation, pose.translation + shift), point_tcp, True
    return pose, tcp, axes is not Axes.NONE


def _guess_center(data: JointData) -> RotationCenter | None:
    try:
        return find_rotation_center(data.spins.poses())
    except (NotObservable, TooFewObservations):
        return None


def _guess_axis(data: JointData, center: RotationCenter | None, camera_from_object: Pose) -> Pose:
    """Frame with z along the axis, CAD's z up; origin: the centre in CAD, brought onto the axis seen."""
    origin = camera_from_object @ (np.zeros(3) if data.center is None else data.center)
    z = camera_from_object.rotation[:, 2]
    if center is not None:
        z = center.axis_in_camera * np.copysign(1.0, center.axis_in_camera @ z)
        origin = center.at_height(origin)[1]
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(z, x), z]), origin)


def linear_start(rotations: Array, translations: Array, points: Array) -> tuple[Pose, Array]:
    """(H, y) with `rotations @ y + translations ~ H points`, for any set of wrist orientations.

    Linear in y, the matrix of H and its translation; of what is not determined the shortest is
    taken. rotations (n, 3, 3), translations and points (n, 3), mm.
    """
    n = len(rotations)
    middle, middle_of_flange = points.mean(axis=0), translations.mean(axis=0)
    reach = max(float(np.std(points)), 1.0)
    A = np.zeros((n, 3, 15))
    A[:, :, :3], A[:, :, 12:] = rotations, -np.eye(3)
    for row in range(3):
        A[:, row, 3 + 3 * row : 6 + 3 * row] = -(points - middle) / reach
    right = -(translations - middle_of_flange).ravel()
    x = np.linalg.lstsq(A.reshape(-1, 15), right, rcond=_LINEAR_RCOND)[0]
    R = nearest_rotation(x[3:12].reshape(3, 3), tolerance=np.inf)
    B = np.concatenate([rotations, np.broadcast_to(-np.eye(3), (n, 3, 3))], axis=2)
    right = ((points - middle) @ R.T - (translations - middle_of_flange)).ravel()
    x = np.linalg.lstsq(B.reshape(-1, 6), right, rcond=_LINEAR_RCOND)[0]
    return Pose(R, x[3:] + middle_of_flange - R @ middle), np.asarray(x[:3])
