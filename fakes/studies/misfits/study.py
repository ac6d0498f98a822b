"""Misfits: sessions of cells that are not what their file says, solved and served as the product does.

A row passes when the truth lies in the stated 95 % radii, or when nearly every session in which it does not is
refused with the cause named. A session is refused when its calibration is rejected or the answers that miss are.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.misfits.cell import MisfitCell
from fakes.studies.misfits.judging import judge
from fakes.studies.misfits.worlds import BEFORE, ROWS
from fakes.studies.sessions import Session
from fakes.studies.study import Figure, Parameters, Study, Trials
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.model import Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(Plan.JOINT, looks=8, spins=10, touches=10, tilted=4, turned=5)
_FILMED = 16  # looks of an arm on its way: five seconds, so that it turns back
_REQUESTS = 10  # at any turn: of a wrong centre or axis some turns show nothing
_WITHIN = (92.0, 99.0)  # % of answers that state 95 %: the issue's
_CAUGHT = 95.0  # % of the sessions that do not hold
_NAMED = 90.0  # % of the sessions in which something is told
_NEEDLESS = 5.0  # % of all sessions
_U95_BEFORE_MM = 0.349  # of that row, before anything was estimated of the noise
_WIDER = 1.1  # times that: what it may cost to doubt a file that is right
_ALARMS = 1.0  # % of clean sessions, all tests together


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float | str]:
    """Columns of `Judged.row`."""
    row = ROWS[parameters["world"]]
    looks = _FILMED if row.world.skew_s else _SESSION.looks
    session = replace(_SESSION, looks=looks, turned=_SESSION.turned if row.turned else 0)
    pictures = session.looks + session.spins + session.touches
    cell = MisfitCell(seed, row.world, looks=session.looks, pictures=pictures)
    return judge(cell, session.record(cell), _REQUESTS).row(row.causes)


def _figures(trials: Trials) -> list[Figure]:
    return [figure for name in trials.distinct("world") for figure in _of_row(trials, name)]


def _of_row(trials: Trials, name: str) -> list[Figure]:
    within = 100 * trials.finite_mean("within", world=name)
    rejected, refused, told, needless = (
        100 * trials.mean(column, world=name)
        for column in ("rejected", "answers_refused", "told", "needless")
    )
    u95_mm = trials.finite_mean("u95_mm", world=name)
    figures = [
        Figure(f"{name}: truth within u95", within, "%"),
        Figure(f"{name}: within, or caught", _honest(trials, name, within), "%", at_least=_CAUGHT),
        Figure(f"{name}: calibrations rejected", rejected, "%"),
        Figure(f"{name}: answers refused", refused, "%"),
        Figure(f"{name}: refused although within", needless, "%", at_most=_NEEDLESS),
        Figure(f"{name}: u95", u95_mm, "mm"),
    ]
    if name == BEFORE:
        wider = u95_mm / _U95_BEFORE_MM
        figures.append(Figure(f"{name}: u95 over what it was", wider, "x", at_most=_WIDER))
    if not ROWS[name].causes:
        return [*figures, Figure(f"{name}: false alarms", told, "%", at_most=_ALARMS)]
    bar = _NAMED if told else None
    return [
        *figures,
        Figure(f"{name}: something told", told, "%"),
        Figure(f"{name}: right cause, of those", _named(trials, name), "%", at_least=bar),
    ]


def _honest(trials: Trials, name: str, within: float) -> float:
    """100 where the radii hold, else the share of the sessions that do not hold that are caught, %."""
    if _WITHIN[0] <= within <= _WITHIN[1]:
        return 100.0
    return 100 * _mean_where(trials, name, "caught", "holds", 0.0)


def _named(trials: Trials, name: str) -> float:
    """Share of the sessions in which something is told, in which the cause is, %."""
    return 100 * _mean_where(trials, name, "named", "told", 1.0)


def _mean_where(trials: Trials, name: str, column: str, where: str, value: float) -> float:
    """Mean of a column over the sessions with that value in another; NaN without any."""
    return trials.mean(column, world=name, **{where: value})


def _draw(trials: Trials) -> "Drawing":
    names = trials.distinct("world")
    runs = len(trials.select(world=names[-1]))
    drawing, (axes,) = panels(
        f"Cells that are not as their file says, {runs} sessions each", ("%", "")
    )
    places = np.arange(len(names))
    columns = {
        "truth within u95": "within",
        "answers refused": "answers_refused",
        "cause named": "named",
    }
    for color, (label, column) in zip(COLORS, columns.items(), strict=False):
        shares = [100 * trials.finite_mean(column, world=name) for name in names]
        axes.plot(shares, places, "o", color=color, label=label)
    axes.axvspan(*_WITHIN, color=PAPER, alpha=0.1)
    axes.set_yticks(places, names, fontsize=7)
    axes.invert_yaxis()
    legend(axes)
    return drawing


STUDY = Study(
    name="misfits",
    title="Cells that are not as their file says",
    cases=tuple({"world": name} for name in ROWS),
    runs=20,
    full_runs=200,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
