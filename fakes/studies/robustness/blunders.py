"""Blunders: one touch of eight is off by 2 mm; whether it is named, and what it does to the EC.

Two estimates of the same session: `system`, from the closed methods, where `undone` is the
calibration after the operator took back the touches that the verdict named and touched nothing
again; `joint`, which leaves out by itself what it names.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.sessions import Session
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.noise import COARSE
from fakes.world.simulation import WORK_ROTATION, SimulatedRequest, Simulation
from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.joint import EvidenceKind, JointFit, calibrate_joint, expected_by_joint
from vgrd.calibration.solve import calibrate_system
from vgrd.charts import COLORS, legend, panels
from vgrd.errors import CalibrationError
from vgrd.geometry import Pose
from vgrd.model import ExpectedCoordinate, Plan, Policy, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSIONS: Mapping[str, Session] = {  # 8 touches tell which one is off
    "one wrist": Session(Plan.SPECIAL, looks=8, spins=10, touches=8),
    "tilted": Session(Plan.UNIVERSAL, looks=8, spins=10, touches=8, tilted=4),
}
_BLUNDER_MM = 2.0  # nine sigmas of a touch: to be named, and small enough to be overlooked
_REQUESTS = 3  # as in table 3
_NUMBER = re.compile(r"touch (\d+) ")


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Whether the bad touch was named, good ones blamed, and the mean miss of three requests, mm."""
    cell = Simulation(seed, vision=COARSE)
    clean = _SESSIONS[parameters["session"]].record(cell)
    bad = int(cell.rng.integers(len(clean.touches)))
    blundered = _with_blunder(clean, bad, cell)
    requests = [cell.request() for _ in range(_REQUESTS)]
    return _of_system(cell, clean, blundered, bad, requests) | _of_joint(
        cell, clean, blundered, bad, requests
    )


def _of_system(
    cell: Simulation,
    clean: Recording,
    blundered: Recording,
    bad: int,
    requests: list[SimulatedRequest],
) -> dict[str, float]:
    baseline, result = calibrate_system(clean), calibrate_system(blundered)
    left, named = _undone(blundered)
    undone = calibrate_system(left)
    return {
        "system, named": float(bad in named),
        "system, blamed": float(len(named - {bad})),
        "system, false_alarms": float(len(_named(baseline))),
        "system, refused_verdict": float(not result.verdict.ok),
        "system, clean_mm": _miss(cell, partial(_system_answer, baseline), requests),
        "system, kept_mm": _miss(cell, partial(_system_answer, result), requests),
        "system, undone_mm": _miss(cell, partial(_system_answer, undone), requests),
    }


def _of_joint(
    cell: Simulation,
    clean: Recording,
    blundered: Recording,
    bad: int,
    requests: list[SimulatedRequest],
) -> dict[str, float]:
    baseline, result = calibrate_joint(clean), calibrate_joint(blundered)
    named = _left_out(result)
    return {
        "joint, named": float(bad in named),
        "joint, blamed": float(len(named - {bad})),
        "joint, false_alarms": float(len(_left_out(baseline))),
        "joint, clean_mm": _miss(cell, partial(_joint_answer, baseline), requests),
        "joint, kept_mm": _miss(cell, partial(_joint_answer, result), requests),
    }


def _with_blunder(recording: Recording, index: int, cell: Simulation) -> Recording:
    direction = cell.rng.normal(size=3)
    shift = _BLUNDER_MM * direction / np.linalg.norm(direction)
    touches = list(recording.touches)
    pose = touches[index].base_from_wrist
    bad_pose = Pose(pose.rotation, pose.translation + shift)
    touches[index] = replace(touches[index], base_from_wrist=bad_pose)
    return replace(recording, touches=tuple(touches))


def _undone(recording: Recording) -> tuple[Recording, set[int]]:
    """Session after undoing what the verdict named, one after the other, and their indices."""
    indices = list(range(len(recording.touches)))
    named: set[int] = set()
    left = recording
    while outliers := _named(calibrate_system(left)):
        named |= {indices[i] for i in outliers}
        indices = [i for i in range(len(recording.touches)) if i not in named]
        left = replace(recording, touches=tuple(recording.touches[i] for i in indices))
    return left, named


def _named(calibration: Calibration) -> set[int]:
    """Indices of the touches that the verdict calls outliers."""
    words = [f.message for f in calibration.verdict.findings if f.code == "touch_outlier"]
    return {int(match[1]) - 1 for text in words if (match := _NUMBER.match(text))}


def _left_out(result: JointFit) -> set[int]:
    """Indices of the touches that the joint estimate names."""
    names = [s.name for s in result.samples if s.kind == EvidenceKind.TOUCHES and not s.used]
    return {int(match[1]) - 1 for name in names if (match := _NUMBER.match(name))}


def _system_answer(calibration: Calibration, request: SimulatedRequest) -> ExpectedCoordinate:
    tag = request.seen.tag_b
    if tag is None:
        raise CalibrationError("tag B is not in the picture")
    return expected_coordinate(calibration, request.target, tag, Policy.FIXED, WORK_ROTATION)


def _joint_answer(result: JointFit, request: SimulatedRequest) -> ExpectedCoordinate:
    return expected_by_joint(result, request.target, request.seen, Policy.FIXED, WORK_ROTATION)


def _miss(
    cell: Simulation,
    answer: Callable[[SimulatedRequest], ExpectedCoordinate],
    requests: list[SimulatedRequest],
) -> float:
    """Mean length of the miss, mm."""
    misses = [cell.miss(request, answer(request).base_from_wrist) for request in requests]
    return float(np.mean(np.linalg.norm(misses, axis=1)))


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in _SESSIONS:
        for estimate in ("system", "joint"):
            figures += _of_estimate(trials, name, estimate)
        rejected = 100 * trials.mean("system, refused_verdict", session=name)
        figures.append(Figure(f"system, {name}: calibration rejected", rejected, "%"))
    return figures


def _of_estimate(trials: Trials, name: str, estimate: str) -> list[Figure]:
    def mean(column: str) -> float:
        return trials.mean(f"{estimate}, {column}", session=name)

    about, clean_mm, blundered_mm = f"{estimate}, {name}", mean("clean_mm"), mean("kept_mm")
    figures = [Figure(f"{about}: blunder named", 100 * mean("named"), "%", at_least=95)]
    if estimate == "joint":
        figures.append(
            Figure(f"{about}: EC error, kept / clean", blundered_mm / clean_mm, at_most=1.3)
        )
    else:
        undone = mean("undone_mm") / clean_mm
        figures += [
            Figure(f"{about}: EC error, undone / clean", undone, at_most=1.3),
            Figure(f"{about}: EC error, kept / clean", blundered_mm / clean_mm),
        ]
    return [
        *figures,
        Figure(f"{about}: EC error, clean", clean_mm, "mm"),
        Figure(f"{about}: good touches blamed per session", mean("blamed")),
        Figure(f"{about}: touches blamed per clean session", mean("false_alarms")),
    ]


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(session="tilted"))
    drawing, all_axes = panels(
        f"One of 8 touches off by {_BLUNDER_MM:g} mm, {runs} sessions each",
        *[("miss of the expected coordinate, mm", "share of sessions")] * len(_SESSIONS),
    )
    kinds = {
        "joint, clean_mm": "joint, no blunder",
        "joint, kept_mm": "joint, blunder kept",
        "system, undone_mm": "system, named touches undone",
        "system, kept_mm": "system, blunder kept",
    }
    for axes, name in zip(all_axes, _SESSIONS, strict=True):
        for color, (column, words) in zip(COLORS, kinds.items(), strict=False):
            values = np.sort(trials.values(column, session=name))
            axes.plot(
                values, np.arange(1, len(values) + 1) / len(values), color=color, label=words
            )
        share = 100 * trials.mean("joint, named", session=name)
        axes.set(title=f"{name}: joint names {share:.1f} %", xlim=(0, 1), ylim=(0, 1))
    legend(all_axes[0], "lower right")
    return drawing


STUDY = Study(
    name="blunders",
    title="One blunder among eight touches",
    cases=tuple({"session": name} for name in _SESSIONS),
    runs=500,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
