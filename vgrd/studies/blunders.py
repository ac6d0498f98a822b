"""Blunders: one touch of eight is off by 2 mm; whether it is named, and what it does to the EC.

`undone` is the calibration after the operator took back the touches that the verdict named and
touched nothing again.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from vgrd.calibration.system import calibrate_system, expected_coordinate
from vgrd.errors import CalibrationError
from vgrd.geometry import Pose
from vgrd.model import Calibration, Plan, Policy, Recording
from vgrd.studies.drawing import COLORS, legend, panels
from vgrd.studies.sessions import Session
from vgrd.studies.simulation import COARSE, WORK_ROTATION, Request, Simulation
from vgrd.studies.study import Figure, Parameters, Study, Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSIONS: Mapping[str, Session] = {
    "one wrist": Session(Plan.SPECIAL, looks=8, spins=10, touches=8),
    "tilted": Session(Plan.UNIVERSAL, looks=8, spins=10, touches=8, tilted=4),
}
_BLUNDER_MM = 2.0
_REQUESTS = 3
_NUMBER = re.compile(r"touch (\d+) ")


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Whether the bad touch was named, good ones blamed, and the mean miss of three requests, mm."""
    cell = Simulation(seed, vision=COARSE)
    clean = _SESSIONS[parameters["session"]].record(cell)
    bad = int(cell.rng.integers(len(clean.touches)))
    blundered = _with_blunder(clean, bad, cell)
    requests = [cell.request() for _ in range(_REQUESTS)]
    without = calibrate_system(clean)
    kept = calibrate_system(blundered)
    left, named = _undone(blundered)
    return {
        "named": float(bad in named),
        "blamed": float(len(named - {bad})),
        "false_alarms": float(len(_named(without))),
        "refused_verdict": float(not kept.verdict.ok),
        "clean_mm": _miss(cell, without, requests),
        "kept_mm": _miss(cell, kept, requests),
        "undone_mm": _miss(cell, calibrate_system(left), requests),
    }


def _with_blunder(recording: Recording, index: int, cell: Simulation) -> Recording:
    direction = cell.rng.normal(size=3)
    shift = _BLUNDER_MM * direction / np.linalg.norm(direction)
    touches = list(recording.touches)
    pose = touches[index].base_from_wrist
    moved = Pose(pose.rotation, pose.translation + shift)
    touches[index] = replace(touches[index], base_from_wrist=moved)
    return replace(recording, touches=tuple(touches))


def _undone(recording: Recording) -> tuple[Recording, set[int]]:
    """Session after undoing what the verdict named, one after the other, and their indices."""
    kept = list(range(len(recording.touches)))
    named: set[int] = set()
    left = recording
    while found := _named(calibrate_system(left)):
        named |= {kept[i] for i in found}
        kept = [i for i in range(len(recording.touches)) if i not in named]
        left = replace(recording, touches=tuple(recording.touches[i] for i in kept))
    return left, named


def _named(calibration: Calibration) -> set[int]:
    """Indices of the touches that the verdict calls outliers."""
    words = [f.message for f in calibration.verdict.findings if f.code == "touch_outlier"]
    return {int(match[1]) - 1 for text in words if (match := _NUMBER.match(text))}


def _miss(cell: Simulation, calibration: Calibration, requests: list[Request]) -> float:
    """Mean length of the miss, mm."""
    lengths = []
    for request in requests:
        tag = request.seen.tag_b
        if tag is None:
            raise CalibrationError("tag B is not in the picture")
        expected = expected_coordinate(
            calibration, request.target, tag, Policy.FIXED, WORK_ROTATION
        )
        lengths.append(np.linalg.norm(cell.miss(request, expected.base_from_wrist)))
    return float(np.mean(lengths))


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in _SESSIONS:
        clean = trials.mean("clean_mm", session=name)
        named = 100 * trials.mean("named", session=name)
        undone = trials.mean("undone_mm", session=name) / clean
        figures += [
            Figure(f"{name}: blunder named", named, "%", at_least=95),
            Figure(f"{name}: EC error, undone / clean", undone, "", at_most=1.3),
            Figure(
                f"{name}: EC error, kept / clean", trials.mean("kept_mm", session=name) / clean
            ),
            Figure(f"{name}: EC error, clean", clean, "mm"),
            Figure(
                f"{name}: calibration rejected",
                100 * trials.mean("refused_verdict", session=name),
                "%",
            ),
            Figure(
                f"{name}: good touches blamed per session", trials.mean("blamed", session=name)
            ),
            Figure(
                f"{name}: touches blamed per clean session",
                trials.mean("false_alarms", session=name),
            ),
        ]
    return figures


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(session="tilted"))
    drawing, all_axes = panels(
        f"One of 8 touches off by {_BLUNDER_MM:g} mm, {runs} sessions each",
        *[("miss of the expected coordinate, mm", "share of sessions")] * len(_SESSIONS),
    )
    kinds = {"clean": "no blunder", "undone": "named touches undone", "kept": "blunder kept"}
    for axes, name in zip(all_axes, _SESSIONS, strict=True):
        for color, (kind, words) in zip(COLORS, kinds.items(), strict=False):
            values = np.sort(trials.values(f"{kind}_mm", session=name))
            axes.plot(
                values, np.arange(1, len(values) + 1) / len(values), color=color, label=words
            )
        share = 100 * trials.mean("named", session=name)
        axes.set(title=f"{name}: named in {share:.1f} %", xlim=(0, 1), ylim=(0, 1))
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
