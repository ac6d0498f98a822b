"""Table 4: what the sessions cost the operator, from the samples that were really recorded."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.sessions import SESSIONS, STEP_MINUTES, operator_minutes
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.simulation import Simulation
from vgrd.charts import COLORS, PAPER, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_BARS = {"special": 8.51, "joint, no hand-eye step": 5.61}  # the rows' sums, and rounding
_PAPER = {"conventional": 16.0, "special": 10.0}  # its table 4, minutes
_ROUNDING_MIN = 0.25  # of one row: it is written to half a minute
_PAPER_ROWS = {  # the same, step by step: 15 and 8.5 in all
    "conventional": {"TCP": 8.0, "hand-eye": 2.0, "touches": 5.0},
    "special": {"hand-eye": 2.0, "turntable": 1.5, "touches": 5.0},
}


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Minutes by step and in all."""
    recording = SESSIONS[parameters["session"]].record(Simulation(seed))
    minutes = operator_minutes(recording)
    return {**minutes, "total": sum(minutes.values())}


def _figures(trials: Trials) -> list[Figure]:
    totals = {name: trials.mean("total", session=name) for name in SESSIONS}
    figures = []
    for name, total in totals.items():
        figure = Figure(name, total, "min", at_most=_BARS.get(name))
        figures.append(_beside_the_paper(figure) if name in _PAPER else figure)
        for step, minutes in _PAPER_ROWS.get(name, {}).items():
            value = trials.mean(step, session=name)
            figures.append(Figure(f"{name}: {step}", value, "min", paper=f"{minutes:g}"))
    saved = 1 - totals["joint, no hand-eye step"] / totals["conventional"]
    special = 1 - totals["special"] / totals["conventional"]
    return [
        *figures,
        Figure("special saves", 100 * special, "%", paper="37.5"),
        Figure("joint without hand-eye step saves", 100 * saved, "%", at_least=60),
    ]


def _beside_the_paper(figure: Figure) -> Figure:
    """With the paper's total and its rows' sum, and what rounding of the rows leaves open."""
    rows, total = _PAPER_ROWS[figure.name], _PAPER[figure.name]
    added = sum(rows.values())
    rounding = len(rows) * _ROUNDING_MIN
    return replace(
        figure,
        paper=f"{total:g} (its rows: {added:g})",
        interval=(added - rounding, added + rounding),
        published=(total, total),
    )


def _draw(trials: Trials) -> "Drawing":
    drawing, (axes,) = panels("Operator time by step (table 4)", ("minutes", ""))
    names = list(SESSIONS)
    left = np.zeros(len(names))
    for color, step in zip(COLORS, STEP_MINUTES, strict=False):
        width = np.array([trials.mean(step, session=name) for name in names])
        axes.barh(names, width, left=left, color=color, height=0.55, label=step)
        left = left + width
    for place, (name, total) in enumerate(zip(names, left, strict=True)):
        axes.text(total - 0.15, place, f"{total:g} min", ha="right", va="center", color="white")
        if name in _PAPER:
            label = "paper's total" if place == 0 else None
            axes.plot(
                [_PAPER[name]] * 2,
                [place - 0.36, place + 0.36],
                color=PAPER,
                ls=(0, (3, 2)),
                label=label,
            )
    axes.invert_yaxis()
    axes.set_xlim(0, 1.05 * float(left.max()))
    axes.grid(visible=False, axis="y")
    axes.legend(frameon=False, ncols=5, loc="upper center", bbox_to_anchor=(0.4, 1.1), fontsize=8)
    return drawing


STUDY = Study(
    name="table4",
    title="Table 4: operator time",
    cases=tuple({"session": name} for name in SESSIONS),
    runs=1,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
