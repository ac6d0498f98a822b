"""One browser's page: the state of the cell above all tabs, and the commands that its buttons give."""

from collections.abc import Callable
from typing import Any, Final

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.cell_tab import CellTab
from vgrd.page.link import Link, Reply
from vgrd.page.parts import tell
from vgrd.page.result_tab import ResultTab
from vgrd.page.runtime_tab import RuntimeTab
from vgrd.page.sessions_tab import SessionsTab
from vgrd.page.teach_tab import TeachTab

REFRESH_S: Final = 0.2  # faster than people read; the watchdog does not wait for it
_STATES = " ".join(texts.STATES)


class Screen:
    """What one browser shows; `who` is written into the log beside every command."""

    def __init__(self, link: Link, who: str) -> None:
        self.link, self.who = link, who
        self.version = ui.label("").props("id=version").classes("hidden")
        with (
            ui.element("header")
            .classes("state")
            .props("role=status aria-live=polite") as self.state
        ):
            self.word = ui.label("").classes("word").mark("state")
            self.cause = ui.label("").mark("cause")
        self.tabs = self._tabs()
        ui.timer(REFRESH_S, self.refresh)

    def _tabs(self) -> list[CellTab | TeachTab | ResultTab | RuntimeTab | SessionsTab]:
        kinds: dict[str, Callable[[Any], Any]] = {
            "cell": CellTab,
            "teach": TeachTab,
            "result": ResultTab,
            "runtime": RuntimeTab,
            "sessions": SessionsTab,
        }
        with (
            ui.tabs()
            .props("align=justify no-caps outside-arrows mobile-arrows")
            .classes("w-full") as tabs
        ):
            for name, label in texts.TABS.items():
                ui.tab(name, label).mark(f"tab-{name}")
        made = []
        with ui.tab_panels(tabs, value="cell", animated=False, keep_alive=True).classes("w-full"):
            for name, kind in kinds.items():
                with ui.tab_panel(name):
                    made.append(kind(self))
        return made

    def refresh(self) -> None:
        """Show what the link has heard."""
        registers, teaching = self.link.reply("registers"), self.link.reply("teaching")
        state = str(registers.get("state", "STARTING"))
        shape, meaning = texts.STATES[state]
        tell(self.word, f"{shape} {state}")
        words = meaning
        if state in ("INVALID", "DEGRADED", "STARTING") and registers:
            words = f"{registers['name']}: {registers['words']}. {registers['remedy']}"
        tell(self.cause, words)
        self.state.classes(add=state, remove=_STATES.replace(state, ""))
        for tab in self.tabs:
            tab.refresh()
        tell(self.version, str(teaching.get("version", "")))

    async def command(self, op: str, version: str, **arguments: object) -> Reply | None:
        """Give a command as of the version that was seen; None where it was refused, which is told."""
        if version:
            arguments["version"] = version
        try:
            reply = await self.link.command(op, self.who, **arguments)
        except ControlError as refusal:
            ui.notify(
                texts.REFUSED.format(reason=refusal), type="warning", timeout=8000, multi_line=True
            )
            return None
        words = texts.RECORDED if "sample" in reply else texts.DID
        ui.notify(words.format(what=op, sample=reply.get("sample")), timeout=2500)
        return reply
