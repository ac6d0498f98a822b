"""One recording -> one calibration by the joint estimate, with what speaks against it."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from vgrd.calibration.acceptance import accept
from vgrd.calibration.joint.basis import Basis, basis_of, to_store
from vgrd.calibration.joint.estimate import JointResult, Sighting, calibrate_joint
from vgrd.calibration.joint.expected import expected_from, work_orientation
from vgrd.calibration.joint.problem import EvidenceKind
from vgrd.calibration.joint.rows import left_jacobian
from vgrd.calibration.joint.state import Layout
from vgrd.calibration.turntable.usable_spins import without_useless_spins
from vgrd.errors import NotObservable
from vgrd.geometry import Array
from vgrd.model import (
    Calibration,
    ExpectedCoordinate,
    Finding,
    Motion,
    Policy,
    Recording,
    TaughtPoint,
    Verdict,
    frozen_array,
)

_KNOWN_MM = 0.25
_NOISY = 3.0
WRONG_SIGMA = 6.0  # residuals so large are a mistake, not noise: 3 sigma is met by chance
_OUTLIERS: Mapping[str, tuple[str, str]] = {
    EvidenceKind.HAND_EYE.value: ("look_outlier", "tag A does not fit there: look again"),
    EvidenceKind.TOUCHES.value: ("touch_outlier", "undo it and touch that target again"),
    EvidenceKind.POINTS.value: ("point_outlier", "undo it and touch the point again"),
    EvidenceKind.REFERENCE.value: ("reference_outlier", "hold the object still while touching"),
    EvidenceKind.SPINS.value: (
        "spin_outlier",
        "the object slipped or the picture was bad: spin again",
    ),
    EvidenceKind.HOLES.value: ("hole_outlier", "check its CAD point and hole_diameter_mm"),
}


def calibrate_jointly(
    recording: Recording,
    tolerance_mm: float | None = None,
    policy: Policy = Policy.FIXED,
    sightings: Sequence[Sighting] = (),
) -> Calibration:
    """Everything in one maximum-likelihood problem; id is "" and the time 0, for the caller to set.

    tolerance_mm: what 95 % of the misses must stay within under the policy, else the calibration is
    rejected. sightings: holes that the camera saw; those in spins that tell no axis are passed over.
    Raises TooFewObservations, NotObservable (what is missing, in words), InputError or
    DidNotConverge.
    """
    usable, doubts = without_useless_spins(recording)
    kept = [one for one in sightings if one.spin is None or usable.spins]
    result = calibrate_joint(usable, kept)
    basis = basis_of(result)
    taught = {name: _taught(basis, recording, name) for name in recording.facts.object.targets}
    expected = _foreseen(basis, result, taught, policy)
    findings = [*doubts, *_findings(result)]
    worst = max(expected, key=lambda one: one.u95_mm)
    if tolerance_mm is not None:
        findings.append(accept(worst.u95_mm, tolerance_mm, covariance=worst.position_covariance))
    covariance = result.covariance + result.undetermined @ result.undetermined.T
    tcp_known = _is_known(result, Layout.TCP)
    state = result.state
    return Calibration(
        id="",
        session=recording.session,
        created_unix_s=0.0,
        method="joint",
        facts=recording.facts,
        base_from_camera=state.base_from_camera,
        hand_eye_covariance=_block(covariance, Layout.CAMERA),
        wrist_from_tag_a=state.wrist_from_tag_a,
        tcp_in_wrist=frozen_array(state.tcp_in_wrist, 3) if tcp_known else None,
        tcp_covariance=_block(covariance, Layout.TCP) if tcp_known else None,
        camera_from_tag_b_ref=state.camera_from_tag_b,
        pivot_in_tag_b=None,
        pivot_in_base=None,
        taught=taught,
        residuals=_residuals(result, worst.u95_mm),
        verdict=Verdict(tuple(findings)),
        reference_covariance=_block(covariance, Layout.TAG_B),
        joint=to_store(basis),
    )


def _block(covariance: Array, part: slice) -> Array:
    block = covariance[part, part]
    return frozen_array(block, *block.shape)


def _is_known(result: JointResult, part: slice) -> bool:
    return float(np.abs(result.undetermined[part]).max(initial=0.0)) < _KNOWN_MM


def _taught(basis: Basis, recording: Recording, name: str) -> TaughtPoint:
    """The target in the base, object as taught. Raises NotObservable where the TCP is missing."""
    target = recording.facts.object.targets[name]
    R_work = work_orientation(recording, name, Policy.FIXED, None)
    state, n = basis.state, basis.layout.size
    at = state.base_from_object @ np.asarray(target.point_in_object)
    by = np.zeros((3, n))
    by[:, Layout.OBJECT] = left_jacobian(at[None])[0]
    by[:, Layout.TCP] = -R_work
    open_mm = float(np.abs(by @ basis.undetermined).max(initial=0.0))
    if open_mm > _KNOWN_MM:
        raise NotObservable(
            f"where the flange must be for target {name!r} is open by {open_mm:.0f} mm or more: "
            "its work orientation differs from the touches, or too few targets were touched; "
            "touch with the wrist tilted by 20 degrees or more about two axes",
            rank=n - basis.undetermined.shape[1],
            unknowns=n,
        )
    tip = state.tcp_in_wrist + recording.facts.tool.work_from_touch_mm
    return TaughtPoint(
        target=target,
        flange_in_base=frozen_array(at - R_work @ tip, 3),
        base_from_work=frozen_array(R_work, 3, 3),
        covariance=frozen_array(by @ basis.covariance @ by.T, 3, 3),
    )


def _foreseen(
    basis: Basis, result: JointResult, taught: Mapping[str, TaughtPoint], policy: Policy
) -> list[ExpectedCoordinate]:
    """What would be served in the pictures of the session."""
    recording = result.recording
    seen = [touch.observation for touch in recording.touches] + list(recording.spins)
    tags = [one.tag_b for one in seen if one is not None and one.tag_b is not None]
    return [
        expected_from(basis, name, tag, policy, np.asarray(point.base_from_work))
        for name, point in taught.items()
        for tag in tags
    ]


def _findings(result: JointResult) -> Iterator[Finding]:
    for sample in result.samples:
        if not sample.used:
            code, remedy = _OUTLIERS[sample.kind]
            yield Finding(code, f"{sample.name} was left out: {sample.reason}; {remedy}")
    if result.noise_scale > _NOISY:
        yield Finding(
            "noisy",
            f"the samples scatter {result.noise_scale:.1f} times as much as robot, camera and touch "
            "promise: check intrinsics, tag sizes and CAD points, and that nothing is loose",
            fatal=result.noise_scale > WRONG_SIGMA,
        )
    spec = result.recording.facts.object
    if spec.motion is Motion.TURNTABLE and not result.layout.spins:
        yield Finding(
            "no_pivot",
            "no rotation centre: expected coordinates rest on the hand-eye translation; record "
            "spins of the turntable",
        )
    elif spec.motion is Motion.TURNTABLE and spec.center_in_object is None:
        yield Finding(
            "no_cad_center",
            "the turntable's centre is not known in CAD: set [object] center_mm for less error",
        )
    if not _is_known(result, Layout.TCP):
        yield Finding(
            "tcp_open",
            "the TCP is not determined, which the answers do not need as long as the wrist stands "
            "as it was touched; touch with tilted wrists to know it",
        )


def _residuals(result: JointResult, worst_u95_mm: float) -> dict[str, float]:
    touches = [s.score for s in result.samples if s.kind == EvidenceKind.TOUCHES.value and s.used]
    return {
        "touch_rms_mm": result.residuals["touches_rms_mm"],
        "touch_worst_sigma": max(touches, default=0.0),
        "hand_eye_rms_mm": result.residuals["hand_eye_rms_mm"],
        "hand_eye_rms_deg": result.residuals["hand_eye_rms_deg"],
        "noise_scale": result.noise_scale,
        "predicted_u95_mm": worst_u95_mm,
        **_of_holes(result),
    }


def _of_holes(result: JointResult) -> dict[str, float]:
    count = len(result.data.holes.cad)
    if not count:
        return {}
    return {"holes_used": float(count), "holes_rms_px": result.residuals["holes_rms_px"]}
