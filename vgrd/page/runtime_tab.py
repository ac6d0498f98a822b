"""What robots were answered: how often, how quickly, how old, and what was refused."""

from typing import Any

from nicegui import ui

from vgrd.page import texts
from vgrd.page.parts import Grid, card, tell
from vgrd.page.visitor import Visitor


class RuntimeTab:
    """Figures of the cell's present life."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("columns"):
            with card(texts.WHY):
                self._pareto = ui.echart(_pareto({})).classes("w-full h-80")
            with card("Figures"):
                self._figures = ui.label().mark("figures")
        with card("Answers"):
            self._answers = Grid(("unix_s", "target", "answer", "u95_mm", "age_ms", "latency_ms"))

    def refresh(self) -> None:
        """Show what was heard."""
        told = self._visitor.link.reply("answers")
        options = _pareto(told.get("counts", {}))
        if options["series"] != self._pareto.options["series"]:
            self._pareto.options.update(options)
            self._pareto.update()
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


def _pareto(counts: dict[str, int]) -> dict[str, Any]:
    """Statuses by how often they were, the rarest first: bars are drawn from below."""
    ordered = sorted(counts.items(), key=lambda item: item[1])
    return {
        "animation": False,
        "grid": {"left": 10, "right": 40, "top": 10, "bottom": 20, "containLabel": True},
        "xAxis": {"type": "value", "minInterval": 1},
        "yAxis": {"type": "category", "data": [name for name, _ in ordered]},
        "series": [{"type": "bar", "data": [n for _, n in ordered], "label": {"show": True}}],
    }
