"""Frozen values that pass between the layers: what a session recorded and what a calibration found."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from vgrd.estimate import JointEstimate
from vgrd.geometry import Array, Pose


class Plan(StrEnum):
    """What a teaching session is for; a constant wrist and varied wrists exclude each other."""

    UNIVERSAL = "universal"
    SPECIAL = "special"
    CONVENTIONAL = "conventional"
    JOINT = "joint"


class Policy(StrEnum):
    """How the wrist will stand when it touches."""

    FIXED = "fixed"
    FOLLOW = "follow"
    REQUESTED = "requested"


class Mount(StrEnum):
    """Where the camera is."""

    EYE_TO_HAND = "eye-to-hand"
    EYE_IN_HAND = "eye-in-hand"


class Motion(StrEnum):
    """How the object can move."""

    TURNTABLE = "turntable"
    PLANAR = "planar"
    FREE = "free"


def frozen_array(values: object, *shape: int) -> Array:
    """Read-only float64 copy of `values`, checked to be finite-or-inf (no NaN) and of `shape`."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape or np.isnan(array).any():
        msg = f"expected shape {shape} without NaN, got {array.shape}"
        raise ValueError(msg)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class TagSpec:
    """A printed fiducial: family as in AprilTag ("36h11"), id, edge of its black square in mm."""

    family: str
    id: int
    size_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class TagObservation:
    """A tag in one picture.

    camera_from_tag: pose, mm; covariance: (6, 6) of a left tangent perturbation (v, w) of that pose;
    corners_px: (4, 2) in the order (-,-), (+,-), (+,+), (-,+) of the tag's x right, y down, OpenCV pixel
    convention (centre of the first pixel is 0, 0); rms_px: reprojection error of the corners; chi2: per pixel,
    how far the picture is from the model of the print, 1 when the noise explains it.
    """

    tag: TagSpec
    camera_from_tag: Pose
    covariance: Array
    corners_px: Array
    rms_px: float
    chi2: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Pose and picture of one instant, robot at rest: which tags were seen from which flange pose."""

    base_from_wrist: Pose
    stamp_s: float
    tag_a: TagObservation | None = None
    tag_b: TagObservation | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """A tool: where it touches and where it works.

    axis_in_wrist: (3,) unit vector out of the tip; work_from_touch_mm: (3,) offset in the wrist frame from the
    tip that touches while teaching to the tip that works.
    """

    name: str = "tool"
    axis_in_wrist: Array = field(default_factory=lambda: frozen_array((0, 0, 1), 3))
    work_from_touch_mm: Array = field(default_factory=lambda: frozen_array((0, 0, 0), 3))


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A point of the object that the tool is to reach.

    point_in_object: (3,) CAD, mm. base_from_work: orientation (3, 3) in which the wrist works while the object
    stands as it was taught; None: as it was touched. hole_diameter_mm: of the hole of which the point is the
    centre, at its rim; None: no hole that a picture could show.
    """

    id: int
    name: str
    point_in_object: Array
    base_from_work: Array | None = None
    hole_diameter_mm: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ObjectSpec:
    """The target object: its CAD points, how it moves, and (turntable) its centre of rotation in CAD, mm.

    hole_sigma_mm: of each coordinate of a hole's centre on the real part, against CAD.
    """

    targets: Mapping[str, Target]
    motion: Motion = Motion.TURNTABLE
    center_in_object: Array | None = None
    hole_sigma_mm: float = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The tool's tip rests on `target`; sigma across and along the tool axis, infinite allowed.

    For touches of a fixed point outside the object (conventional TCP) `target` is the point's own name.
    """

    target: str
    base_from_wrist: Pose
    lateral_sigma_mm: float
    axial_sigma_mm: float
    observation: Observation | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CellFacts:
    """What a calibration must know about the cell besides the samples; goes into the session file.

    camera_matrix: (3, 3) px; distortion: OpenCV order; robot_sigma_mm: repeatability and error field of the arm;
    wrist_from_tcp: the TCP that is active on the pendant, None where the robot does not tell.
    """

    mount: Mount
    camera_matrix: Array
    distortion: Array
    image_size_px: tuple[int, int]
    tag_a: TagSpec | None
    tag_b: TagSpec
    tool: Tool
    object: ObjectSpec
    robot_sigma_mm: float = 0.1
    robot_id: str = ""
    camera_id: str = ""
    wrist_from_tcp: Pose | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Everything that was taught in one session, in order, undone samples left out.

    looks: hand-eye samples; spins: the object turned, robot at rest; touches: on the object; points: touches of one
    fixed point with varied wrists (conventional TCP); verifications: held out of every fit.
    """

    session: str
    plan: Plan
    facts: CellFacts
    looks: tuple[Observation, ...] = ()
    spins: tuple[Observation, ...] = ()
    touches: tuple[Touch, ...] = ()
    points: tuple[Touch, ...] = ()
    verifications: tuple[Touch, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """One remark of a verdict: a stable code and a sentence that names the remedy; `fatal` ones refuse the result."""

    code: str
    message: str
    fatal: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Accept or reject, with the reasons."""

    findings: tuple[Finding, ...] = ()

    @property
    def ok(self) -> bool:
        """True when no finding is fatal."""
        return not any(finding.fatal for finding in self.findings)


@dataclass(frozen=True, slots=True, eq=False)
class TaughtPoint:
    """A target as it was taught, robot frame, object standing as in the reference picture.

    flange_in_base: (3,) where the flange is when the work tip is on the target with orientation
    base_from_work; covariance: (3, 3) mm^2 of flange_in_base. joint_covariance, mm^2: method
    "universal" (9, 9) of (flange_in_base, pivot_in_base, tcp_in_wrist), the pivot's rows 0 where
    there is none; "special" (6, 6) of (flange_in_base, pivot_in_base), None without pivot.
    """

    target: Target
    flange_in_base: Array
    base_from_work: Array
    covariance: Array
    joint_covariance: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """All that the runtime needs, immutable; poses as named, mm.

    method: "joint", "universal" or "special"; joint: what answers rest on with the first.
    tcp_in_wrist: (3,) touch tip or None where it is not determined (constant wrist);
    tcp_covariance: (3, 3). base_from_camera: from hand-eye; its covariance (6, 6), left tangent.
    camera_from_tag_b_ref: tag B in the reference picture (0), at which `taught` holds, and
    reference_covariance (6, 6). pivot: a point of the object that stays where it is when the
    object turns (rotation centre), in tag B (pivot_covariance: (3, 3)) and in the base, or None
    where none was recorded; it replaces the hand-eye translation. Method "special" knows no TCP:
    its pivot_in_base is where the flange stands when the work tip is on the pivot.
    wrist_from_tag_a: live check that nothing moved, None if tag A is not used.
    """

    id: str
    session: str
    created_unix_s: float
    method: str
    facts: CellFacts
    base_from_camera: Pose
    hand_eye_covariance: Array
    wrist_from_tag_a: Pose | None
    tcp_in_wrist: Array | None
    tcp_covariance: Array | None
    camera_from_tag_b_ref: Pose
    pivot_in_tag_b: Array | None
    pivot_in_base: Array | None
    taught: Mapping[str, TaughtPoint]
    residuals: Mapping[str, float]
    verdict: Verdict
    pivot_covariance: Array | None = None
    reference_covariance: Array | None = None
    joint: JointEstimate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedCoordinate:
    """Where the flange must go: the product. u95: 95 % radius, mm and rad."""

    target: Target
    base_from_wrist: Pose
    position_covariance: Array
    u95_mm: float
    u95_rad: float
