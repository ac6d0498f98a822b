"""What is shown says what it is: charts with their own names, times with their days."""

import time
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from vgrd.page.charts import bars, error_map, fall
from vgrd.page.parts import ago, moment, redraw, span

DAY_S = 86400.0


class Chart:
    """As much of a chart as is drawn anew."""

    def __init__(self, options: dict[str, Any]) -> None:
        self.options, self.drawn = options, 0

    def update(self) -> None:
        self.drawn += 1


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (bars({"OK": 1}), bars({"TAG_B_NOT_FOUND": 1})),
        (bars({"camera": 60, "tag A": 40}), bars({"tag A": 60, "camera": 40})),
        (fall([{"sample": 3, "u95_mm": 0.5}], 1.0), fall([{"sample": 4, "u95_mm": 0.5}], 1.0)),
        (
            error_map({"u95_mm": {"P1": [0.1]}, "angles_deg": [0]}, 1.0),
            error_map({"u95_mm": {"P1": [0.1]}, "angles_deg": [90]}, 1.0),
        ),
    ],
    ids=["other names", "names that changed places", "other samples", "other angles"],
)
def test_a_chart_of_the_same_values_keeps_no_names_of_another(before, after):
    chart: Any = Chart(before)
    redraw(chart, after)
    assert (chart.options, chart.drawn) == (after, 1)
    redraw(chart, after)
    assert chart.drawn == 1


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (12.5, "12.5 s"),
        (59.0, "59.0 s"),
        (3661.0, "01:01:01"),
        (14 * DAY_S, "14 d 00:00:00"),
        (3 * DAY_S + 3600.0, "3 d 01:00:00"),
    ],
)
def test_a_span_tells_its_days(seconds, words):
    assert span(seconds) == words


def test_what_was_days_ago_is_told_in_days():
    assert [ago(seconds) for seconds in (None, 14.2, 2 * DAY_S)] == [
        "never",
        "14 s ago",
        "2 d 00:00:00 ago",
    ]


def test_a_moment_of_another_day_tells_its_day():
    now_s = time.mktime((2026, 3, 2, 12, 0, 0, 0, 0, -1))
    assert moment(now_s - 3600.0, now_s) == "11:00:00"
    assert moment(now_s - DAY_S, now_s) == "2026-03-01 12:00:00"
