"""Layouts of fake cells: every true transform, in mm and rad; drawn is the first one.

::

        z (base)                      camera: on a post behind the turntable, looks at the robot,
        |                     .--.    32 deg from the vertical, 600 mm from the middle of the work
        |   arm              / c /
     ___|___  _________     '--'
    | robot |          |   /   optical axis
    | foot  |        [flange]--.
    |       |          |  [A]  '   tag A on a bracket at the flange, faces the camera
    |_______|          | tool
    ----+------     ___V_______________   turntable, axis 450 mm in front of the foot,
        0          |  o  o  [B]  o  o  |  top 60 mm above the foot; tag B and six targets on it
        +-----------------> x (base)      a spike beside the table: fixed point of the plain TCP

The base frame is at the robot's foot, x to the turntable, z up. The CAD frame of the object lies
on the top of the disc, origin on the turntable's axis. Tag frames are x right, y down, z into the
paper. The flange's z points out of the flange, so down over the table. Nothing is quite straight:
axis, bracket, tool and tag B are all a little off, as mounted things are.

The two cells of the paper (`sampler`, `fruit`) differ by their arm, their object and their lens.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fakes.world.optics import Optics
from vgrd.geometry import Array, Pose
from vgrd.model import Motion, TagSpec, Target, frozen_array

TARGET_RADIUS_MM = 60.0  # inside the disc, around tag B
HOLE_DIAMETER_MM = 4.0  # 43 px in the picture
DISC_RADIUS_MM = 75.0  # a disc that shows whole in the picture (372 x 281 mm)
FLANGE_RADIUS_MM = 31.5  # of a UR5e, 63 mm (ISO 9409-1-50-4-M6)
TOOL_RADIUS_MM = 6.0  # a pin, as touches want it (a guess)
FIXED_POINT = "spike"
_CAMERA_TILT_RAD = np.radians(32)  # from the vertical: sees past the arm, and tag B not too flat
_CAMERA_DISTANCE_MM = 600.0  # at 12 mm focal length 372 mm of the work are seen
_CAMERA_LOOKS_AT = np.array([478.0, 0.0, 112.0])  # between table and tag A on the flange
_TAG_A_TILT_RAD = np.radians(34)  # off the line of sight: straight on, poses are ambiguous


def _frame(x_axis: Array, z_axis: Array) -> Array:
    """Rotation (3, 3) with z column `z_axis` and x column `x_axis` made orthogonal to it."""
    z = z_axis / np.linalg.norm(z_axis)
    x = x_axis - (x_axis @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _base_from_camera(
    looks_at: Array = _CAMERA_LOOKS_AT, distance_mm: float = _CAMERA_DISTANCE_MM
) -> Pose:
    view = np.array([-np.sin(_CAMERA_TILT_RAD), 0.0, -np.cos(_CAMERA_TILT_RAD)])
    rotation = _frame(np.array([0.0, 1.0, 0.0]), view)
    straight = Pose(rotation, looks_at - distance_mm * view)
    return straight.compose(Pose.from_rotvec((0.006, -0.004, 0.011)))


def _wrist_from_tag_a(bracket_mm: tuple[float, float, float] = (58.3, -1.9, 47.4)) -> Pose:
    """On the flange's side that is turned to the camera, leaning outwards from its sight."""
    lean = _CAMERA_TILT_RAD + _TAG_A_TILT_RAD
    into_paper = np.array([-np.sin(lean), 0.0, np.cos(lean)])
    rotation = _frame(np.array([0.0, -1.0, 0.0]), into_paper)
    straight = Pose(rotation, np.array(bracket_mm))
    return straight.compose(Pose.from_rotvec((0.02, -0.03, 0.015)))


def _targets(
    radius_mm: float, hole_mm: float, clearance_mm: float | None = None
) -> dict[str, Target]:
    """Six holes on a circle."""
    angles = np.radians(np.arange(30, 390, 60))
    places = [(radius_mm * np.cos(a), radius_mm * np.sin(a)) for a in angles]
    return _holes(places, hole_mm, clearance_mm)


def _holes(
    places_mm: Sequence[tuple[float, float]], hole_mm: float, clearance_mm: float | None = None
) -> dict[str, Target]:
    return {
        f"P{i}": Target(
            i,
            f"P{i}",
            frozen_array((x, y, 0.0), 3),
            hole_diameter_mm=hole_mm,
            clearance_mm=clearance_mm,
        )
        for i, (x, y) in enumerate(places_mm, start=1)
    }


def _optics() -> Optics:
    focal_px = 6486.0  # 12 mm lens on 1.85 um pixels: 0.0925 mm/px at 600 mm
    matrix = frozen_array(((focal_px, 0, 2014.8), (0, focal_px, 1511.8), (0, 0, 1)), 3, 3)
    distortion = frozen_array((-0.08, 0.10, 2e-4, -1e-4, 0.0), 5)
    return Optics(matrix, distortion, (4024, 3036), focus_mm=575.0, aperture_mm=12 / 5.6)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where everything truly is; frames as in the module's drawing.

    base_from_table: the turntable at angle 0, z along its axis. tcp_in_wrist: (3,) the true tip of
    the tool. wrist_from_pendant_tcp: what the operator left active on the pendant, not the true
    TCP. fixed_point_in_base: (3,) the spike's tip. ink_mm: how far black edges of the tags spread.
    workspace_mm: (2, 3) lower and upper corner of where the flange goes. arm_axes: 6, or 4 for a wrist
    that turns about the vertical only. motion: how the object moves. looks_around_mm: (2, 3) middle and
    half size of where the flange goes for hand-eye looks. aside_mm: (3,) the flange, hiding no tag at any
    angle of the table. disc_radius_mm: of what the holes are in. touch_turn_rad: how far the wrist is turned
    about the tool too in varied touches, tag A then turned away; 0 keeps both tags in view.
    """

    base_from_camera: Pose = field(default_factory=_base_from_camera)
    optics: Optics = field(default_factory=_optics)
    tag_a: TagSpec = field(default_factory=lambda: TagSpec("36h11", 0, 25.0))  # edge: 270 px
    tag_b: TagSpec = field(default_factory=lambda: TagSpec("36h11", 1, 25.0))  # edge: 270 px
    wrist_from_tag_a: Pose = field(default_factory=_wrist_from_tag_a)
    object_from_tag_b: Pose = field(  # on the disc, a little off as mounted things are
        default_factory=lambda: Pose(
            _frame(np.array([0.03, 1.0, 0.0]), np.array([0.004, -0.003, -1.0])),
            np.array([50.6, 0.7, 0.4]),
        )
    )
    tcp_in_wrist: Array = field(  # a pin of 150 mm, a little off the axis
        default_factory=lambda: frozen_array((2.41, -1.68, 148.57), 3)
    )
    tool_axis_in_wrist: Array = field(default_factory=lambda: frozen_array((0, 0, 1), 3))
    base_from_table: Pose = field(  # in front of the foot, a little oblique
        default_factory=lambda: Pose.from_rotvec((0.002, -0.003, 0.0), (450.0, 0.0, 60.0))
    )
    targets: Mapping[str, Target] = field(
        default_factory=lambda: _targets(TARGET_RADIUS_MM, HOLE_DIAMETER_MM)
    )
    fixed_point_in_base: Array = field(  # beside the disc, in view
        default_factory=lambda: frozen_array((448.0, 118.0, 82.0), 3)
    )
    base_from_wrist_home: Pose = field(  # aside, above the table
        default_factory=lambda: Pose(np.diag([1.0, -1.0, -1.0]), np.array([400.0, -120.0, 300.0]))
    )
    wrist_from_pendant_tcp: Pose = field(  # wrong by some 30 mm: nothing may rest on it
        default_factory=lambda: Pose.from_rotvec((0.0, 0.0, 0.35), (4.0, 1.5, 121.0))
    )
    workspace_mm: Array = field(  # holds all poses of the operator
        default_factory=lambda: frozen_array(((300, -200, 140), (600, 240, 420)), 2, 3)
    )

    ink_mm: float = 0.0
    arm_axes: int = 6
    motion: Motion = Motion.TURNTABLE
    looks_around_mm: Array = field(  # above the table, tag A in the picture; within 60 mm 87 %
        # of the poses show both tags, within 120 mm 71 %
        default_factory=lambda: frozen_array(((428, 0, 224), (60, 60, 60)), 2, 3)
    )
    aside_mm: Array = field(default_factory=lambda: frozen_array((424, -118, 232), 3))
    disc_radius_mm: float = DISC_RADIUS_MM
    touch_turn_rad: float = 0.0

    def base_from_object(self, angle_rad: float) -> Pose:
        """Place the CAD frame in the base, turntable at `angle_rad`."""
        return self.base_from_table.compose(Pose.from_rotvec((0.0, 0.0, angle_rad)))

    def target_in_base(self, name: str, angle_rad: float) -> Array:
        """Find a CAD target at a table angle, or the spike (`FIXED_POINT`): (3,) mm."""
        if name == FIXED_POINT:
            return self.fixed_point_in_base
        point = self.targets[name].cad
        return self.base_from_object(angle_rad).apply(point)


def sampler() -> Layout:
    """The paper's experiment B: a 4-axis arm puts bottles into a rotary sample changer.

    The picture has 0.047 mm per pixel at the work, as the paper's camera: a lens of 25 mm from 635 mm.
    """
    matrix = frozen_array(((13513.5, 0, 2018.2), (0, 13513.5, 1513.6), (0, 0, 1)), 3, 3)
    distortion = frozen_array((-0.05, 0.08, 1e-4, -2e-4, 0.0), 5)
    optics = Optics(matrix, distortion, (4024, 3036), focus_mm=600.0, aperture_mm=25 / 11)
    bottle_in_wrist = frozen_array((0.83, -1.12, 148.2), 3)  # held nearly on the fourth axis
    return Layout(
        base_from_camera=_base_from_camera(np.array([470.0, 0.0, 90.0]), 635.0),
        optics=optics,
        tag_a=TagSpec("36h11", 0, 15.0),  # edge: 320 px
        tag_b=TagSpec("36h11", 1, 15.0),
        wrist_from_tag_a=_wrist_from_tag_a((55.6, -1.4, 46.2)),
        object_from_tag_b=Pose(
            _frame(np.array([-0.02, 1.0, 0.0]), np.array([-0.003, 0.004, -1.0])),
            np.array([44.2, 0.5, 0.3]),
        ),
        tcp_in_wrist=bottle_in_wrist,
        base_from_table=Pose.from_rotvec((-0.002, 0.003, 0.0), (450.0, 0.0, 60.0)),
        targets=_targets(40.0, 12.0, 12.0 - 11.6),  # the paper's holes and its bottle
        fixed_point_in_base=frozen_array((505.0, 38.0, 72.0), 3),  # the wrist turns either way
        arm_axes=4,
        looks_around_mm=frozen_array(((432, 0, 222), (25, 30, 20)), 2, 3),
        aside_mm=frozen_array((424, -72, 226), 3),
        disc_radius_mm=56.0,
    )


def fruit() -> Layout:
    """The paper's experiment A: a 6-axis arm places fruits into a tray that lies anywhere on a plane.

    Holes are 62.5 mm apart in both directions, as the paper's; how wide they are it does not tell.
    """
    pitch = 62.5
    places = [(pitch * x, pitch * y) for y in (-0.5, 0.5) for x in (-1, 0, 1)]
    return Layout(
        tcp_in_wrist=frozen_array((-1.52, 2.87, 161.3), 3),
        object_from_tag_b=Pose(
            _frame(np.array([0.02, 1.0, 0.0]), np.array([-0.004, 0.002, -1.0])),
            np.array([31.4, -0.6, 0.5]),  # between four holes
        ),
        targets=_holes(places, 20.0),
        motion=Motion.PLANAR,
        # Without a turntable the TCP tells where a turned tray's holes are: tilts alone leave it 1 mm open.
        touch_turn_rad=np.pi / 2,
        disc_radius_mm=86.0,
    )
