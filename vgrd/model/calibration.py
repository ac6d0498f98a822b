"""What a calibration found, with its verdict, and the coordinate that is served from it."""

from dataclasses import dataclass, field
from enum import StrEnum

from vgrd.geometry import Array, Pose
from vgrd.model.cell import Target


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
    base_from_work; covariance: (3, 3) mm^2 of flange_in_base.
    """

    target: Target
    flange_in_base: Array
    base_from_work: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class TcpEstimate:
    """The touch tip: in_wrist (3,), mm; covariance: (3, 3), mm^2."""

    in_wrist: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlacedPoint:
    """Where a target is on the object: in_tag_b (3,), mm; covariance: (3, 3), mm^2."""

    in_tag_b: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedCoordinate:
    """Where the flange must go: the product.

    u95: 95 % radius, mm and rad; 99.5 % where the camera is fixed and tag A is not in the picture.
    fits: the picture is as the calibration predicts; else it shows that something moved.
    taught_from_camera: how the camera has moved since teaching, as the answer takes it.
    """

    target: Target
    base_from_wrist: Pose
    position_covariance: Array
    u95_mm: float
    u95_rad: float
    fits: bool = True
    taught_from_camera: Pose = field(default_factory=Pose.identity)
