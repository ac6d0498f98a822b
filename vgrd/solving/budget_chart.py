"""Picture of an error budget: one bar per target, parted by the links of the chain."""

from typing import TYPE_CHECKING

import numpy as np

from vgrd.calibration.planning import Budget
from vgrd.charts import COLORS, panels
from vgrd.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SMALLEST = 0.01  # of a bar: a thinner part cannot be told from its neighbours
_WRITTEN = 0.06  # of a bar: two digits in font size 8 have room in it
_LIGHT = "#cccccc"
_HATCHES = ("", "///", "...")


def draw_budget(budget: Budget, title: str) -> "Drawing":
    """Shares in the variance in percent; links below 1 % everywhere are drawn as one."""
    drawing, (axes,) = panels(title, ("share in the variance of the expected coordinate, %", ""))
    places = np.arange(len(budget.targets))
    left = np.zeros(len(places))
    for i, (name, shares) in enumerate(_bars(budget)):
        color = _LIGHT if name == "others" else COLORS[i % len(COLORS)]
        hatch = "" if name == "others" else _HATCHES[i // len(COLORS)]
        axes.barh(places, 100 * shares, left=left, color=color, label=name, hatch=hatch)
        for place, start, share in zip(places, left, shares, strict=True):
            if share >= _WRITTEN:
                ink = "black" if name == "others" else "white"
                axes.text(
                    start + 50 * share,
                    float(place),
                    f"{100 * share:.0f}",
                    color=ink,
                    va="center",
                    ha="center",
                    fontsize=8,
                )
        left = left + 100 * shares
    names = [
        f"{name}\n{radius:.2f} mm"
        for name, radius in zip(budget.targets, budget.u95_mm, strict=True)
    ]
    axes.set_yticks(places, names)
    axes.set(xlim=(0, 100), ylabel="target, its 95 % radius")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    drawing.legend(loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)
    return drawing


def _bars(budget: Budget) -> list[tuple[str, Array]]:
    """Links with their shares (t,), the largest first, small ones put together."""
    large = budget.shares.max(axis=0) >= _SMALLEST
    order = np.argsort(-budget.shares.mean(axis=0), kind="stable")
    bars = [(str(budget.links[i]), budget.shares[:, i]) for i in order if large[i]]
    if not large.all():
        bars.append(("others", budget.shares[:, ~large].sum(axis=1)))
    return bars
