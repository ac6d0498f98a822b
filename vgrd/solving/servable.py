"""Whether a calibration can serve: this cell, and its targets under a policy; tried before it is activated."""

from collections.abc import Iterator, Sequence

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.joint import JointSolution
from vgrd.errors import CalibrationError, CalibrationMismatch, Contradiction, InputError
from vgrd.geometry import Pose
from vgrd.judging.findings import finding
from vgrd.model import CellFacts, Finding, Policy, TagObservation, frozen_array
from vgrd.solving.differences import fact_differences

# An object turned a little and a lot: what a turn needs and the recording did not tell shows in both.
TURNS_RAD = (0.0, 0.3, -1.5)  # as taught, a little, a lot


def check_usable(calibration: Calibration, configured: CellFacts) -> None:
    """Raise InputError for one that was rejected, CalibrationMismatch for one of another cell."""
    if not calibration.verdict.ok:
        reasons = "; ".join(f.message for f in calibration.verdict.findings if f.fatal)
        raise InputError(f"{calibration.id} was rejected: {reasons}")
    differences = fact_differences(calibration.facts, configured)
    if differences:
        raise CalibrationMismatch(
            f"{calibration.id} was made for another cell: {'; '.join(differences)}. "
            "Teach again, or restore the cell file"
        )


def places_without_cad(calibration: Calibration) -> dict[str, object]:
    """Where the targets without CAD were found, in tag B's frame; None while the TCP is open."""
    bare = [name for name in calibration.facts.object.bare if name in calibration.taught]
    points = {
        name: calibration.solution.in_tag_b(calibration.facts, calibration.taught[name])
        for name in bare
    }
    return {
        name: None
        if point is None
        else {
            "in_tag_b_mm": [float(value) for value in point.in_tag_b],
            "sigma_mm": [float(value) for value in np.sqrt(np.diag(point.covariance))],
        }
        for name, point in points.items()
    }


def unservable(calibration: Calibration, policy: Policy) -> Sequence[Finding]:
    """Fatal findings for targets of which every request under the policy would be refused."""
    refused: dict[str, list[str]] = {}
    for name in sorted(calibration.taught):
        if reason := _refusal(calibration, name, policy):
            refused.setdefault(reason, []).append(name)
    return tuple(
        finding(
            "cannot_be_served",
            f"{', '.join(names)} cannot be served under policy {policy.value}: {reason}",
            fatal=True,
        )
        for reason, names in refused.items()
    )


def _refusal(calibration: Calibration, name: str, policy: Policy) -> str:
    """Why a request for a target is refused, empty when it is not."""
    for tag_b in _pictures(calibration):
        try:
            expected_coordinate(calibration, name, tag_b, policy)
        except (CalibrationError, Contradiction, InputError) as err:
            return str(err)
    return ""


def _pictures(calibration: Calibration) -> Iterator[TagObservation]:
    """Tag B as it would be seen with the object turned about its own axis."""
    solution = calibration.solution
    reference, axis = solution.camera_from_tag_b, solution.camera_from_axis
    for angle_rad in TURNS_RAD:
        turn = axis @ Pose.from_rotvec((0.0, 0.0, angle_rad)) @ axis.inverse()
        seen = turn @ reference
        if isinstance(solution, JointSolution):
            seen = solution.measured_tag_b(calibration.facts, seen)
        yield TagObservation(
            calibration.facts.tag_b,
            seen,
            solution.reference_covariance,
            frozen_array(np.zeros((4, 2)), 4, 2),
            rms_px=0.0,
        )
