"""Wrong touches: whether each is questioned when it is taken, and how often a right one is.

A part with six holes at two heights is touched by an operator as rough as the cell file says, with the table turned for
one touch in four where it turns. One touch is then wrong: it has the name of another target, the names of two that
follow each other are exchanged, the tip is in the air, the wrist stands otherwise than it may, or a tag is hidden.
`session`: nothing but the looks and touches before it is known, of which there are four or more; `calibration`: one
of the day before is in use, and the wrong touch may be the first. In the air less than is detectable nothing can be
questioned: how many are, by distance, are figures of their own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, SeedSequence

from fakes.studies.sessions import TILT_RAD
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.noise import COARSE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.plausibility import NONE_IN_USE, InUse, Miss, misses, questions
from vgrd.calibration.solve import calibrate_system
from vgrd.charts import COLORS, legend, panels
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import UNMOVED, Plan, Recording, Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_TOUCHES = 9  # of which the last repeat targets, as sessions do
_KNOWN = 4  # touches of the object as it stands before a wrong one, where no calibration is in use
_TURNS = (0.0, 0.0, 0.0, 2.0)  # of the table, rad: every fourth touch
_AIR_MM = (2.0, 200.0)  # drawn evenly in its logarithm
_SIZES_MM = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0)  # at which it is told how many are questioned
_WRIST = "wrong wrist"
_RIGHT_ASKED, _WRONG_ASKED = (
    1.0,
    95.0,
)  # %: at most, at least; an operator who is asked without need stops reading


@dataclass(frozen=True, slots=True)
class _Session:
    """plan; tilted: how many of the touches, the others have one wrist; turns: of the table."""

    plan: Plan
    tilted: int
    turns: bool


_SESSIONS: Mapping[str, _Session] = MappingProxyType(
    {
        "one wrist": _Session(Plan.SPECIAL, 0, turns=False),
        "tilted": _Session(Plan.JOINT, _TOUCHES, turns=False),
        "table turned": _Session(Plan.JOINT, 0, turns=True),
    }
)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Whether the touch was questioned, by kind of mistake (1 or 0); the share of right ones that were."""
    kind = _SESSIONS[parameters["session"]]
    cell = Simulation(seed, vision=COARSE)
    cell.put_uneven_part()
    knows = parameters["by"] == "calibration"
    asked = _asking(cell, knows=knows)
    recording = _taught(cell, kind)
    index = int(cell.rng.integers(0 if knows else _KNOWN, _TOUCHES - 1))
    row = {"right": len(asked(recording)) / _TOUCHES}
    for name, changed in _MISTAKES.items():
        # Which wrist a session has is told by its first touch.
        at = max(index, 1) if name == _WRIST and kind.plan is Plan.SPECIAL else index
        row[name] = float(at in asked(_until(changed(recording, at, cell), at)))
    for size_mm in _SIZES_MM:
        lifted = _with(recording, index, _shifted(recording.touches[index], size_mm, cell.rng))
        row[f"{size_mm:g} mm"] = float(index in asked(_until(lifted, index)))
    return row


def _taught(cell: Simulation, kind: _Session) -> Recording:
    """Looks and touches of one session; the first touches are of the object as it stands."""
    wrists = [cell.wrist(TILT_RAD) for _ in range(kind.tilted)]
    wrists += [WORK_ROTATION] * (_TOUCHES - kind.tilted)
    every = list(cell.targets)
    names = [every[k % len(every)] for k in cell.rng.permutation(len(every)).tolist()]
    names += names[: _TOUCHES - len(names)]
    turns = [_TURNS[k % 4] if kind.turns and k >= _KNOWN else 0.0 for k in range(_TOUCHES)]
    recording = cell.record(
        looks=8, spins=0, wrists=wrists, names=names, turns_rad=turns, plan=Plan.JOINT
    )
    return replace(recording, plan=kind.plan)


def _asking(cell: Simulation, *, knows: bool) -> Callable[[Recording], set[int]]:
    """Indices of the touches that are questioned; knows: a calibration of the same cell is in use."""
    calibration = None
    if knows:
        wrists = [WORK_ROTATION] * 6 + [cell.wrist(TILT_RAD) for _ in range(6)]
        calibration = calibrate_system(cell.record(looks=8, spins=6, wrists=wrists))

    def asked(recording: Recording) -> set[int]:
        in_use = NONE_IN_USE if calibration is None else _in_use(calibration, recording)
        return set(questions(recording, range(len(recording.touches)), in_use))

    return asked


def _in_use(calibration: Calibration, recording: Recording) -> InUse:
    def missed(index: int) -> Mapping[str, Miss]:
        return misses(calibration, recording.touches[index], UNMOVED, recording.facts)

    return InUse(missed, [np.asarray(p.base_from_work) for p in calibration.taught.values()])


def _until(recording: Recording, index: int) -> Recording:
    """As far as it was taught when the touch of that index came."""
    return replace(recording, touches=recording.touches[: index + 1])


def _with(recording: Recording, index: int, touch: Touch) -> Recording:
    touches = list(recording.touches)
    touches[index] = touch
    return replace(recording, touches=tuple(touches))


def _shifted(touch: Touch, size_mm: float, rng: Generator) -> Touch:
    direction = rng.normal(size=3)
    shift = size_mm * direction / np.linalg.norm(direction)
    W = touch.base_from_wrist
    return replace(touch, base_from_wrist=Pose(W.rotation, W.translation + shift))


def _named(recording: Recording, index: int, cell: Simulation) -> Recording:
    """The name of any other target."""
    touch = recording.touches[index]
    others = [name for name in cell.targets if name != touch.target]
    return _with(recording, index, replace(touch, target=str(cell.rng.choice(others))))


def _exchanged(recording: Recording, index: int, cell: Simulation) -> Recording:
    """It and the next touch have each other's names."""
    del cell
    here, there = recording.touches[index], recording.touches[index + 1]
    changed = _with(recording, index, replace(here, target=there.target))
    return _with(changed, index + 1, replace(there, target=here.target))


def _in_the_air(recording: Recording, index: int, cell: Simulation) -> Recording:
    size_mm = float(np.exp(cell.rng.uniform(*np.log(_AIR_MM))))
    return _with(recording, index, _shifted(recording.touches[index], size_mm, cell.rng))


def _wrong_wrist(recording: Recording, index: int, cell: Simulation) -> Recording:
    """The tip on the target: with one wrist turned by 2 to 90 degrees, else leaning away by 90 to 180."""
    touch = recording.touches[index]
    low, high = (2.0, 90.0) if recording.plan is Plan.SPECIAL else (90.0, 180.0)
    side, angle = cell.rng.uniform(0, 2 * np.pi), np.radians(cell.rng.uniform(low, high))
    R: Array = WORK_ROTATION @ exp_rotation((np.cos(side) * angle, np.sin(side) * angle, 0.0))
    point = touch.base_from_wrist @ cell.tcp_in_wrist
    return _with(
        recording, index, replace(touch, base_from_wrist=Pose(R, point - R @ cell.tcp_in_wrist))
    )


def _hidden(recording: Recording, index: int, cell: Simulation) -> Recording:
    touch = recording.touches[index]
    tag = str(cell.rng.choice(["tag_a", "tag_b"]))
    seen = touch.observation
    if seen is None:
        return recording
    seen = replace(seen, tag_a=None) if tag == "tag_a" else replace(seen, tag_b=None)
    return _with(recording, index, replace(touch, observation=seen))


_MISTAKES: Mapping[str, Callable[[Recording, int, Simulation], Recording]] = MappingProxyType(
    {
        "named": _named,
        "exchanged": _exchanged,
        "in the air": _in_the_air,
        _WRIST: _wrong_wrist,
        "tag hidden": _hidden,
    }
)
_CASES = tuple((name, by) for name in _SESSIONS for by in ("session", "calibration"))


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name, by in _CASES:
        case = {"session": name, "by": by}
        right = 100 * trials.mean("right", **case)
        figures.append(
            Figure(f"{name}, {by}: right ones asked about", right, "%", None, _RIGHT_ASKED)
        )
        wrong = [100 * trials.mean(mistake, **case) for mistake in _MISTAKES]
        figures.append(
            Figure(
                f"{name}, {by}: wrong ones asked about", float(np.mean(wrong)), "%", _WRONG_ASKED
            )
        )
        figures += [
            Figure(f"{name}, {by}: {mistake}", share, "%")
            for mistake, share in zip(_MISTAKES, wrong, strict=True)
        ]
        figures += [
            Figure(
                f"{name}, {by}: {size:g} mm in the air",
                100 * trials.mean(f"{size:g} mm", **case),
                "%",
            )
            for size in _SIZES_MM
        ]
    return figures


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(session="one wrist", by="session"))
    drawing, (axes,) = panels(
        f"Touches in the air, {runs} sessions each",
        ("distance from the target, mm", "asked about, %"),
    )
    for color, (name, by) in zip(COLORS, _CASES, strict=False):
        shares = [100 * trials.mean(f"{size:g} mm", session=name, by=by) for size in _SIZES_MM]
        axes.plot(_SIZES_MM, shares, color=color, label=f"{name}, {by}")
    legend(axes, "lower right")
    return drawing


STUDY = Study(
    name="wrong-touches",
    title="Wrong touches are questioned when they are taken",
    cases=tuple({"session": name, "by": by} for name, by in _CASES),
    runs=60,
    full_runs=400,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
