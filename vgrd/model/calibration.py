"""What a calibration found, with its verdict, and the coordinate that is served from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from vgrd.geometry import Array, Pose
from vgrd.model.cell import CellFacts, Target
from vgrd.model.estimate import JointEstimate


class Policy(StrEnum):
    """How the wrist will stand when it touches."""

    FIXED = "fixed"
    FOLLOW = "follow"
    REQUESTED = "requested"


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
