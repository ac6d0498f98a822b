"""What robots were answered: how often, how quickly, how old; what moved over days, and what was refused."""

from typing import Any

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import bars, over_time
from vgrd.page.link import Reply
from vgrd.page.parts import Grid, card, day_time, redraw, tell
from vgrd.page.visitor import Visitor


class RuntimeTab:
    """Answers of the cell's present life; drift and faults of weeks."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._shown: object = None
        with ui.element("div").classes("columns even"):
            with card():
                self._pareto = ui.echart(bars({}, texts.WHY)).classes("w-full h-64")
            with card():
                self._latency = ui.echart(over_time([], texts.LATENCY)).classes("w-full h-64")
            with card():
                self._camera = ui.echart(over_time([], texts.CAMERA_DRIFT)).classes("w-full h-64")
            with card():
                self._misfit = ui.echart(over_time([], texts.MISFIT)).classes("w-full h-64")
        with card(texts.FAULTS):
            self._faults = Grid(("when", "status", "lasted_s", "words"))
        with card(texts.ANSWERS):
            self._figures = ui.label().mark("figures")
            self._answers = Grid(("unix_s", "target", "answer", "u95_mm", "age_ms", "latency_ms"))

    def refresh(self) -> None:
        """Show what was heard."""
        told = self._visitor.link.reply("answers")
        answers = told.get("answers", [])
        redraw(self._pareto, bars(told.get("counts", {}), texts.WHY))
        took = [(one["unix_s"], one["latency_ms"]) for one in reversed(answers)]
        redraw(self._latency, over_time(took, texts.LATENCY))
        self._answers.show({**one, "answer": one["name"]} for one in answers)
        requests = self._visitor.link.reply("registers").get("requests", 0)
        tell(self._figures, f"{texts.REQUESTS.format(count=requests)}; {_figures(answers)}")
        self._show_diary(self._visitor.link.reply("diary"))

    def _show_diary(self, diary: Reply) -> None:
        """By the hour, so mostly nothing is new."""
        if diary is self._shown:
            return
        self._shown = diary
        hours = diary.get("hours", [])
        for chart, key, title in (
            (self._camera, "camera_mm", texts.CAMERA_DRIFT),
            (self._misfit, "misfit", texts.MISFIT),
        ):
            redraw(chart, over_time([(one["unix_s"], one[key]) for one in hours], title))
        faults = diary.get("faults", [])
        self._faults.show({**one, "when": day_time(one["unix_s"])} for one in faults)


def _figures(answers: list[dict[str, Any]]) -> str:
    """Of the newest answers that gave a coordinate."""
    good = [one for one in answers if one["u95_mm"] is not None]
    if not good:
        return texts.NONE
    latency = sorted(one["latency_ms"] for one in good)
    error = sorted(one["u95_mm"] for one in good)
    return texts.FIGURES.format(
        count=len(good),
        middle_ms=latency[len(latency) // 2],
        most_ms=latency[-1],
        middle_mm=error[len(error) // 2],
        most_mm=error[-1],
    )
