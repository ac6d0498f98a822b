"""Whether a calibration is good enough and why, what verifications say, what differs; activate, roll back."""

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import bars, error_map
from vgrd.page.link import Reply
from vgrd.page.parts import Grid, button, card, numbers, plain_button, redraw, show_if, tell
from vgrd.page.visitor import Seen, Visitor

_PERCENT = 100


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
        self._trials()
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
            with ui.element("div").classes("buttons"):
                self._choice = ui.select([], label=texts.CALIBRATION).props("outlined")
                self._choice.mark("choice")
                self._by = ui.input(texts.NAME).props("outlined maxlength=60").mark("by")
                self.activate = button("activate", self._activate)
                button("rollback", self._roll_back)
                plain_button(texts.COMPARE, self._compare).mark("compare")
            with ui.element("div") as self._apart:
                ui.label(texts.DIFFERENCE).classes("quiet")
                self._difference = Grid(("target", "mm", "deg", "trouble"))
            show_if(self._apart, is_shown=False)

    def _trials(self) -> None:
        """The calibration in use, where robots go by it."""
        with card(texts.TRIALS):
            self._trial_words = ui.label().mark("trials")
            with ui.element("div").classes("buttons"):
                self._target = (
                    ui.select([], label=texts.TARGET).props("outlined").mark("trial-target")
                )
                plain_button(texts.WHERE, self._show_where).mark("where")
                button("verify", self._verify)
                button("undo", self._undo)
            self._where = ui.label().mark("where-words")
            self._trial_grid = Grid(("target", "off_mm", "counts", "fails", "trouble"))

    async def _show_where(self) -> None:
        """Where the flange has to go for the picture of now."""
        told = await self._visitor.ask("ec", target=str(self._target.value or ""))
        if told is None:
            return
        pose = texts.POSE.format(
            position=numbers(told["position_mm"], 2), rotation=numbers(told["rotvec_deg"], 2)
        )
        tell(
            self._where,
            texts.WHERE_IS.format(target=told["target"], pose=pose, u95=told["u95_mm"]),
        )

    async def _verify(self, seen: Seen) -> None:
        await self._visitor.command("verify", seen, target=str(self._target.value or ""))

    async def _undo(self, seen: Seen) -> None:
        await self._visitor.command("undo", seen, kind="verify")

    async def _activate(self, seen: Seen) -> None:
        name = str(self._choice.value or "")
        await self._visitor.command("activate", seen, calibration=name, by=self._author())

    async def _roll_back(self, seen: Seen) -> None:
        await self._visitor.command("rollback", seen, by=self._author())

    def _author(self) -> str:
        return f"{self._by.value or ''} ({self._visitor.who})".strip()

    async def _compare(self) -> None:
        told = await self._visitor.ask("difference", calibration=str(self._choice.value or ""))
        if told is None:
            return
        rows = told["targets"].items()
        self._difference.show({"target": name, **apart} for name, apart in rows)
        show_if(self._apart, is_shown=True)

    def refresh(self) -> None:
        """Show what was heard."""
        link = self._visitor.link
        told = link.reply("result")
        is_solved = bool(told.get("result"))
        tell(self._unsolved, link.trouble("result") or texts.NOT_SOLVED)
        show_if(self._unsolved, not is_solved)
        for area in (self._judged, self._found):
            show_if(area, is_solved)
        if is_solved and told != self._shown:
            self._shown = told
            self._show_result(str(told["session"]), told["result"])
        show_if(self._figures, is_shown=bool((told.get("result") or {}).get("budget")))
        show_if(self._report, is_shown=bool(told.get("result")))
        rows = link.reply("calibrations").get("calibrations", [])
        self._calibrations.show(reversed(rows))
        names = [row["id"] for row in reversed(rows)]
        if not link.trouble("calibrations") and names != self._choice.options:
            self._choice.set_options(names, value=names[0] if names else None)
        self._show_trials(link.reply("trials"), link.reply("status").get("targets", []))
        is_next = link.reply("teaching").get("step", {}).get("kind") == "activate"
        self.activate.classes(add="next" if is_next else "", remove="" if is_next else "next")

    def _show_trials(self, told: Reply, targets: list[str]) -> None:
        tell(self._trial_words, self._visitor.link.trouble("trials") or _in_words(told))
        self._trial_grid.show(reversed(told.get("verifications", ())))
        if targets and targets != self._target.options:
            self._target.set_options(targets, value=targets[0])

    def _show_result(self, session: str, result: Reply) -> None:
        is_good = bool(result["verdict"]["ok"])
        word = f"✔ {texts.ACCEPTED}" if is_good else f"✖ {texts.REJECTED}"
        self._verdict.classes(
            add="" if is_good else "refused", remove="refused" if is_good else ""
        )
        tell(self._verdict, f"{word}: {result['calibration'] or session}")
        tell(self._sentence, str(result["good"]))
        tell(self._better, _better(result))
        self._report.props["href"] = f"/report?session={session}"
        checked = result["verification"]
        tell(self._goes, texts.GOES[checked["verdict"]])
        is_bad = checked["verdict"] == "no go"
        self._goes.classes(add="refused" if is_bad else "", remove="" if is_bad else "refused")
        tell(self._confirms, str(checked["words"]))
        self._checks.show(checked["verifications"])
        self._findings.show(result["verdict"]["findings"])
        self._levels.show(result.get("levels", ()))
        self._touches.show(result.get("touches", ()))
        redraw(self._budget, bars(_shares(result.get("budget", {})), texts.BUDGET))
        redraw(self._map, error_map(result.get("map", {}), result.get("tolerance_mm")))


def _in_words(trials: Reply) -> str:
    """Go or no go, and why."""
    return f"{texts.GOES[trials['verdict']]}: {trials['words']}" if trials else texts.NOT_IN_USE


def _better(result: Reply) -> str:
    """What limits it, and what would make it better."""
    if not result["limits"]:
        return ""
    return texts.LIMITED.format(what=result["limits"], remedy=result["add"] or texts.NONE)


def _shares(budget: Reply) -> dict[str, int]:
    """Percent of the variance by link, mean of the targets; links that nobody would see are left out."""
    means = {link: round(_PERCENT * share) for link, share in budget.get("means", {}).items()}
    return {link: share for link, share in means.items() if share}
