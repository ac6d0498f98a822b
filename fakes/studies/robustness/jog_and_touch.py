"""Jog and touch: a session in which nobody asks for a look or a spin, against one where they are asked for.

Both have six touches, three of them tilted, in the same cell. The operator who only jogs turns the table four times;
what the daemon's rule harvests of his stops are the looks and spins. Minutes by the paper's table 4: a touch costs
what it does there, a turn of the table what a sample of the turntable does, and a stop on the way nothing.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.jogging import jog_and_touch, without_harvest
from fakes.studies.paper.arms import EXACT, SIX_AXES, cell_with
from fakes.studies.sessions import STEP_MINUTES, TILT_RAD, Session, known_arm
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.simulation import Simulation
from vgrd.calibration.joint import calibrate_joint, expected_by_joint
from vgrd.charts import COLORS, legend, panels
from vgrd.model import Plan, Policy, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_TOUCHES, _TILTED, _TURNS = 6, 3, 4  # as the shortest session of table 4
_REQUESTS = 6  # a session costs far more than a request
_COMMANDED = "8 looks, 4 spins asked for"
_SHORTEST = "4 spins asked for"
_JOGGED, _BARE = "jog and touch", "the same touches alone"
_SESSIONS = {
    _COMMANDED: Session(Plan.JOINT, looks=8, spins=_TURNS, tilted=_TILTED),
    _SHORTEST: Session(Plan.JOINT, spins=_TURNS, tilted=_TILTED),
}
_ARMS = (EXACT, SIX_AXES)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Mean squares of the misses, mm^2, by session; what was harvested, and its minutes."""
    row = {}
    for name, session in _SESSIONS.items():
        cell = cell_with(parameters["arm"], seed)
        row[name] = _square_miss(cell, session.record(cell))
    cell = cell_with(parameters["arm"], seed)
    wrists = [cell.wrist() for _ in range(_TOUCHES - _TILTED)]
    wrists += [cell.wrist(TILT_RAD) for _ in range(_TILTED)]
    jogged = jog_and_touch(cell, wrists, _TURNS)
    row[_JOGGED] = _square_miss(cell, jogged)
    row[_BARE] = _square_miss(cell, without_harvest(jogged))
    row["looks"], row["spins"] = float(len(jogged.looks)), float(len(jogged.spins))
    row["minutes"] = STEP_MINUTES["touches"] * len(jogged.touches)
    row["minutes"] += STEP_MINUTES["turntable"] * _TURNS
    return row


def _square_miss(cell: Simulation, recording: Recording) -> float:
    result = calibrate_joint(recording, arm=known_arm(cell.arm))
    squares = []
    for _ in range(_REQUESTS):
        request = cell.request()
        expected = expected_by_joint(result, request.target, request.seen, Policy.FIXED)
        squares.append(np.sum(cell.miss(request, expected.base_from_wrist) ** 2))
    return float(np.mean(squares))


def _rms(trials: Trials, name: str, arm: str) -> float:
    return float(np.sqrt(trials.mean(name, arm=arm)))


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for arm in _ARMS:
        jogged = _rms(trials, _JOGGED, arm)
        for name in _SESSIONS:
            ratio = jogged / _rms(trials, name, arm)
            figures.append(Figure(f"{arm}: EC rms over {name}", ratio, "", at_most=1.1))
        ratio = _rms(trials, _BARE, arm) / jogged
        figures.append(Figure(f"{arm}: {_BARE} over it", ratio))
        figures.append(Figure(f"{arm}: EC rms, {_JOGGED}", jogged, "mm"))
    return [
        *figures,
        Figure("looks harvested", trials.mean("looks"), ""),
        Figure("spins harvested", trials.mean("spins"), "", at_least=_TURNS),
        Figure("minutes", trials.mean("minutes"), "min", at_most=5.61),  # 5.6, and rounding
    ]


def _draw(trials: Trials) -> "Drawing":
    names = [_JOGGED, *_SESSIONS, _BARE]
    runs = len(trials.select(arm=EXACT))
    drawing, (axes,) = panels(
        f"Jog and touch against samples that are asked for, {runs} sessions each",
        ("rms miss, mm", ""),
    )
    places = np.arange(len(names))
    for color, arm, shift in zip(COLORS, _ARMS, (-0.19, 0.19), strict=False):
        values = [_rms(trials, name, arm) for name in names]
        axes.barh(places + shift, values, 0.36, color=color, label=f"{arm} arm")
        for place, value in zip(places + shift, values, strict=True):
            axes.text(value, place, f" {value:.2f}", va="center", fontsize=8)
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
    legend(axes, "lower right")
    return drawing


STUDY = Study(
    name="jog-and-touch",
    title="Harvested looks and spins against those asked for",
    cases=tuple({"arm": arm} for arm in _ARMS),
    runs=150,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
