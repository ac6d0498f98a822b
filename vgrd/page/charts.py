"""Charts, as options of ECharts. Grey, with shapes that tell lines apart without colour."""

from collections.abc import Mapping, Sequence
from typing import Any

from vgrd.page import texts

_GREY = {"color": "#7a828c"}  # is read on both surfaces
_SHADES = [
    "#7a828c",
    "#4f7d8c",
    "#8c7a4f",
    "#6b5f8c",
    "#8c5f6b",
    "#5f8c6b",
]  # dull: colour is for what is wrong
_SPLIT = {"splitLine": {"lineStyle": {"color": "#7a828c", "opacity": 0.3}}}
_LINES = ("solid", "dashed", "dotted")
_SYMBOLS = ("circle", "rect", "triangle", "diamond", "pin", "arrow")


def fall(trend: Sequence[Mapping[str, Any]], tolerance_mm: float) -> dict[str, Any]:
    """The error after each sample, and the tolerance that it falls to."""
    samples = [str(one["sample"]) for one in trend]
    errors = [round(float(one["u95_mm"]), 4) for one in trend]
    line = {"type": "line", "data": errors, "lineStyle": {"width": 3}, **_limit(tolerance_mm)}
    frame = _frame(texts.TREND, [*errors, tolerance_mm])
    return {**frame, "xAxis": _axis("category", samples), "series": [line]}


def error_map(told: Mapping[str, Any], tolerance_mm: float | None) -> dict[str, Any]:
    """The predicted error over the object's turn, a line for each target."""
    series = [
        {
            "type": "line",
            "name": name,
            "data": [round(value, 4) for value in values],
            "symbol": _SYMBOLS[i % len(_SYMBOLS)],
            "symbolSize": 7,
            "lineStyle": {"width": 2, "type": _LINES[i % len(_LINES)]},
            **(_limit(tolerance_mm) if i == 0 and tolerance_mm else {}),
        }
        for i, (name, values) in enumerate(told.get("u95_mm", {}).items())
    ]
    angles = [str(angle) for angle in told.get("angles_deg", ())]
    legend = {"bottom": 0, "type": "scroll", "textStyle": _GREY}
    seen = [*map(max, told.get("u95_mm", {}).values()), tolerance_mm or 0.0]
    return {
        **_frame(texts.MAP, seen),
        "grid": {"left": 50, "right": 20, "top": 40, "bottom": 60},
        "xAxis": _axis("category", angles),
        "legend": legend,
        "series": series,
    }


def bars(by_name: Mapping[str, float], title: str = "") -> dict[str, Any]:
    """Bars to the right, the longest above."""
    ordered = sorted(by_name.items(), key=lambda item: item[1])
    return {
        **_frame(title),
        "grid": {
            "left": 10,
            "right": 50,
            "top": 40 if title else 10,
            "bottom": 20,
            "containLabel": True,
        },
        "xAxis": {**_axis("value", None), **_SPLIT},
        "yAxis": _axis("category", [name for name, _ in ordered]),
        "series": [
            {
                "type": "bar",
                "barMaxWidth": 36,
                "data": [value for _, value in ordered],
                "label": {"show": True, "position": "right", **_GREY},
            }
        ],
    }


def over_time(rows: Sequence[tuple[float, float | None]], title: str) -> dict[str, Any]:
    """Values at Unix times; a gap where there is none."""
    points = [[1e3 * unix_s, value] for unix_s, value in rows]
    return {
        **_frame(title),
        "xAxis": {"type": "time", "axisLabel": {**_GREY, "hideOverlap": True}},
        "series": [{"type": "line", "data": points, "symbolSize": 7}],
    }


def _frame(title: str, seen: Sequence[float] = ()) -> dict[str, Any]:
    """seen: values that the upright axis has to show, a tolerance among them."""
    top = {"max": round(1.1 * max(seen), 3)} if any(seen) else {}
    return {
        "animation": False,
        "title": {"text": title, "textStyle": {"fontSize": 15, **_GREY}},
        "grid": {"left": 50, "right": 20, "top": 40, "bottom": 30},
        "color": _SHADES,
        "yAxis": {"type": "value", "min": 0, "axisLabel": _GREY, **_SPLIT, **top},
    }


def _axis(kind: str, data: Sequence[str] | None) -> dict[str, Any]:
    return {"type": kind, "axisLabel": _GREY, **({} if data is None else {"data": list(data)})}


def _limit(tolerance_mm: float) -> dict[str, Any]:
    """A line across at the tolerance."""
    limit = {"yAxis": tolerance_mm, "name": texts.TOLERANCE}
    return {"markLine": {"data": [limit], "symbol": "none", "silent": True}}
