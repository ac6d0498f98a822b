"""One browser's page: the state of the cell above all tabs."""

from collections.abc import Callable
from typing import Any, Final

from nicegui import events, ui

from vgrd.page import texts
from vgrd.page.log_in import LogIn
from vgrd.page.parts import tell
from vgrd.page.tabs import CellTab, ResultTab, RuntimeTab, SessionsTab, TeachTab
from vgrd.page.visitor import Visitor

REFRESH_S: Final = 0.2  # faster than people read; the watchdog does not wait for it
_STATES = " ".join(texts.STATES)


class Screen:
    """What one browser shows."""

    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.link = visitor, visitor.link
        self.version = ui.label("").props("id=version").classes("hidden")
        with (
            ui.element("header")
            .classes("state")
            .props("role=status aria-live=polite") as self.state
        ):
            self.word = ui.label("").classes("word").mark("state")
            self.cause = ui.label("").mark("cause")
        LogIn(visitor)
        self._seen = "cell"
        self.tabs = self._tabs()
        ui.timer(REFRESH_S, self.refresh)

    def _tabs(self) -> dict[str, CellTab | TeachTab | ResultTab | RuntimeTab | SessionsTab]:
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
        made = {}
        panels = ui.tab_panels(tabs, value="cell", animated=False, keep_alive=True)
        with panels.classes("w-full"):
            for name, kind in kinds.items():
                with ui.tab_panel(name).props(f"data-tab={name}"):
                    made[name] = kind(self.visitor)
        tabs.on_value_change(self._open)
        return made

    def _open(self, event: events.ValueChangeEventArguments[Any]) -> None:
        """Show another tab as it is now; those that nobody sees are not drawn."""
        self._seen = str(event.value)
        self.refresh()

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
        self.tabs[self._seen].refresh()
        tell(self.version, str(teaching.get("version", "")))
