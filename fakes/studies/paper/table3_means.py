"""Table 3 by the paper's own metric: how far each of five answers is from their mean.

The paper has no truth and takes the mean of five calibrations for it, which hides all that they have in common and
flatters the rest by a tenth. Beside it stands the distance to the truth. The ten answers of the first trial are
listed as the paper lists its own.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.paper.arms import CALIBRATIONS, EXACT, FOUR_AXES, cell_with
from fakes.studies.paper.baselines import CONVENTIONAL, SPECIAL
from fakes.studies.paper.repeated import METHODS, repeated_answers
from fakes.studies.sampling import beside_the_paper
from fakes.studies.study import REFUSED, Figure, Parameters, Study, Trials
from vgrd.charts import COLORS, PAPER, legend, panels, published

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_PAPER_MEAN_MM = {CONVENTIONAL: 0.241, SPECIAL: 0.181}
_PAPER_ANSWERS = {  # its table 3: x, y, error, mm
    CONVENTIONAL: (
        (292.068, -86.067, 0.303),
        (292.297, -86.009, 0.184),
        (292.429, -86.438, 0.265),
        (292.660, -86.115, 0.321),
        (292.279, -86.300, 0.133),
    ),
    SPECIAL: (
        (292.307, -86.020, 0.123),
        (292.108, -86.220, 0.223),
        (292.549, -85.979, 0.283),
        (292.398, -86.208, 0.104),
        (292.225, -86.285, 0.170),
    ),
}
_COLUMNS = ("x", "y", "from the mean")
_ARMS = (EXACT, FOUR_AXES)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Mean distances of five answers, mm, by method, and the answers themselves."""
    answers = repeated_answers(cell_with(parameters["arm"], seed), parameters["arm"])
    row: dict[str, float] = {}
    for name in METHODS:
        from_mean = answers.from_mean_mm(name)
        row[f"{name}, from the mean"] = float(from_mean.mean())
        row[f"{name}, from the truth"] = float(answers.from_truth_mm(name).mean())
        listed = np.column_stack([answers.by_method[name], from_mean])
        for k, numbers in enumerate(listed):
            for column, number in zip(_COLUMNS, numbers, strict=True):
                row[f"{name} {k + 1}: {column}"] = float(number)
    return row


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for arm in _ARMS:
        for name in METHODS:
            mean = trials.mean(f"{name}, from the mean", arm=arm)
            paper_mm = _PAPER_MEAN_MM[name]
            figure = Figure(
                f"{arm}: {name}, from the mean of five", mean, "mm", paper=f"{paper_mm}"
            )
            each = trials.values(f"{name}, from the mean", arm=arm)
            figures.append(beside_the_paper(figure, each, paper_mm))
            truth = trials.mean(f"{name}, from the truth", arm=arm)
            figures.append(Figure(f"{arm}: {name}, from the truth", truth, "mm"))
        for metric, paper in (("from the mean", "0.75"), ("from the truth", "")):
            special, conventional = (
                trials.mean(f"{name}, {metric}", arm=arm) for name in (SPECIAL, CONVENTIONAL)
            )
            ratio = special / conventional
            name = f"{arm}: special / conventional, {metric}"
            figure = Figure(name, ratio, "", None, 1.0, paper)
            figures.append(_with_sample(figure, trials, arm) if paper else figure)
    return [*figures, *_listed(trials)]


def _with_sample(figure: Figure, trials: Trials, arm: str) -> Figure:
    """A trial is an experiment of five calibrations each way, as the paper's."""
    special, conventional = (
        trials.values(f"{name}, from the mean", arm=arm) for name in (SPECIAL, CONVENTIONAL)
    )
    published = _PAPER_MEAN_MM[SPECIAL] / _PAPER_MEAN_MM[CONVENTIONAL]
    return beside_the_paper(figure, special / conventional, published)


def _listed(trials: Trials) -> list[Figure]:
    """The ten answers of the first trial of the paper's arm, beside the paper's."""
    rows = [row for row in trials.select(arm=FOUR_AXES) if not row[REFUSED]]
    figures = []
    for row in rows[:1]:
        for name in METHODS:
            for k, paper in enumerate(_PAPER_ANSWERS[name]):
                for column, published_mm in zip(_COLUMNS, paper, strict=True):
                    key = f"{name} {k + 1}: {column}"
                    figures.append(Figure(key, row[key], "mm", paper=f"{published_mm:.3f}"))
    return figures


def _draw(trials: Trials) -> "Drawing":
    labels = [("", "mean distance of five answers, mm"), ("", "")]
    runs = len(trials.select(arm=EXACT))
    drawing, all_axes = panels(
        f"{CALIBRATIONS} calibrations by each method, {runs} times (table 3)", *labels
    )
    for axes, arm in zip(all_axes, _ARMS, strict=True):
        columns = [f"{name}, from the {what}" for name in METHODS for what in ("mean", "truth")]
        values = [trials.values(column, arm=arm) for column in columns]
        ticks = [column.replace(", ", ",\n") for column in columns]
        boxes = axes.boxplot(
            values, tick_labels=ticks, widths=0.5, patch_artist=True, showfliers=False
        )
        for middle in boxes["medians"]:
            middle.set(color=PAPER)
        for k, box in enumerate(boxes["boxes"]):
            box.set(facecolor=COLORS[k // 2], alpha=0.35 if k % 2 else 0.7)
        for color, (name, value) in zip(COLORS, _PAPER_MEAN_MM.items(), strict=False):
            published(axes, value, f"paper, {name}: {value} mm", color=color)
        axes.tick_params(axis="x", labelsize=8)
        axes.set_title(
            "exact 6-axis arm" if arm == EXACT else "the paper's 4-axis arm", fontsize=10
        )
        axes.set_ylim(bottom=0)
    legend(all_axes[0], "upper right")
    return drawing


STUDY = Study(
    name="table3-means",
    title="Table 3 by the paper's metric: distance to the mean of five calibrations",
    cases=tuple({"arm": arm} for arm in _ARMS),
    runs=300,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
