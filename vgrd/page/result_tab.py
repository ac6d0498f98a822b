"""Whether a calibration is good enough, what differs from the one in use; activate, roll back."""

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.link import Reply
from vgrd.page.parts import Grid, button, card, tell
from vgrd.page.visitor import Seen, Visitor


class ResultTab:
    """The verdict first, in words."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with card("Last result"):
            self._verdict = ui.label(texts.NOT_SOLVED).classes("what").mark("verdict")
            self._sentence = ui.label().mark("goodness")
            self._findings = Grid(("code", "message"))
        with card("Calibrations"):
            self._calibrations = Grid(("id", "active", "made", "session", "verdict", "u95_mm"))
            with ui.element("div").classes("buttons"):
                self._choice = ui.select([], label=texts.CALIBRATION).props("outlined")
                self._choice.mark("choice")
                self._by = ui.input(texts.NAME).props("outlined maxlength=60").mark("by")
                self.activate = button("activate", self._activate)
                button("rollback", self._roll_back)
        with card(texts.DIFFERENCE):
            self._difference = Grid(("target", "mm", "deg", "trouble"))
            with ui.element("div").classes("buttons"):
                compare = ui.button(texts.COMPARE, color=None, on_click=self._compare)
                compare.classes("press").mark("compare")

    async def _activate(self, seen: Seen) -> None:
        name = str(self._choice.value or "")
        await self._visitor.command("activate", seen, calibration=name, by=self._author())

    async def _roll_back(self, seen: Seen) -> None:
        await self._visitor.command("rollback", seen, by=self._author())

    def _author(self) -> str:
        return f"{self._by.value or ''} ({self._visitor.who})".strip()

    async def _compare(self) -> None:
        try:
            told = await self._visitor.link.ask(
                "difference", calibration=str(self._choice.value or "")
            )
        except ControlError as refusal:
            ui.notify(texts.REFUSED.format(reason=refusal), type="warning")
            return
        rows = told["targets"].items()
        self._difference.show({"target": name, **apart} for name, apart in rows)

    def refresh(self) -> None:
        """Show what was heard."""
        link = self._visitor.link
        self._show_solved(link.reply("solved"))
        rows = link.reply("calibrations").get("calibrations", [])
        self._calibrations.show(reversed(rows))
        names = [row["id"] for row in reversed(rows)]
        if names != self._choice.options:
            self._choice.set_options(names, value=names[0] if names else None)
        is_next = link.reply("teaching").get("step", {}).get("kind") == "activate"
        self.activate.classes(add="next" if is_next else "", remove="" if is_next else "next")

    def _show_solved(self, solved: Reply) -> None:
        if not solved:
            return
        is_good = bool(solved["verdict"]["ok"])
        word = f"✔ {texts.ACCEPTED}" if is_good else f"✖ {texts.REJECTED}"
        tell(self._verdict, f"{word}: {solved['calibration'] or texts.NONE}")
        tell(self._sentence, f"{solved['good']}; {solved['limits']}")
        self._findings.show(solved["verdict"]["findings"])
