"""One recording -> one calibration by the paper's plans: hand-eye, touches, reference picture, pivot."""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.hand_eye import (
    HandEyeProblem,
    HandEyeResult,
    calibrate_hand_eye,
    hand_eye_samples,
    null_space_findings,
)
from vgrd.calibration.joint import HolePixel
from vgrd.calibration.outcome import Outcome
from vgrd.calibration.stepwise.chain import CameraChain, Pivot
from vgrd.calibration.stepwise.hole_center import HoleCenter, combine, find_hole_center
from vgrd.calibration.stepwise.solution import SpecialSolution, UniversalSolution
from vgrd.calibration.stepwise.touch_fit import FittedTouches, fit_touches
from vgrd.calibration.stepwise.verdict import StepwiseEvidence, judge
from vgrd.calibration.touches import find_reference, find_reference_tag_a
from vgrd.calibration.turntable import RotationCenter, find_rotation_center
from vgrd.errors import DidNotConverge, NotObservable, TooFewObservations
from vgrd.geometry import Array
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import PIVOT_APART_MM, REACH_MM, UNKNOWN_MM
from vgrd.model import Finding, Observation, Recording, frozen_array

_APART_SIGMA, _APART_MM = 5.0, 0.1  # beyond both the holes are believed (decision 6)


def calibrate_in_steps(
    recording: Recording, sightings: Sequence[HolePixel]
) -> Outcome[UniversalSolution | SpecialSolution]:
    """Universal where the wrists varied, else special.

    The holes that the camera saw (`sightings`) tell the rotation centre, see `find_hole_center`.
    Raises TooFewObservations, NotObservable, InputError or DidNotConverge.
    """
    taught = fit_touches(recording)
    center, doubts = _center(recording)
    holes = _hole_center(recording, sightings, doubts)
    needs_rotation_only = (
        taught.tcp is None
        and taught.pivot_in_base is not None
        and (center is not None or holes is not None)
    )
    hand_eye = calibrate_hand_eye(
        _hand_eye_problem(
            recording,
            allow_unobservable=int(needs_rotation_only or taught.open_axis is not None),
        )
    )
    doubts += null_space_findings(recording.facts.mount, hand_eye.null_space)
    reference = find_reference(recording.touches)
    pivot = _pivot(taught, center, holes, hand_eye, recording.facts.object.center_sigma_mm, doubts)
    if pivot is None and center is not None and recording.facts.object.has_cad:
        doubts.append(
            finding(
                "no_cad_center",
                "the turntable's centre is not known in CAD, the hand-eye translation is used",
            )
        )
    evidence = StepwiseEvidence(recording, taught, hand_eye, reference, center, pivot is not None)
    findings, residuals = judge(evidence)
    if holes is not None:
        residuals["holes_used"] = float(holes.used)
    chain = CameraChain(
        hand_eye.mount_from_camera,
        frozen_array(_camera_covariance(hand_eye), 6, 6),
        reference.camera_from_tag_b,
        reference.covariance,
    )
    points, covariances = taught.points(has_pivot=pivot is not None)
    solution: UniversalSolution | SpecialSolution
    if taught.tcp is None:
        solution = SpecialSolution(
            chain,
            hand_eye.mount_from_target,
            pivot,
            covariances,
            find_reference_tag_a(recording),
        )
    else:
        tag_a = hand_eye.mount_from_target
        solution = UniversalSolution(chain, tag_a, pivot, covariances, taught.tcp)
    return Outcome(solution, points, residuals, [*doubts, *findings])


def _camera_covariance(hand_eye: HandEyeResult) -> Array:
    """(6, 6) of base_from_camera, with a metre where its place stays open."""
    open_mm = (
        np.sqrt(2)
        * UNKNOWN_MM
        * np.hstack([hand_eye.null_space[:, :3], 0 * hand_eye.null_space[:, 3:]])
    )
    return np.asarray(hand_eye.covariance[:6, :6] + open_mm.T @ open_mm)


def _hand_eye_problem(recording: Recording, allow_unobservable: int) -> HandEyeProblem:
    samples = hand_eye_samples(recording)
    if len(samples) < 3:
        raise TooFewObservations(
            f"hand-eye: tag A was seen from {len(samples)} robot poses, at least 3 are needed: "
            "record looks with tag A in view and the wrist turned about two axes"
        )
    sigma = max(recording.facts.flange_sigma_mm, 1e-3)
    return HandEyeProblem(
        mount=recording.facts.mount,
        samples=samples,
        robot_sigma_mm=sigma,
        robot_sigma_rad=sigma / REACH_MM,
        allow_unobservable=allow_unobservable,
    )


def _center(recording: Recording) -> tuple[RotationCenter | None, list[Finding]]:
    """Rotation centre from the spins, or the reason why there is none."""
    tags = [spin.tag_b for spin in _with_tag_b(recording.spins) if spin.tag_b is not None]
    if not recording.spins:
        return None, []
    try:
        center = find_rotation_center(
            [tag.camera_from_tag for tag in tags], [tag.covariance for tag in tags]
        )
    except (NotObservable, TooFewObservations) as fault:
        return None, [finding("spins_unusable", f"no rotation centre: {fault}")]
    return center, []


def _with_tag_b(observations: Sequence[Observation]) -> list[Observation]:
    return [observation for observation in observations if observation.tag_b is not None]


def _hole_center(
    recording: Recording,
    sightings: Sequence[HolePixel],
    doubts: list[Finding],
) -> HoleCenter | None:
    """CAD's centre in tag B by the holes that were seen, or a doubt that says why not."""
    if not sightings or recording.facts.object.center_in_object is None:
        return None
    try:
        return find_hole_center(recording, sightings, find_reference(recording.touches))
    except (NotObservable, TooFewObservations, DidNotConverge) as fault:
        doubts.append(finding("holes_unusable", f"no rotation centre by holes: {fault}"))
        return None


def _pivot(
    taught: FittedTouches,
    center: RotationCenter | None,
    holes: HoleCenter | None,
    hand_eye: HandEyeResult,
    center_sigma_mm: float,
    doubts: list[Finding],
) -> Pivot | None:
    """Bring the centre in tag B and the centre in CAD together, at the same height if possible."""
    if taught.pivot_in_base is None or (center is None and holes is None):
        return None
    if holes is not None:
        in_tag, covariance = _by_holes(holes, center, center_sigma_mm, doubts)
    elif center is not None:
        in_tag, covariance = center.center_in_tag, center.covariance[:3, :3]
        if taught.tcp is not None:
            pivot_in_camera = hand_eye.mount_from_camera.inverse() @ taught.pivot_in_base
            in_tag, _ = center.at_height(pivot_in_camera)
    return Pivot(
        frozen_array(in_tag, 3),
        frozen_array(taught.pivot_in_base, 3),
        frozen_array(covariance, 3, 3),
    )


def _by_holes(
    holes: HoleCenter,
    center: RotationCenter | None,
    center_sigma_mm: float,
    doubts: list[Finding],
) -> tuple[Array, Array]:
    """The centre (3,) in tag B and its covariance, together with the axis where they agree."""
    if center is None:
        return holes.center_in_tag, holes.covariance
    both = combine(holes, center, center_sigma_mm)
    if both.apart_sigmas <= _APART_SIGMA or both.apart_mm <= _APART_MM:
        return both.center_in_tag, both.covariance
    doubts.append(
        finding(
            "pivot_disagrees",
            f"holes and turning see the rotation centre {both.apart_mm:.2f} mm "
            f"({both.apart_sigmas:.0f} sigma) apart, that of the holes is used",
            fatal=both.apart_mm > PIVOT_APART_MM,
        )
    )
    return holes.center_in_tag, holes.covariance
