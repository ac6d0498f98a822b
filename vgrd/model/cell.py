"""The cell: camera, tags, tool and object, as the cell file describes them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.model.arm import ArmModel
from vgrd.model.arrays import frozen_array


class Mount(StrEnum):
    """Where the camera is."""

    EYE_TO_HAND = "eye-to-hand"
    EYE_IN_HAND = "eye-in-hand"


class Stability(StrEnum):
    """Whether the camera stays where it stands; people move a movable one, and tag A tells where it is."""

    FIXED = "fixed"
    MOVABLE = "movable"


class Motion(StrEnum):
    """How the object can move."""

    TURNTABLE = "turntable"
    PLANAR = "planar"
    FREE = "free"


SMALLEST_TAG_MM = (
    1.0  # a guess: below it a size is in metres, or no camera of a cell reads the tag
)


@dataclass(frozen=True, slots=True)
class TagSpec:
    """A printed fiducial: family as in AprilTag ("36h11"), id, edge of its black square in mm."""

    family: str
    id: int
    size_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """A tool: where it touches and where it works.

    axis_in_wrist: (3,) unit vector out of the tip; work_from_touch_mm: (3,) offset in the wrist frame from the
    tip that touches while teaching to the tip that works.
    """

    name: str = "tool"
    axis_in_wrist: Array = field(  # as `axis` of a tool in the cell file
        default_factory=lambda: frozen_array((0, 0, 1), 3)
    )
    work_from_touch_mm: Array = field(default_factory=lambda: frozen_array((0, 0, 0), 3))


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A point of the object that the tool is to reach.

    point_in_object: (3,) CAD, mm; None: a bare target, its touches tell where it is. base_from_work:
    orientation (3, 3) in which the wrist works while the object stands as it was taught; None: as it was
    touched. hole_diameter_mm: of the hole of which the point is the centre, at its rim; None: no hole that
    a picture could show. clearance_mm: diameter of the hole minus that of what goes in; None: nothing goes in.
    """

    id: int
    name: str
    point_in_object: Array | None
    base_from_work: Array | None = None
    hole_diameter_mm: float | None = None
    clearance_mm: float | None = None

    @property
    def cad(self) -> Array:
        """(3,) of a target that CAD knows; InputError for a bare one."""
        if self.point_in_object is None:
            raise InputError(
                f"target {self.name!r} is not in CAD: give its point_mm in the cell file"
            )
        return self.point_in_object


@dataclass(frozen=True, slots=True, eq=False)
class ObjectSpec:
    """The target object: its CAD points, how it moves, and (turntable) its centre of rotation in CAD, mm.

    hole_sigma_mm: of each coordinate of a hole's centre on the real part, against CAD. center_sigma_mm: of the
    centre, across the axis. cad_sigma_mm: of each coordinate of a target; 0: exact.
    """

    targets: Mapping[str, Target]
    motion: Motion = Motion.TURNTABLE
    center_in_object: Array | None = None
    hole_sigma_mm: float = 0.03  # as `object.hole_sigma_mm` of the cell file
    center_sigma_mm: float = 0.2  # as `object.center_sigma_mm` of the cell file
    cad_sigma_mm: float = 0.03  # as `object.cad_sigma_mm` of the cell file

    @property
    def has_cad(self) -> bool:
        """Whether CAD tells of any target, so that the object has a frame."""
        return any(target.point_in_object is not None for target in self.targets.values())

    @property
    def bare(self) -> tuple[str, ...]:
        """Names of the targets without CAD."""
        return tuple(n for n, target in self.targets.items() if target.point_in_object is None)


@dataclass(frozen=True, slots=True, eq=False)
class CellFacts:
    """What a calibration must know about the cell besides the samples; goes into the session file.

    camera_matrix: (3, 3) px; distortion: OpenCV order; robot_sigma_mm: repeatability and error field of the arm;
    wrist_from_tcp: the TCP that is active on the pendant, None where the robot does not tell. camera_stability:
    while teaching, too. robot_step_mm, robot_step_rad: steps in which the robot told its flange while
    teaching, per axis; 0 where they do not matter. tag_a_sigma_mm, tag_b_sigma_mm: of the printed edges,
    along and across the paper each; 0: exact.
    """

    mount: Mount
    camera_matrix: Array
    distortion: Array
    image_size_px: tuple[int, int]
    tag_a: TagSpec | None
    tag_b: TagSpec
    tool: Tool
    object: ObjectSpec
    robot_sigma_mm: float = 0.1  # as `robot.sigma_mm` of the cell file
    robot_id: str = ""
    camera_id: str = ""
    wrist_from_tcp: Pose | None = None
    camera_stability: Stability = Stability.FIXED
    robot_step_mm: float = 0.0
    robot_step_rad: float = 0.0
    tag_a_sigma_mm: float = 0.05  # as `tags.a.size_sigma_mm` of the cell file
    tag_b_sigma_mm: float = 0.05  # as `tags.b.size_sigma_mm` of the cell file

    @property
    def tags(self) -> tuple[TagSpec, ...]:
        """The tags that are looked for."""
        return (self.tag_b,) if self.tag_a is None else (self.tag_a, self.tag_b)

    @property
    def tag_sigmas_mm(self) -> dict[int, float]:
        """How well the sizes of the tags are known, by id."""
        sigmas_mm = {self.tag_b.id: self.tag_b_sigma_mm}
        if self.tag_a is not None:
            sigmas_mm[self.tag_a.id] = self.tag_a_sigma_mm
        return sigmas_mm

    @property
    def arm(self) -> ArmModel:
        """How the arm differs from what it tells, rounding included."""
        return ArmModel.of(self.robot_sigma_mm, self.robot_step_mm, self.robot_step_rad)

    @property
    def flange_sigma_mm(self) -> float:
        """Sigma per axis of a flange position that the robot tells, rounding included."""
        return float(np.sqrt(self.arm.variances()[0]))
