"""How the pictures of all studies look; matplotlib is loaded only when one is drawn."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from vgrd.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

COLORS = ("#1f5f99", "#c8553d", "#3c8d5a", "#8a6bb1", "#b08a2e", "#5b6770")
PAPER = "#222222"
Place = Literal["best", "upper right", "center right", "lower right"]
_WIDTH, _HEIGHT, _DPI = 7.2, 4.5, 150  # inches; a guess: 1080 x 675 px fit on any screen


def check_matplotlib() -> None:
    """Raise InputError with the remedy where matplotlib is not installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as err:
        raise InputError(
            "drawing needs matplotlib: pip install 'vgrd[studies]', or give --no-plot"
        ) from err


def panels(title: str, *labels: tuple[str, str]) -> "tuple[Drawing, list[Axes]]":
    """Drawing with one panel for each pair of axis labels, side by side."""
    check_matplotlib()
    from matplotlib.figure import Figure as Drawing

    width = _WIDTH if len(labels) == 1 else 0.72 * _WIDTH * len(labels)
    drawing = Drawing(figsize=(width, _HEIGHT), dpi=_DPI, layout="constrained")
    drawing.suptitle(title, fontsize=11.5)
    all_axes = list(drawing.subplots(1, len(labels), squeeze=False)[0])
    for axes, (x, y) in zip(all_axes, labels, strict=True):
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(visible=True, color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
    return drawing, all_axes


def published(
    axes: "Axes", value: float, label: str, *, vertical: bool = False, color: str = PAPER
) -> None:
    """Line at what the paper says."""
    line = axes.axvline if vertical else axes.axhline
    line(value, color=color, linestyle=(0, (5, 3)), linewidth=1.2, label=label)


def legend(axes: "Axes", place: Place = "best") -> None:
    """Legend that hides what lies behind it."""
    axes.legend(loc=place, fontsize=8.5, facecolor="white", edgecolor="none", framealpha=0.9)


def plain_log_ticks(axes: "Axes", ticks: Sequence[float], *, x: bool) -> None:
    """Logarithmic axis that shows these numbers as they are."""
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    (axes.set_xscale if x else axes.set_yscale)("log")
    axis = axes.xaxis if x else axes.yaxis
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())
