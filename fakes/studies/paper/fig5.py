"""Figure 5: TCP error of the universal method against the number of touches."""

from typing import TYPE_CHECKING

import numpy as np

from fakes.studies.paper.fig4 import tcp_error
from fakes.studies.sampling import beside_the_paper, ratio_of_means, resampled
from fakes.studies.study import Figure, Study, Trials
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_COUNTS = tuple(range(4, 33))  # from the fewest that determine it to where more hardly help
_CALIBRATIONS = 300  # of each count: the paper's
_NEARLY_HALVED = (0.5, 0.6)  # the paper's words, as numbers
_SHOWN = (4, 6, 8, 16, 32)  # doublings, and 6: the paper's best choice is 6 to 8


def _figures(trials: Trials) -> list[Figure]:
    means = {m: trials.mean("error_mm", touches=m) for m in _COUNTS}
    rms = np.sqrt([np.mean(trials.values("error_mm", touches=m) ** 2) for m in _COUNTS])
    bound = np.sqrt([np.mean(trials.values("bound_mm", touches=m) ** 2) for m in _COUNTS])
    halved = Figure("mean, 8 / 4 touches", means[8] / means[4], "", 0.35, 0.65, "nearly halved")
    slope = np.polyfit(np.log(_COUNTS[4:]), np.log([means[m] for m in _COUNTS[4:]]), 1)[0]
    return [
        *(Figure(f"mean, {m} touches", means[m], "mm") for m in _SHOWN),
        beside_the_paper(halved, _ratios(trials), *_NEARLY_HALVED),
        Figure("mean, 32 / 8 touches", means[32] / means[8], "", 0.35, 0.60, "marginal"),
        Figure("exponent of touches from 8 on", float(slope), "", -0.70, -0.45),
        Figure("rms / bound, 8 touches on", float(np.mean((rms / bound)[4:])), "", None, 1.05),
    ]


def _ratios(trials: Trials) -> Array:
    """Mean with 8 over mean with 4 touches, of experiments of 300 calibrations each."""
    by_count = [trials.values("error_mm", touches=m) for m in (4, 8)]
    rows = np.column_stack([errors[: min(map(len, by_count))] for errors in by_count])
    return resampled(rows, _CALIBRATIONS, ratio_of_means)


def _draw(trials: Trials) -> "Drawing":
    errors = [trials.values("error_mm", touches=m) for m in _COUNTS]
    drawing, (axes,) = panels(
        f"TCP error against the number of touches, {len(errors[0])} calibrations each (figure 5)",
        ("touches", "TCP error, mm"),
    )
    low, high = np.array([(e.min(), e.max()) for e in errors]).T
    axes.fill_between(_COUNTS, low, high, color=COLORS[0], alpha=0.15, lw=0, label="range")
    low, high = np.array([np.percentile(e, (5, 95)) for e in errors]).T
    axes.fill_between(_COUNTS, low, high, color=COLORS[0], alpha=0.3, lw=0, label="5 to 95 %")
    axes.plot(_COUNTS, [e.mean() for e in errors], color=COLORS[0], label="mean")
    bound = [np.sqrt(np.mean(trials.values("bound_mm", touches=m) ** 2)) for m in _COUNTS]
    axes.plot(_COUNTS, bound, color=COLORS[1], ls=":", label="Cramer-Rao bound of the rms")
    axes.axvspan(6, 8, color=PAPER, alpha=0.10, lw=0, label="paper: the best choice")
    axes.set_ylim(0, 1.2)
    axes.set_xlim(_COUNTS[0], _COUNTS[-1])
    axes.set_xticks(_COUNTS[::4])
    legend(axes, "upper right")
    return drawing


STUDY = Study(
    name="fig5",
    title="Figure 5: TCP error of the universal method against the number of touches",
    cases=tuple({"touches": m, "spread_deg": 180.0} for m in _COUNTS),
    runs=_CALIBRATIONS,
    trial=tcp_error,
    figures=_figures,
    draw=_draw,
)
