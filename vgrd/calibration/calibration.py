"""A calibration: all that the runtime needs, and the one door to its coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.contradiction import contradiction_of
from vgrd.calibration.joint import JointSolution
from vgrd.calibration.stepwise import SpecialSolution, UniversalSolution, is_open
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.rotation_formats import rotvec_near, usual_rotvec
from vgrd.model import (
    UNMOVED,
    AdoptedSlip,
    CameraPlace,
    CellFacts,
    ExpectedCoordinate,
    Motion,
    Policy,
    TagObservation,
    TaughtPoint,
    TcpEstimate,
    Verdict,
)

Solution = JointSolution | UniversalSolution | SpecialSolution


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What every calibration has, immutable; poses as named, mm.

    solution: what answers rest on; all kinds have the same members. taught: by name of the target, at
    the reference picture. wrist_from_tag_a: live check that nothing moved, None if tag A is not used.
    adopted: slips since teaching that were taken over, oldest first; they are in the solution.
    """

    id: str
    session: str
    created_unix_s: float
    facts: CellFacts
    taught: Mapping[str, TaughtPoint]
    solution: Solution
    residuals: Mapping[str, float]
    verdict: Verdict
    adopted: tuple[AdoptedSlip, ...] = ()

    @property
    def method(self) -> str:
        """Name of it: "joint", "universal" or "special"."""
        return self.solution.METHOD

    @property
    def base_from_camera(self) -> Pose:
        """Where the camera stands."""
        return self.solution.base_from_camera

    @property
    def wrist_from_tag_a(self) -> Pose | None:
        """Where tag A sits on the flange."""
        return self.solution.wrist_from_tag_a

    @property
    def tcp(self) -> TcpEstimate | None:
        """The touch tip, None where it is not determined (constant wrist, a wrist with one axis)."""
        tcp = self.solution.tcp
        return None if tcp is None or is_open(tcp.covariance) else tcp

    @property
    def tcp_in_wrist(self) -> Array | None:
        """(3,) of it."""
        return None if self.tcp is None else self.tcp.in_wrist

    def taught_rotvec(self, target_name: str) -> Array:
        """(3,) rad of a taught wrist, near those of the other targets: what answers are written near to."""
        first = min(self.taught.values(), key=lambda point: point.target.id)
        wanted = usual_rotvec(first.base_from_work)
        return rotvec_near(self.taught[target_name].base_from_work, wanted)


def expected_coordinate(
    calibration: Calibration,
    target_name: str,
    camera_from_tag_b: TagObservation,
    policy: Policy,
    base_from_work: Array | None = None,
    camera: CameraPlace = UNMOVED,
) -> ExpectedCoordinate:
    """Flange pose at which the work tip meets the target in the picture given.

    policy fixed: the wrist stays at the taught orientation; follow: it turns with the object;
    requested: it stands as base_from_work says. base_from_work: (3, 3), for the other policies
    another orientation for the object as it was taught. camera: where it may stand, and tag A in the
    picture. Raises InputError for an unknown target and for what the calibration cannot serve,
    NotObservable for what it does not know, TagNotSeen where nothing tells where the camera stands,
    Contradiction where something moved that an object with this motion cannot explain.
    """
    taught = _taught(calibration, target_name)
    if policy is Policy.REQUESTED and base_from_work is None:
        raise InputError("policy 'requested' needs the orientation in which the wrist will stand")
    R_work = taught.base_from_work if base_from_work is None else np.asarray(base_from_work)
    facts = calibration.facts
    expected = calibration.solution.expected(
        facts, taught, camera_from_tag_b, policy, R_work, camera
    )
    if not expected.fits and facts.object.motion is not Motion.FREE:
        raise contradiction_of(calibration.solution.examine(facts, camera_from_tag_b, camera))
    return expected


def _taught(calibration: Calibration, target_name: str) -> TaughtPoint:
    try:
        return calibration.taught[target_name]
    except KeyError:
        names = ", ".join(sorted(calibration.taught))
        raise InputError(f"target {target_name!r} was not taught; there are: {names}") from None
