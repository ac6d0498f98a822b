"""What robots were answered: how often, how quickly, how old, and what was refused."""

from typing import Any

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import bars
from vgrd.page.parts import Grid, card, redraw, tell
from vgrd.page.visitor import Visitor


class RuntimeTab:
    """Figures of the cell's present life."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("columns"):
            with card(texts.WHY):
                self._pareto = ui.echart(bars({})).classes("w-full h-80")
            with card("Figures"):
                self._figures = ui.label().mark("figures")
        with card("Answers"):
            self._answers = Grid(("unix_s", "target", "answer", "u95_mm", "age_ms", "latency_ms"))

    def refresh(self) -> None:
        """Show what was heard."""
        told = self._visitor.link.reply("answers")
        redraw(self._pareto, bars(told.get("counts", {})))
        answers = told.get("answers", [])
        self._answers.show({**one, "answer": one["name"]} for one in answers)
        tell(self._figures, _figures(answers))


def _figures(answers: list[dict[str, Any]]) -> str:
    """Of the newest answers that gave a coordinate."""
    good = [one for one in answers if one["u95_mm"] is not None]
    if not good:
        return texts.NONE
    latency = sorted(one["latency_ms"] for one in good)
    error = sorted(one["u95_mm"] for one in good)
    return (
        f"{len(good)} coordinates: {latency[len(latency) // 2]} ms to answer (up to {latency[-1]}), "
        f"95 % error {error[len(error) // 2]:.3f} mm (up to {error[-1]:.3f})"
    )
