"""One recording -> one calibration: hand-eye, TCP and object, reference picture, pivot, verdict."""

from collections.abc import Sequence
from dataclasses import replace

from vgrd.calibration.calibration import Calibration, Solution
from vgrd.calibration.checks import cannot_tell, check_plan, examine, mistakes
from vgrd.calibration.joint import HolePixel, JointFit, calibrate_jointly
from vgrd.calibration.outcome import Outcome
from vgrd.calibration.stepwise import calibrate_in_steps
from vgrd.calibration.verification import verify
from vgrd.errors import CalibrationError, DidNotConverge, InputError
from vgrd.geometry import Array
from vgrd.judging.findings import FOLLOWING
from vgrd.model import Finding, Mount, Plan, Policy, Recording, Verdict


def calibrate_system(
    recording: Recording,
    tolerance_mm: float | None = None,
    policy: Policy = Policy.FIXED,
    sightings: Sequence[HolePixel] = (),
    stability: Array | None = None,
) -> Calibration:
    """The calibration of `calibrate_with_fit`."""
    return calibrate_with_fit(recording, tolerance_mm, policy, sightings, stability)[0]


def calibrate_with_fit(
    recording: Recording,
    tolerance_mm: float | None = None,
    policy: Policy = Policy.FIXED,
    sightings: Sequence[HolePixel] = (),
    stability: Array | None = None,
) -> tuple[Calibration, JointFit | None]:
    """Solve everything that the recording tells; id is "" and the time 0, for the caller to set.

    Plan joint: everything in one estimate, holes that the camera saw (`sightings`) included, see
    `calibrate_jointly`. The other plans are the paper's methods, step by step: universal where the
    wrists varied, else special from CAD-fitted flange positions; the holes then tell the rotation
    centre, see `find_hole_center`. Doubts are findings of the verdict. stability: (6,) of the camera,
    for the held-out touches, see `verify`. The fit is that of plan joint, None in the others.
    Raises TooFewObservations, NotObservable (what is missing, in words), InputError or
    DidNotConverge; CalibrationError with the mistake in the samples where the checks name one.
    """
    facts = recording.facts
    if facts.mount is not Mount.EYE_TO_HAND:
        raise InputError(
            "serving needs a camera that stands still (eye-to-hand); an eye-in-hand camera can "
            "be calibrated as a dataset: vgrd solve DATASET"
        )
    check_plan(recording.plan, facts)
    findings = examine(recording, policy)
    try:
        outcome: Outcome[Solution]
        fit: JointFit | None = None
        if recording.plan is Plan.JOINT:
            outcome, fit = calibrate_jointly(recording, tolerance_mm, policy, sightings)
        else:
            outcome = calibrate_in_steps(recording, sightings)
    except CalibrationError as err:
        if wrong := mistakes(findings):
            raise CalibrationError("; ".join(remark.message for remark in wrong)) from err
        why = "; ".join(remark.message for remark in findings if remark.fatal)
        if why and isinstance(err, DidNotConverge):
            raise DidNotConverge(f"{why} ({err})") from err
        raise
    if outcome.recording is not None:
        recording = outcome.recording
        findings = examine(recording, policy)
    calibration = Calibration(
        id="",
        session=recording.session,
        created_unix_s=0.0,
        facts=facts,
        taught=outcome.taught,
        solution=outcome.solution,
        residuals=outcome.residuals,
        verdict=Verdict(),
    )
    verified, misses = verify(calibration, recording.verifications, stability)
    calibration = replace(
        calibration,
        residuals={**outcome.residuals, **misses},
        verdict=Verdict(
            (
                *findings,
                *cannot_tell(facts),
                *_of_their_own(outcome.findings, mistakes(findings)),
                *verified,
            )
        ),
    )
    return calibration, fit


def _of_their_own(found: Sequence[Finding], wrong: Sequence[Finding]) -> list[Finding]:
    """What was found in the estimate, without what only follows from a mistake that is named already.

    An estimate of samples that were meant otherwise blames whichever of them lies farthest from the mean.
    """
    return [remark for remark in found if not (wrong and remark.code in FOLLOWING)]
