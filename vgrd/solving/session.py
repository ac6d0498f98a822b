"""Solving a recorded session: the same function for the daemon's child process and for `vgrd solve`.

python -m vgrd.solving.session SESSION_FOLDER STATE_DIR TOLERANCE_MM POLICY STABILITY

STABILITY: of the camera, six sigmas in mm and rad, with commas; inf: people move it.
"""

import json
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import structlog

from vgrd import logs
from vgrd.calibration.blind_spots import sentences
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.confirmation import Confirmation, confirm
from vgrd.calibration.joint import JointSolution
from vgrd.calibration.solve import calibrate_with_fit
from vgrd.clock import Clock, SystemClock
from vgrd.errors import CalibrationError, InternalError, StoreError, VgrdError
from vgrd.geometry import Array
from vgrd.judging.findings import finding
from vgrd.model import Finding, Plan, Policy, Recording, Verdict
from vgrd.orphans import die_with
from vgrd.solving.figures import budget_of, figures
from vgrd.solving.goodness import goodness, levels_of, transforms_of
from vgrd.solving.hole_pictures import draw_searched
from vgrd.solving.hole_sightings import HolesSeen, Report, holes_of, see_holes
from vgrd.solving.insertions import insertion_sentences
from vgrd.solving.sample_numbers import SampleNumbers
from vgrd.solving.servable import places_without_cad, unservable
from vgrd.solving.timing import late_pictures, time_offset_of
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.results import write_result
from vgrd.store.retention import in_use
from vgrd.store.sessions import StoredSession, iterate_images, iterate_observations, load_session
from vgrd.vision.images.drawing import folder_for_pictures

log = structlog.get_logger()


def solve_session(
    folder: Path,
    state_dir: Path | None = None,
    clock: Clock | None = None,
    *,
    tolerance_mm: float | None = None,
    policy: Policy = Policy.FIXED,
    stability: Array | None = None,
    report: Report | None = None,
    draw: Path | None = None,
) -> dict[str, object]:
    """Solve a session folder; JSON-able summary. With `state_dir` calibration and summary are stored.

    tolerance_mm: 95 % of the misses under the policy must be predicted within it; what cannot be
    served under it at all is rejected. stability: (6,) of the camera, as in `CameraPlace`; None: not
    known. Plans joint and special: holes of the object in the stored
    pictures are evidence too; report: called with (done, total) of these; draw: folder for a picture
    of each of these. Raises what `calibrate_with_fit` does, StoreError, and InputError for a folder
    that cannot be written.
    """
    clock = clock or SystemClock()
    pictures = None if draw is None else folder_for_pictures(draw)
    with in_use(folder):
        stored = load_session(folder)
        holes, warnings = _holes_in(folder, stored.recording, report)
        drawn = {} if pictures is None else _drawn(folder, holes, pictures)
        numbers = SampleNumbers(stored)
        try:
            calibration, fit = calibrate_with_fit(
                stored.recording, tolerance_mm, policy, holes.sightings, stability
            )
        except CalibrationError as err:
            err.args = (numbers.told(str(err)),)
            if state_dir is not None:
                asked = {"tolerance_mm": tolerance_mm, "policy": policy.value}
                write_result(folder, {**asked, **_unsolved(folder.name, str(err), clock)})
            raise
        offset = time_offset_of(folder, stored.recording, calibration)
        findings = (
            *calibration.verdict.findings,
            *late_pictures(offset),
            *_unproven_names(stored),
        )
        verdict = Verdict(
            tuple(
                replace(found, message=numbers.told(found.message))
                for found in (*findings, *unservable(calibration, policy))
            )
        )
        calibration = replace(calibration, created_unix_s=clock.wall(), verdict=verdict)
        name = None
        if state_dir is not None and calibration.verdict.ok:
            name = CalibrationStore(state_dir, clock).save(calibration)
    budget = None if fit is None else budget_of(fit, policy)
    result = {
        **goodness(calibration, fit, stored.recording, tolerance_mm, policy, budget),
        "calibration": name,
        "solved_unix_s": calibration.created_unix_s,
        "tolerance_mm": tolerance_mm,
        "policy": policy.value,
        **summary(calibration),
        "transforms": transforms_of(calibration),
        "insertions": insertion_sentences(calibration, stored.recording, policy),
        "harvested": {kind.value: count for kind, count in stored.harvested.items()},
        "time_offset": offset.to_json(),
        "blind_spots": _blind_spots(calibration, stored.recording, stability),
        "holes": {"seen": len(holes.sightings), "unseen": dict(holes.unseen)},
        **drawn,
        "warnings": [*stored.warnings, *warnings],
        "verification": confirm(calibration, stored.recording, tolerance_mm, stability).to_json(),
        **({} if fit is None or budget is None else figures(fit, policy, budget, numbers)),
    }
    if state_dir is not None:
        write_result(folder, result)
    return result


def _unproven_names(stored: StoredSession) -> tuple[Finding, ...]:
    """A pedal names its touches by their order, which CAD cannot check on a ring of holes: a name must be said."""
    last = stored.last_by_foot
    if last is None or any(touch.target == last for touch in stored.recording.verifications):
        return ()
    words = f"touches by foot were named by their order: vgrd verify {last} shows whether the names are right"
    return (finding("names_unproven", words, fatal=True),)


def _blind_spots(
    calibration: Calibration, recording: Recording, stability: Array | None
) -> list[str]:
    """What one picture cannot tell of a cell that can be served by the joint estimate, in sentences."""
    solution = calibration.solution
    if not (calibration.verdict.ok and isinstance(solution, JointSolution)):
        return []
    if stability is None:
        return ["What one picture cannot tell depends on the camera: add --config CELL.toml"]
    return list(sentences(solution, recording, stability))


def _unsolved(session: str, why: str, clock: Clock) -> dict[str, object]:
    """Result of a session without a calibration: an earlier one would be taken for its own."""
    return {
        "good": why,
        "limits": "",
        "add": "",
        "calibration": None,
        "session": session,
        "solved_unix_s": clock.wall(),
        "verdict": {
            "ok": False,
            "findings": [{"code": "not_solved", "message": why, "fatal": True}],
        },
        "verification": {
            **Confirmation((), None).to_json(),
            "words": "there is no calibration to verify",
        },
        "warnings": [],
    }


def _drawn(folder: Path, holes: HolesSeen, pictures: Path) -> dict[str, object]:
    """Files of the pictures for people, drawn before anything can refuse the session."""
    files = draw_searched(holes.pictures, partial(iterate_images, folder), pictures)
    return {"drawn": [str(file) for file in files]}


def _holes_in(
    folder: Path, recording: Recording, report: Report | None
) -> tuple[HolesSeen, list[str]]:
    """Holes in the pictures of a session, where its plan uses them; warnings say what was not read."""
    if recording.plan not in (Plan.JOINT, Plan.SPECIAL) or not holes_of(recording):
        return HolesSeen(), []
    try:
        observations = list(iterate_observations(folder))
        if not observations:
            return HolesSeen(), ["solved without the holes: the session has no pictures"]
        return see_holes(recording, observations, partial(iterate_images, folder), report), []
    except (StoreError, CalibrationError) as err:
        return HolesSeen(), [f"solved without the holes in the pictures: {err}"]


def summary(calibration: Calibration) -> dict[str, object]:
    """What a person wants to know of a calibration, JSON-able."""
    tcp = calibration.tcp
    return {
        "session": calibration.session,
        "method": calibration.method,
        "tcp_in_wrist_mm": None if tcp is None else [float(value) for value in tcp.in_wrist],
        "tcp_sigma_mm": None
        if tcp is None
        else [float(value) for value in np.sqrt(np.diag(tcp.covariance))],
        "without_cad": places_without_cad(calibration),
        "levels": levels_of(calibration),
        "residuals": {key: float(value) for key, value in calibration.residuals.items()},
        "verdict": {
            "ok": calibration.verdict.ok,
            "findings": [
                {"code": finding.code, "message": finding.message, "fatal": finding.fatal}
                for finding in calibration.verdict.findings
            ],
        },
    }


def _log_progress(count: int, total: int) -> None:
    log.info("looking_for_holes", picture=count, of=total)


def main(argv: list[str] | None = None) -> int:
    """Entry point of the solver process: one JSON line on standard output."""
    folder, state_dir, tolerance_mm, policy, stability = (argv or sys.argv)[1:]
    die_with(os.getppid())
    logs.configure("solver")
    try:
        result = solve_session(
            Path(folder),
            Path(state_dir),
            tolerance_mm=float(tolerance_mm),
            policy=Policy(policy),
            stability=np.array([float(sigma) for sigma in stability.split(",")]),
            report=_log_progress,
        )
        reply = {"ok": True, "result": result}
    except VgrdError as err:
        reply = {"ok": False, "error": type(err).__name__, "message": str(err)}
    except Exception as err:
        log.exception("solve_failed")
        fault = InternalError.of("solve", err)
        reply = {"ok": False, "error": type(fault).__name__, "message": str(fault)}
    sys.stdout.write(json.dumps(reply, allow_nan=False) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
