"""What was taught when: a list, the error from session to session, two of them compared, reports to print."""

import time

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import over_time
from vgrd.page.link import Reply
from vgrd.page.parts import Grid, card, moment, plain_button, redraw, tell
from vgrd.page.shown import offer
from vgrd.page.visitor import Visitor


class SessionsTab:
    """The list is read when somebody asks for it: it takes the daemon some time."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with card(texts.TABS["sessions"]):
            with ui.element("div").classes("buttons"):
                plain_button(texts.LIST, self._list).mark("list")
                self._session = ui.select([], label=texts.SESSION, on_change=self._point)
                self._session.props("outlined").mark("session")
                self._report = ui.link(texts.REPORT, "/report", new_tab=True).classes("press")
            self._sessions = Grid(("name", "plan", "begun", "samples", "verdict", "trouble"))
        with ui.element("div").classes("columns"):
            with card():
                self._line = ui.echart(over_time([], texts.TIMELINE)).classes("w-full h-64")
            with card(texts.COMPARISON):
                with ui.element("div").classes("buttons"):
                    self._pair = [
                        ui.select([], label=texts.CALIBRATION).props("outlined").mark(mark)
                        for mark in ("first", "second")
                    ]
                    plain_button(texts.COMPARE, self._compare).mark("compare-two")
                self._apart = ui.label().classes("quiet")
                self._difference = Grid(("target", "mm", "deg", "trouble"))

    async def _list(self) -> None:
        told = await self._visitor.ask("sessions")
        if told is None:
            return
        verdicts = {row.get("session"): row["verdict"] for row in self._made()}
        rows = [{**row, "verdict": verdicts.get(row["name"])} for row in told["sessions"]]
        self._sessions.show(rows)
        names = [row["name"] for row in rows]
        offer(self._session, names, *names[:1])

    def _point(self) -> None:
        """Lead to the report of the chosen session."""
        self._report.props["href"] = f"/report?session={self._session.value or ''}"
        self._report.update()

    async def _compare(self) -> None:
        first, second = (str(one.value or "") for one in self._pair)
        told = await self._visitor.ask("difference", **{"with": first, "calibration": second})
        if told is None:
            return
        tell(
            self._apart,
            texts.BETWEEN.format(first=first, second=second, time=moment(time.time())),
        )
        rows = told["targets"].items()
        self._difference.show({"target": name, **apart} for name, apart in rows)

    def _made(self) -> list[Reply]:
        return list(self._visitor.link.reply("calibrations").get("calibrations", ()))

    def refresh(self) -> None:
        """Calibrations come by themselves, the list when it is asked for."""
        rows = self._made()
        made = [(row["made_unix_s"], row["u95_mm"]) for row in rows if "made_unix_s" in row]
        redraw(self._line, over_time(made, texts.TIMELINE))
        names = [row["id"] for row in rows]
        if self._visitor.link.trouble("calibrations"):
            return  # the choices stay for what comes back
        for choice, value in zip(self._pair, (names[-2:-1], names[-1:]), strict=True):
            offer(choice, names, *value)
