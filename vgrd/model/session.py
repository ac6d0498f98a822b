"""What a teaching session recorded."""

from dataclasses import dataclass
from enum import StrEnum

from vgrd.geometry import Array, Pose
from vgrd.model.cell import CellFacts, TagSpec


class Plan(StrEnum):
    """What a teaching session is for; a constant wrist and varied wrists exclude each other."""

    UNIVERSAL = "universal"
    SPECIAL = "special"
    CONVENTIONAL = "conventional"
    PLANE = "plane"
    SPHERE = "sphere"
    JOINT = "joint"

    @property
    def touches_beside(self) -> bool:
        """Whether the TCP comes from touches beside the object: of a point, a plane or a ball (figure 3)."""
        return self in {Plan.CONVENTIONAL, Plan.PLANE, Plan.SPHERE}

    @property
    def touches_surface(self) -> bool:
        """Whether those touches are of a plane or a ball, each at another place of it."""
        return self in {Plan.PLANE, Plan.SPHERE}


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
    """Pose and picture of one instant, robot at rest: which tags were seen from which flange pose.

    rest_since_s: when the arm came to this rest. Pictures of one rest share the error that the arm
    made as it stopped. None where that is not known: a rest of its own.
    """

    base_from_wrist: Pose
    stamp_s: float
    tag_a: TagObservation | None = None
    tag_b: TagObservation | None = None
    rest_since_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MovingSight:
    """Tags in a picture that was taken while the arm moved; no sample.

    base_from_wrist: the flange `delay_s` after the picture's stamp, between the poses that the robot
    told; delay_s: as configured for the camera, so much later it was taken by the robot's clock.
    """

    base_from_wrist: Pose
    stamp_s: float
    tag_a: TagObservation | None = None
    tag_b: TagObservation | None = None
    delay_s: float = 0.0

    @property
    def taken_s(self) -> float:
        """When it was taken by the robot's clock, as far as that is known."""
        return self.stamp_s + self.delay_s


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The tool's tip rests on `target`; sigma across and along the tool axis, infinite allowed.

    For touches beside the object (a fixed point, a plane, a ball) `target` is the name of that thing.
    """

    target: str
    base_from_wrist: Pose
    lateral_sigma_mm: float
    axial_sigma_mm: float
    observation: Observation | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Everything that was taught in one session, in order, undone samples left out.

    looks: hand-eye samples; spins: the object turned, robot at rest; touches: on the object; points: touches beside
    it with varied wrists, of one fixed point, or of the plane or ball that the plan names; verifications: held out of
    every fit.
    """

    session: str
    plan: Plan
    facts: CellFacts
    looks: tuple[Observation, ...] = ()
    spins: tuple[Observation, ...] = ()
    touches: tuple[Touch, ...] = ()
    points: tuple[Touch, ...] = ()
    verifications: tuple[Touch, ...] = ()

    @property
    def fixed_points(self) -> tuple[Touch, ...]:
        """Touches of one fixed point; none where the plan touches a surface."""
        return () if self.plan.touches_surface else self.points

    @property
    def touch_pictures(self) -> tuple[Observation, ...]:
        """Pictures of the touches that have one."""
        return tuple(touch.observation for touch in self.touches if touch.observation is not None)
