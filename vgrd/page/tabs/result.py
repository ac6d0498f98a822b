"""Whether a calibration is good enough and why, what verifications say, what differs; activate, roll back."""

import time

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import bars, error_map
from vgrd.page.link import Reply
from vgrd.page.moment import FADE_S, Moment
from vgrd.page.parts import (
    Grid,
    button,
    card,
    dress_if,
    moment,
    plain_button,
    redraw,
    show_if,
    tell,
)
from vgrd.page.shown import choice, fact, offer
from vgrd.page.tabs.trials import TrialsCard
from vgrd.page.visitor import Seen, Visitor

_PERCENT = 100
_DIFFERENCE_S = 60.0  # of a table: it names both calibrations, and takes time to read


class ResultTab:
    """The verdict first, in words."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._shown: object = None
        self._unsolved = ui.label(texts.NOT_SOLVED).classes("what").mark("unsolved")
        with ui.element("div").classes("columns") as self._judged:
            with card(texts.LAST_RESULT):
                self._verdict = ui.label(texts.NOT_SOLVED).classes("what").mark("verdict")
                self._sentence = ui.label().mark("goodness")
                self._better = ui.label().classes("quiet").mark("better")
                self._report = ui.link(texts.REPORT, "/report", new_tab=True)
                self._report.classes("press").mark("report")
            with card(texts.VERIFICATION):
                self._goes = ui.label(texts.NOT_SOLVED).classes("what").mark("goes")
                self._confirms = ui.label().mark("confirms")
                self._checks = Grid(("target", "off_mm", "counts", "fails", "trouble"))
        self._activation()
        self._trials = TrialsCard(visitor)
        ui.timer(FADE_S, self.fade)
        with ui.element("div").classes("columns") as self._figures:
            with card():
                self._budget = ui.echart(bars({}, texts.BUDGET)).classes("w-full h-64")
            with card():
                self._map = ui.echart(error_map({}, None)).classes("w-full h-64")
            with card(texts.NOISE):
                self._levels = Grid(("noise", "stated", "found", "unit"))
            with card(texts.TOUCHES):
                self._touches = Grid(("name", "off_mm", "left_out_mm", "reason"))
        with card(texts.FOUND) as self._found:
            self._findings = Grid(("code", "message"))

    def _activation(self) -> None:
        with card(texts.CALIBRATIONS):
            self._calibrations = Grid(("id", "active", "made", "session", "verdict", "u95_mm"))
            self._candidate = ui.label().mark("candidate")
            self._active = fact("active")
            with ui.element("div").classes("buttons"):
                self._choice = choice("calibration", texts.CALIBRATION)
                self._newest: str | None = None
                self._by = ui.input(texts.NAME).props("outlined maxlength=60").mark("by")
                self.activate = button("activate", self._activate)
                button("rollback", self._roll_back)
                plain_button(texts.COMPARE, self._compare).mark("compare")
            with ui.element("div") as self._apart:
                self._between = ui.label().classes("quiet").mark("between")
                self._difference = Grid(("target", "mm", "deg", "trouble"))
            self._moment = Moment(self._visitor.link, _DIFFERENCE_S)
            show_if(self._apart, is_shown=False)

    async def _activate(self, seen: Seen) -> None:
        by = self._author()
        await self._visitor.command("activate", seen, calibration=seen["calibration"], by=by)

    async def _roll_back(self, seen: Seen) -> None:
        await self._visitor.command("rollback", seen, active=seen["active"], by=self._author())

    def _author(self) -> str:
        return f"{self._by.value or ''} ({self._visitor.who})".strip()

    async def _compare(self) -> None:
        show_if(self._apart, is_shown=False)
        self._moment.begin()
        told = await self._visitor.ask("difference", calibration=str(self._choice.value or ""))
        if told is None or self._moment.is_over:
            return
        words = texts.DIFFERENCE.format(
            chosen=told["calibration"], active=told["with"], time=moment(time.time())
        )
        tell(self._between, words)
        rows = told["targets"].items()
        self._difference.show({"target": name, **apart} for name, apart in rows)
        show_if(self._apart, is_shown=True)

    def fade(self) -> None:
        """Take away what is not so any more."""
        if self._moment.is_over:
            show_if(self._apart, is_shown=False)

    def refresh(self) -> None:
        """Show what was heard."""
        link = self._visitor.link
        told = link.reply("result")
        result = told.get("result") or {}
        tell(self._unsolved, link.trouble("result") or texts.NOT_SOLVED)
        show_if(self._unsolved, not result)
        for area in (self._judged, self._found):
            show_if(area, bool(result))
        if result and told != self._shown:
            self._shown = told
            self._show_result(str(told["session"]), result)
        show_if(self._figures, bool(result.get("budget")))
        self._show_calibrations(link.reply("calibrations"), link.reply("teaching"))
        self._trials.refresh()

    def _show_calibrations(self, told: Reply, teaching: Reply) -> None:
        """All of them, newest first, and whether the chosen one is the one that the step means."""
        rows = list(reversed(told.get("calibrations", ())))
        self._calibrations.show(rows)
        tell(self._active, told.get("active") or "")
        names = [row["id"] for row in rows]
        if "calibrations" in told:  # a choice outlives a moment without a reply
            newest = names[0] if names else None
            offer(self._choice, names, newest, self._newest)
            self._newest = newest
        step = teaching.get("step", {})
        is_next = step.get("kind") == "activate"
        tell(self._candidate, str(step["words"]) if is_next else "")
        meant = (teaching.get("candidate") or {}).get("id") if is_next else None
        is_mine = meant is not None and meant == self._choice.value
        dress_if(self.activate, "next", is_mine)

    def _show_result(self, session: str, result: Reply) -> None:
        is_good = bool(result["verdict"]["ok"])
        word = f"✔ {texts.ACCEPTED}" if is_good else f"✖ {texts.REJECTED}"
        dress_if(self._verdict, "refused", not is_good)
        name = result["calibration"]
        tell(self._verdict, f"{word}: {session}" + (f", {name}" if name else ""))
        tell(self._sentence, str(result["good"]))
        tell(self._better, _better(result))
        self._report.props["href"] = f"/report?session={session}"
        checked = result["verification"]
        tell(self._goes, texts.GOES[checked["verdict"]])
        dress_if(self._goes, "refused", checked["verdict"] == "no go")
        tell(self._confirms, str(checked["words"]))
        self._checks.show(checked["verifications"])
        self._findings.show(result["verdict"]["findings"])
        self._levels.show(result.get("levels", ()))
        self._touches.show(result.get("touches", ()))
        redraw(self._budget, bars(_shares(result.get("budget", {})), texts.BUDGET))
        redraw(self._map, error_map(result.get("map", {}), result.get("tolerance_mm")))


def _better(result: Reply) -> str:
    """What limits it, and what would make it better."""
    if not result["limits"]:
        return ""
    return texts.LIMITED.format(what=result["limits"], remedy=result["add"] or texts.NONE)


def _shares(budget: Reply) -> dict[str, int]:
    """Percent of the variance by link, mean of the targets; links that nobody would see are left out."""
    means = {link: round(_PERCENT * share) for link, share in budget.get("means", {}).items()}
    return {link: share for link, share in means.items() if share}
