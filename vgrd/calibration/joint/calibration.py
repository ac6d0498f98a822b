"""One recording -> one calibration by the joint estimate, with what speaks against it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.acceptance import accept
from vgrd.calibration.joint.estimate import calibrate_joint, residuals_of
from vgrd.calibration.joint.expected import work_orientation
from vgrd.calibration.joint.fit import JointFit
from vgrd.calibration.joint.knocks import as_seen_in_the_end, camera_moves
from vgrd.calibration.joint.marginal import kept_columns, solution_of
from vgrd.calibration.joint.noise.remarks import level_findings
from vgrd.calibration.joint.problem import EvidenceKind, HolePixel
from vgrd.calibration.joint.robust import touches_left_out
from vgrd.calibration.joint.solution import JointSolution
from vgrd.calibration.joint.state import StepLayout
from vgrd.calibration.outcome import Outcome
from vgrd.calibration.turntable import without_useless_spins
from vgrd.errors import NotObservable
from vgrd.geometry.covariance import rms
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import IRRELEVANT_MM, NOISY_SCALE, WRONG_SIGMA
from vgrd.model import (
    CameraPlace,
    ExpectedCoordinate,
    Finding,
    Motion,
    Policy,
    Recording,
    TagObservation,
    TaughtPoint,
    frozen_array,
    frozen_copy,
    place_in,
)

Case = tuple[TaughtPoint, TagObservation, CameraPlace]
_EXACT = 1e-6  # of the variance of a centre: known a thousand times better
_OUTLIERS: Mapping[str, str] = {
    EvidenceKind.HAND_EYE.value: "look_outlier",
    EvidenceKind.TOUCHES.value: "touch_outlier",
    EvidenceKind.POINTS.value: "point_outlier",
    EvidenceKind.REFERENCE.value: "reference_outlier",
    EvidenceKind.SPINS.value: "spin_outlier",
    EvidenceKind.HOLES.value: "hole_outlier",
}


def calibrate_jointly(
    recording: Recording,
    tolerance_mm: float | None = None,
    policy: Policy = Policy.FIXED,
    sightings: Sequence[HolePixel] = (),
) -> tuple[Outcome[JointSolution], JointFit]:
    """Everything in one maximum-likelihood problem, and the fit that the outcome was taken from.

    tolerance_mm: what 95 % of the misses must stay within under the policy, else the calibration is
    rejected. sightings: holes that the camera saw; those in spins that tell no axis are passed over.
    Raises TooFewObservations, NotObservable (what is missing, in words), InputError or
    DidNotConverge.
    """
    usable, doubts = without_useless_spins(recording)
    holes = [hole for hole in sightings if hole.spin is None or usable.spins]
    fit = calibrate_joint(usable, holes)
    solution = solution_of(fit)
    targets = recording.facts.object.targets
    taught = {
        n: _taught(solution, recording, n) for n in targets if solution.layout.knows(targets[n])
    }
    findings = [*doubts, *_findings(fit, solution)]
    seen = as_seen_in_the_end(fit, recording) if camera_moves(fit) else None
    used = seen or fit.recording
    answers = [(case, _served(solution, used, case, policy)) for case in _cases(used, taught)]
    hardest, worst = max(answers, key=lambda answer: answer[1].u95_mm)
    if tolerance_mm is not None:
        findings.append(accept(worst.u95_mm, tolerance_mm, covariance=worst.position_covariance))
    residuals = _residuals(fit, worst)
    if (knowing := _knowing_center(fit, solution)) is not None:
        exact = _served(knowing, used, hardest, policy)
        residuals["predicted_u95_exact_center_mm"] = exact.u95_mm
    return Outcome(solution, taught, residuals, findings, seen), fit


def _knowing_center(fit: JointFit, solution: JointSolution) -> JointSolution | None:
    """As it would be if CAD's centre were exact; None where there is none."""
    if fit.data.center is None:
        return None
    first = fit.data.rows_of(EvidenceKind.TURNTABLE).start
    rows = fit.jacobian[first : first + 2, kept_columns(fit.layout)]
    C = solution.covariance
    taken = C @ rows.T
    noise = _EXACT * np.eye(2)
    covariance = C - taken @ np.linalg.solve(rows @ taken + noise, taken.T)
    return replace(solution, covariance=frozen_copy(covariance))


def _taught(solution: JointSolution, recording: Recording, name: str) -> TaughtPoint:
    """The target in the base, object as taught. Raises NotObservable where the TCP is missing."""
    target = recording.facts.object.targets[name]
    R_work = work_orientation(recording, name, Policy.FIXED, None)
    n = solution.layout.size
    point, J = solution.taught_place(target)
    J[:, StepLayout.TCP] = -R_work
    open_mm = float(np.abs(J @ solution.undetermined).max(initial=0.0))
    if open_mm > IRRELEVANT_MM:
        raise NotObservable(
            f"where the flange must be for target {name!r} is open by {open_mm:.0f} mm or more: "
            "its work orientation differs from the touches, or too few targets were touched; "
            "touch with the wrist tilted by 20 degrees or more about two axes",
            rank=n - solution.undetermined.shape[1],
            unknowns=n,
        )
    tip = solution.tip_in_wrist + recording.facts.tool.work_from_touch_mm
    return TaughtPoint(
        target=target,
        flange_in_base=frozen_array(point - R_work @ tip, 3),
        base_from_work=frozen_array(R_work, 3, 3),
        covariance=frozen_array(J @ solution.covariance @ J.T, 3, 3),
    )


def _cases(recording: Recording, taught: Mapping[str, TaughtPoint]) -> list[Case]:
    """Every target in every picture of the session."""
    seen = [
        (picture.tag_b, place_in(picture, recording.facts.camera_stability))
        for picture in (*recording.touch_pictures, *recording.spins)
        if picture.tag_b is not None
    ]
    known = [(tag, place) for tag, place in seen if place.flange_tag or not place.is_free]
    if not known:
        raise NotObservable(
            "no picture shows both tags, so nothing tells where a movable camera stood: touch with "
            "both in view",
            rank=0,
            unknowns=6,
        )
    return [(point, tag, place) for point in taught.values() for tag, place in known]


def _served(
    solution: JointSolution, recording: Recording, case: Case, policy: Policy
) -> ExpectedCoordinate:
    """What would be served."""
    point, tag, place = case
    work = np.asarray(point.base_from_work)
    return solution.expected(recording.facts, point, tag, policy, work, place)


def contradicted_targets(fit: JointFit) -> tuple[Finding, ...]:
    """Bare targets whose touches contradict each other without a majority that tells which are right."""
    touched = EvidenceKind.TOUCHES.value
    used = {sample.name: sample.used for sample in fit.samples if sample.kind == touched}
    kept = {name: [0, 0] for name in fit.layout.bare}  # left out, used
    for i, touch in enumerate(fit.recording.touches):
        if touch.target in kept:
            kept[touch.target][used.get(f"touch {i + 1} ({touch.target})", True)] += 1
    return tuple(
        finding(
            "target_contradicted",
            f"the touches of {name}, which has no point_mm, contradict each other, and nothing tells which "
            f"are right: undo those of {name} and touch it three times",
            fatal=True,
        )
        for name, (left_out, in_use) in kept.items()
        if left_out and in_use <= left_out
    )


def _findings(fit: JointFit, solution: JointSolution) -> Iterator[Finding]:
    for sample in fit.samples:
        if not sample.used:
            yield finding(_OUTLIERS[sample.kind], f"{sample.name} was left out, {sample.reason}")
    yield from fit.freed
    yield from level_findings(fit.levels)
    yield from contradicted_targets(fit)
    yield from camera_moves(fit)
    if fit.noise_scale > NOISY_SCALE:
        yield finding(
            "noisy",
            f"the samples scatter {fit.noise_scale:.1f} times as much as robot, camera and touch "
            "promise",
            fatal=fit.noise_scale > WRONG_SIGMA,
        )
    spec = fit.recording.facts.object
    if spec.motion is Motion.TURNTABLE and not fit.layout.spins:
        yield finding(
            "no_pivot", "no rotation centre, expected coordinates rest on the hand-eye translation"
        )
    elif spec.motion is Motion.TURNTABLE and spec.center_in_object is None and spec.has_cad:
        yield finding("no_cad_center", "the turntable's centre is not known in CAD")
    if solution.tcp is None:
        yield finding(
            "tcp_open",
            "the TCP is not determined, which the answers do not need as long as the wrist stands "
            "as it was touched",
        )


def _residuals(fit: JointFit, worst: ExpectedCoordinate) -> dict[str, float]:
    rms_by_kind = residuals_of(fit)
    touches = [s.score for s in fit.samples if s.kind == EvidenceKind.TOUCHES.value and s.used]
    return {
        "touch_rms_mm": rms_by_kind["touches_rms_mm"],
        "touch_worst_sigma": max(touches, default=0.0),
        "hand_eye_rms_mm": rms_by_kind["hand_eye_rms_mm"],
        "hand_eye_rms_deg": rms_by_kind["hand_eye_rms_deg"],
        "noise_scale": fit.noise_scale,
        "predicted_u95_mm": worst.u95_mm,
        "predicted_u95_deg": float(np.degrees(worst.u95_rad)),
        "touch_left_out_mm": rms(touches_left_out(fit)),
        **_of_holes(fit, rms_by_kind),
    }


def _of_holes(fit: JointFit, rms_by_kind: Mapping[str, float]) -> dict[str, float]:
    count = len(fit.data.holes.cad)
    if not count:
        return {}
    return {"holes_used": float(count), "holes_rms_px": rms_by_kind["holes_rms_px"]}
