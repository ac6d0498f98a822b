"""Figure 10: (a) one hole placed again and again, (b) the answers of five calibrations by each method.

Each with the smallest circle around it. The paper shows one experiment of each; here are many, and the first is drawn.
Only x and y count, as in the paper.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.circle import smallest_circle
from fakes.studies.paper.arms import FOUR_AXES, cell_with
from fakes.studies.paper.baselines import CONVENTIONAL, SPECIAL
from fakes.studies.paper.repeated import METHODS, placements, repeated_answers
from fakes.studies.sampling import beside_the_paper
from fakes.studies.study import REFUSED, Figure, Parameters, Row, Study, Trials
from vgrd.charts import COLORS, legend, panels
from vgrd.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

_PLACED = "placements"
_CLOUDS = (_PLACED, *METHODS)
_PAPER_MM = {_PLACED: 0.637, CONVENTIONAL: 0.604, SPECIAL: 0.503}  # diameters: its section VI-C


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Diameters of the circles, mm, and the points in them."""
    cell = cell_with(parameters["arm"], seed)
    clouds = {_PLACED: placements(cell)}
    clouds |= repeated_answers(cell, parameters["arm"]).by_method
    row = {f"{name}, mm": smallest_circle(cloud).diameter for name, cloud in clouds.items()}
    for name, cloud in clouds.items():
        for k, (x, y) in enumerate(cloud):
            row |= {f"{name} {k + 1}, x": float(x), f"{name} {k + 1}, y": float(y)}
    return row


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in _CLOUDS:
        values = trials.values(f"{name}, mm")
        paper = _PAPER_MM[name]
        figure = Figure(f"{name}: diameter", trials.mean(f"{name}, mm"), "mm", paper=f"{paper}")
        figures.append(beside_the_paper(figure, values, paper))
        smaller = float(np.mean(values < paper)) if values.size else float("nan")
        figures.append(Figure(f"{name}: share smaller than the paper's", smaller))
    ratio = trials.mean(f"{SPECIAL}, mm") / trials.mean(f"{CONVENTIONAL}, mm")
    figure = Figure("special / conventional", ratio, "", None, 1.0, "0.83")
    ratios = trials.values(f"{SPECIAL}, mm") / trials.values(f"{CONVENTIONAL}, mm")
    published = _PAPER_MM[SPECIAL] / _PAPER_MM[CONVENTIONAL]
    return [*figures, beside_the_paper(figure, ratios, published)]


def _draw(trials: Trials) -> "Drawing":
    labels = ("x from the middle, mm", "y from the middle, mm")
    drawing, all_axes = panels(
        "(a) one hole placed eight times, (b) answers of five calibrations (figure 10)",
        labels,
        labels,
    )
    for row in [row for row in trials.rows if not row[REFUSED]][:1]:
        clouds = {name: _cloud(row, name) for name in _CLOUDS}
        middle = np.vstack([clouds[name] for name in METHODS]).mean(axis=0)
        _draw_cloud(
            all_axes[0], clouds[_PLACED] - clouds[_PLACED].mean(axis=0), _PLACED, COLORS[0]
        )
        for name, color in zip(METHODS, COLORS[1:], strict=False):
            _draw_cloud(all_axes[1], clouds[name] - middle, name, color)
    for axes in all_axes:
        half = max(*np.abs(axes.get_xlim()), *np.abs(axes.get_ylim()))
        axes.set_aspect("equal")
        axes.set_xlim(-half, half)
        axes.set_ylim(-half, 1.4 * half)  # room for the legend
        legend(axes, "upper right")
    return drawing


def _cloud(row: Row, name: str) -> Array:
    """Points (n, 2) of one trial."""
    count = sum(key.startswith(f"{name} ") and key.endswith(", x") for key in row)
    return np.array([(row[f"{name} {k + 1}, x"], row[f"{name} {k + 1}, y"]) for k in range(count)])


def _draw_cloud(axes: "Axes", cloud: Array, name: str, color: str) -> None:
    """Points (n, 2) with their circle, and the paper's about the same centre."""
    circle = smallest_circle(cloud)
    angle = np.linspace(0, 2 * np.pi, 181)  # 2 degrees apart: a circle to the eye
    edge = np.array([np.cos(angle), np.sin(angle)]) / 2
    paper_mm = _PAPER_MM[name]
    ours = circle.center[:, None] + circle.diameter * edge
    paper = circle.center[:, None] + paper_mm * edge
    axes.plot(cloud[:, 0], cloud[:, 1], "o", color=color, markersize=5)
    axes.plot(*ours, color=color, label=f"{name}: {circle.diameter:.3f} mm")
    axes.plot(*paper, color=color, linestyle=(0, (5, 3)), label=f"paper: {paper_mm} mm")


STUDY = Study(
    name="fig10",
    title="Figure 10: circles around repeated placements and around the answers of five calibrations",
    cases=({"arm": FOUR_AXES},),
    runs=300,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
