"""Degenerate sessions: every kind recognised, the missing motion named, no number silent."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, SeedSequence

from fakes.studies.sessions import TILT_RAD
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.checks import examine, missing_motions
from vgrd.calibration.solve import calibrate_system
from vgrd.charts import COLORS, panels
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import Observation, Plan, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_ARM = ArmErrors(0.03, 0.1)  # mm: repeatability of the fake arm, half of its field
_JITTER_MM = 0.02  # a guess: pendants show 0.1 or 0.01 mm
_JITTER_RAD = np.radians(0.02)  # a guess: pendants show 0.1 or 0.01 degrees
_OPPOSITE = ("P1", "P4")
Session = Callable[[Simulation], Recording]


def _jitter(cell: Simulation) -> Pose:
    """What the digits of a pendant leave of a pose that is kept."""
    d = cell.rng.normal(size=6)
    return Pose(exp_rotation(_JITTER_RAD * d[3:]), _JITTER_MM * d[:3])


def _place(rng: Generator) -> Array:
    return np.array([350, 0, 250]) + rng.uniform(-100, 100, 3)


def _looks(cell: Simulation, turn: Callable[[], Array], *, moving: bool = True) -> Recording:
    """Looks turned as told, touches that did not see tag A, spins."""
    fixed_place = _place(cell.rng)
    looks = []
    for _ in range(int(cell.rng.integers(4, 13))):
        place = _place(cell.rng) if moving else fixed_place
        jitter = _jitter(cell)
        R = jitter.rotation @ WORK_ROTATION @ turn()
        looks.append(cell.observe(Pose(R, place + jitter.translation), 0.0))
    return _blind(replace(cell.record(spins=6, looks=0), looks=tuple(looks)))


def _blind(recording: Recording) -> Recording:
    """The same touches, tag A out of view."""
    return replace(
        recording,
        touches=tuple(
            replace(
                touch, observation=touch.observation and replace(touch.observation, tag_a=None)
            )
            for touch in recording.touches
        ),
    )


def _parallel_looks(cell: Simulation) -> Recording:
    return _looks(cell, lambda: np.eye(3))


def _zero_motion(cell: Simulation) -> Recording:
    return _looks(cell, lambda: np.eye(3), moving=False)


def _one_axis_looks(cell: Simulation) -> Recording:
    axis = cell.rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    return _looks(cell, lambda: exp_rotation(axis * cell.rng.uniform(-1, 1)))


def _duplicated_poses(cell: Simulation) -> Recording:
    """Two stands, each recorded several times."""
    stands = cell.looks(2)
    again: list[Observation] = [
        cell.observe(stands[k % 2].base_from_wrist, 0.0)
        for k in range(int(cell.rng.integers(4, 9)))
    ]
    return _blind(replace(cell.record(spins=6, looks=0), looks=tuple(again)))


def _touches(cell: Simulation, spreads_rad: Array, names: list[str], plan: Plan) -> Recording:
    wrists = [_jitter(cell).rotation @ cell.wrist(s) for s in spreads_rad]
    return cell.record(plan=plan, wrists=wrists, names=names, looks=8, spins=6)


def _names(cell: Simulation, count: int) -> list[str]:
    every = list(cell.targets)
    return [every[k % len(every)] for k in range(count)]


def _constant_wrist(cell: Simulation) -> Recording:
    count = int(cell.rng.integers(4, 9))
    return _touches(cell, np.zeros(count), _names(cell, count), Plan.UNIVERSAL)


def _one_axis_touches(cell: Simulation) -> Recording:
    count = int(cell.rng.integers(5, 9))
    recording = cell.record(looks=8, spins=6, plan=Plan.UNIVERSAL)
    axis = cell.rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turns = [exp_rotation(axis * angle) for angle in cell.rng.uniform(-0.6, 0.6, count)]
    names = _names(cell, count)
    touches = tuple(
        cell.touch(name, _jitter(cell).rotation @ WORK_ROTATION @ turn)
        for name, turn in zip(names, turns, strict=True)
    )
    return replace(recording, touches=touches)


def _collinear(cell: Simulation) -> Recording:
    """Two opposite targets and nothing beside their line."""
    count = int(cell.rng.integers(5, 9))
    tilted = bool(cell.rng.integers(2))
    spreads = np.full(count, TILT_RAD if tilted else 0.0)
    names = [_OPPOSITE[k % 2] for k in range(count)]
    return _touches(cell, spreads, names, Plan.UNIVERSAL if tilted else Plan.SPECIAL)


def _object_at_rest(cell: Simulation) -> Recording:
    spins = tuple(cell.observe(cell.standing, 0.0) for _ in range(6))
    return replace(cell.record(looks=8), spins=spins)


KINDS: Mapping[str, tuple[Session, str]] = MappingProxyType(
    {
        "constant wrist": (_constant_wrist, "wrist_tilt"),
        "one axis, touches": (_one_axis_touches, "wrist_tilt"),
        "one axis, looks": (_one_axis_looks, "hand_eye_motion"),
        "collinear targets": (_collinear, "targets_in_line"),
        "parallel looks": (_parallel_looks, "hand_eye_motion"),
        "zero motion": (_zero_motion, "hand_eye_motion"),
        "duplicated poses": (_duplicated_poses, "hand_eye_motion"),
        "object not turned": (_object_at_rest, "object_turn"),
    }
)
_WITHOUT_POSE = ("collinear targets", "object not turned")


def _clean(cell: Simulation) -> Recording:
    count = int(cell.rng.integers(6, 9))
    plan = (Plan.UNIVERSAL, Plan.JOINT, Plan.SPECIAL)[cell.rng.integers(3)]
    spreads = np.full(count, 0.0 if plan is Plan.SPECIAL else TILT_RAD)
    return _touches(cell, spreads, _names(cell, count), plan)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """recognised: the right motion is missing; posed: a pose or target to go to comes with it."""
    session, code = KINDS.get(parameters["kind"], (_clean, ""))
    recording = session(Simulation(seed, arm=_ARM))
    missing = missing_motions(recording)
    right = [gap for gap in missing if gap.code == code]
    return {
        "recognised": float(bool(right) and bool(examine(recording))),
        "posed": float(any(gap.base_from_wrist is not None for gap in right)),
        "others": float(len(missing) - len(right)),
        "silent": float(bool(code) and _answers_silently(recording)),
    }


def _answers_silently(recording: Recording) -> bool:
    """Whether a calibration comes out and nobody says a word against it."""
    if examine(recording):
        return False
    try:
        return not calibrate_system(recording).verdict.findings
    except CalibrationError:
        return False


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in KINDS:
        share = 100 * trials.mean("recognised", kind=name)
        figures.append(Figure(f"{name}: motion named", share, "%", at_least=100))
        if name not in _WITHOUT_POSE:
            posed = 100 * trials.mean("posed", kind=name)
            figures.append(Figure(f"{name}: pose given", posed, "%", at_least=100))
    silent = [trials.values("silent", kind=name) for name in KINDS]
    clean = trials.values("others", kind="clean")
    return [
        *figures,
        Figure("silent numbers", float(np.concatenate(silent).sum()), at_most=0),
        Figure("clean sessions", float(len(clean))),
        Figure("motions asked for in them", float(clean.sum()), at_most=0),
    ]


def _draw(trials: Trials) -> "Drawing":
    shares = {name: 100 * trials.mean("recognised", kind=name) for name in KINDS}
    runs = len(trials.select(kind="clean"))
    drawing, (axes,) = panels(
        f"Degenerate sessions recognised, {runs} each", ("missing motion named, %", "")
    )
    axes.barh(list(shares), list(shares.values()), color=COLORS[0])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    return drawing


STUDY = Study(
    name="degenerate",
    title="Degenerate sessions: the missing motion named",
    cases=tuple({"kind": kind} for kind in (*KINDS, "clean")),
    runs=250,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
