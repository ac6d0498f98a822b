"""TCP error against how far the wrists are turned: what an operator can reach, where figure 4 cannot."""

from typing import TYPE_CHECKING

from fakes.studies.paper.fig4 import tcp_error
from fakes.studies.study import Figure, Study, Trials
from vgrd.charts import COLORS, legend, panels, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SPREADS_DEG = (10.0, 20.0, 30.0, 60.0, 180.0)  # from the least of use to all; operators reach 30
_TOUCHES = (4, 6, 8, 16, 32)  # as figure 5 shows
_NOTED = {  # bars, mm, around what was measured: docs/studies.md
    10.0: (1.0, 1.3),
    30.0: (0.36, 0.44),
    60.0: (0.20, 0.24),
    180.0: (0.145, 0.165),
}


def _figures(trials: Trials) -> list[Figure]:
    def mean(m: int, spread: float) -> float:
        return trials.mean("error_mm", touches=m, spread_deg=spread)

    eight = [
        Figure(f"mean, 8 touches within {s:g} degrees", mean(8, s), "mm", *_NOTED.get(s, ()))
        for s in _SPREADS_DEG
    ]
    return [
        *eight,
        Figure("twice the tilt, 10 to 20 degrees", mean(8, 20) / mean(8, 10), "", at_most=0.6),
        Figure("twice the touches, 8 to 16", mean(16, 10) / mean(8, 10), "", 0.5, 0.75),
        Figure(
            "6 touches within 60 / 32 within 10 degrees", mean(6, 60) / mean(32, 10), "", None, 1.0
        ),
    ]


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(touches=8, spread_deg=180.0))
    drawing, (tilt_axes, touch_axes) = panels(
        f"TCP error of the universal method: tilt matters more than touches ({runs} runs each)",
        ("wrists turned by up to, degrees", "mean TCP error, mm"),
        ("touches", "mean TCP error, mm"),
    )
    for color, m in zip(COLORS, _TOUCHES, strict=False):
        means = [trials.mean("error_mm", touches=m, spread_deg=s) for s in _SPREADS_DEG]
        tilt_axes.plot(_SPREADS_DEG, means, "o-", color=color, label=f"{m} touches")
    for color, s in zip(COLORS, _SPREADS_DEG, strict=False):
        means = [trials.mean("error_mm", touches=m, spread_deg=s) for m in _TOUCHES]
        touch_axes.plot(_TOUCHES, means, "o-", color=color, label=f"within {s:g} degrees")
    plain_log_ticks(tilt_axes, _SPREADS_DEG, x=True)
    plain_log_ticks(touch_axes, _TOUCHES, x=True)
    for axes in (tilt_axes, touch_axes):
        plain_log_ticks(axes, (0.05, 0.1, 0.2, 0.5, 1, 2, 4), x=False)
        legend(axes, "upper right")
    return drawing


STUDY = Study(
    name="tilt",
    title="TCP error of the universal method against wrist tilt and number of touches",
    cases=tuple({"touches": m, "spread_deg": s} for m in _TOUCHES for s in _SPREADS_DEG),
    runs=400,
    trial=tcp_error,
    figures=_figures,
    draw=_draw,
)
