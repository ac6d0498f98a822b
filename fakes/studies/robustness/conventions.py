"""Mistaken conventions, one in each session: named, and clean sessions left alone."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.robustness.mistakes import (
    CLEAN,
    CONVENTIONS,
    OTHERS,
    UNDECIDABLE,
    Mistake,
    with_poses,
)
from fakes.studies.sessions import TILT_RAD
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import Simulation
from vgrd.calibration.checks import cannot_tell, examine
from vgrd.charts import COLORS, panels
from vgrd.geometry import Pose
from vgrd.model import Finding, Plan, Recording, Target, frozen_array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_KINDS: Mapping[str, tuple[Plan, int, bool]] = MappingProxyType(  # tilted ones, 4 axes
    {
        "one wrist": (Plan.SPECIAL, 0, False),
        "tilted": (Plan.UNIVERSAL, 8, False),
        "mixed": (Plan.JOINT, 4, False),
        "4-axis": (Plan.JOINT, 8, True),
    }
)
_MISTAKEN: Mapping[str, Mistake] = MappingProxyType({**CONVENTIONS, **OTHERS, **UNDECIDABLE})
_ARMS = (ArmErrors(0.03, 0.0), ArmErrors(0.03, 0.1), ArmErrors(0.03, 0.25))  # good to poor
_ONE_AXIS_ONLY = "hand_eye_motion"  # a 4-axis arm cannot but be told so


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Whether the mistake was named, and how many findings name something else."""
    fault = parameters["mistake"]
    kinds = list(_KINDS)
    rng = np.random.default_rng(seed.spawn(1)[0])
    kind = parameters["session"] or kinds[rng.integers(len(kinds) - 1)]
    mistake = _MISTAKEN.get(fault, CLEAN)
    recording = mistake.change(free_session(kind, seed, rng), rng)
    findings = examine(recording)
    if fault in UNDECIDABLE:
        findings = [*findings, *cannot_tell(recording.facts)]
    if kind == "4-axis":
        findings = [finding for finding in findings if finding.code != _ONE_AXIS_ONLY]
    right = [finding for finding in findings if _names(finding, mistake)]
    return {"named": float(bool(right)), "wrong": float(len(findings) - len(right))}


def _names(finding: Finding, mistake: Mistake) -> bool:
    words = mistake.words
    return finding.code == mistake.code and (
        not words or any(word in finding.message for word in words)
    )


def free_session(kind: str, seed: SeedSequence, rng: np.random.Generator) -> Recording:
    """5 to 12 looks, 7 or 8 touches, an object of no symmetry, a base that looks anywhere."""
    plan, tilted, one_axis = _KINDS[kind]
    arm = _ARMS[rng.integers(len(_ARMS))]
    cell = Simulation(seed, arm=arm, one_axis=one_axis)
    cell.targets = _targets(rng)
    touches = int(rng.integers(7, 9))
    tilts = [0.0] * max(touches - tilted, 0) + [TILT_RAD] * min(tilted, touches)
    recording = cell.record(
        plan=plan, looks=int(rng.integers(5, 13)), spins=6, wrists=[cell.wrist(t) for t in tilts]
    )
    yaw, away = rng.uniform(-np.pi, np.pi), rng.uniform(-300, 300, 3)
    turned_base = Pose.from_rotvec((0.0, 0.0, yaw), away)
    return with_poses(recording, lambda pose: turned_base @ pose)


def _targets(rng: np.random.Generator) -> dict[str, Target]:
    """Six points far from each other, at four heights and more."""
    while True:
        points = rng.uniform((-80, -80, -30), (80, 80, 30), (6, 3))
        apart = np.linalg.norm(points[:, None] - points, axis=2) + 1e3 * np.eye(6)
        if apart.min() > 25:
            return {
                f"P{k + 1}": Target(k + 1, f"P{k + 1}", frozen_array(p, 3))
                for k, p in enumerate(points)
            }


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in _MISTAKEN:
        share = 100 * trials.mean("named", mistake=name)
        figures.append(Figure(f"{name}: named", share, "%", at_least=95))
    seeded = [trials.values("named", mistake=name) for name in CONVENTIONS]
    alarms = np.concatenate([trials.values("wrong", mistake="none", session=s) for s in _KINDS])
    every = 100 * float(np.concatenate(seeded).mean())
    untold = trials.values("wrong", mistake=next(iter(UNDECIDABLE)))
    return [
        Figure("all seeded convention faults: named", every, "%", at_least=95),
        *figures,
        Figure("clean sessions", float(len(alarms))),
        Figure("false alarms in them", float(np.sum(alarms > 0)), at_most=0),
        Figure("alarms for a constant active TCP", float(np.sum(untold > 0)), at_most=0),
    ]


def _draw(trials: Trials) -> "Drawing":
    shares = {name: 100 * trials.mean("named", mistake=name) for name in _MISTAKEN}
    runs = len(trials.select(mistake=next(iter(_MISTAKEN))))
    drawing, (axes,) = panels(f"Mistakes named, {runs} sessions each", ("named, %", ""))
    axes.barh(list(shares), list(shares.values()), color=COLORS[0])
    axes.axvline(95, color=COLORS[1], linewidth=1.2)
    axes.invert_yaxis()
    axes.tick_params(axis="y", labelsize=7)
    axes.set_xlim(0, 100)
    return drawing


STUDY = Study(
    name="conventions",
    title="Mistaken conventions named by the data",
    cases=(
        *({"mistake": name, "session": ""} for name in _MISTAKEN),
        *({"mistake": "none", "session": kind} for kind in _KINDS),
    ),
    runs=250,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
