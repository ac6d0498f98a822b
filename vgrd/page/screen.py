"""One browser's page: the state of the cell above all tabs."""

from collections.abc import Callable
from typing import Any, Final

from nicegui import events, ui

from vgrd.page import texts
from vgrd.page.log_in import LogIn
from vgrd.page.parts import show_if, tell
from vgrd.page.tabs import CellTab, ResultTab, RuntimeTab, SessionsTab, TeachTab
from vgrd.page.visitor import Visitor

REFRESH_S: Final = 0.2  # faster than people read; the watchdog does not wait for it
_STATES = " ".join(texts.STATES)
_NEEDED: Final = {"teach": "teaching"}  # without it a tab has nothing to show
_READ: Final = {  # by each tab; refusals of others stand where their replies would
    "cell": ("status", "calibrations", "answers"),
    "teach": ("teaching", "scene"),
    "result": ("calibrations",),
    "runtime": ("answers", "diary"),
    "sessions": ("calibrations",),
}


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
        self.untold = ui.label("").mark("untold")
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
        made, self.panels = {}, {}
        panels = ui.tab_panels(tabs, value="cell", animated=False, keep_alive=True)
        with panels.classes("w-full"):
            for name, kind in kinds.items():
                with ui.tab_panel(name).props(f"data-tab={name}") as self.panels[name]:
                    made[name] = kind(self.visitor)
        tabs.on_value_change(self._open)
        return made

    def _open(self, event: events.ValueChangeEventArguments[Any]) -> None:
        """Show another tab as it is now; those that nobody sees are not drawn."""
        self._seen = str(event.value)
        self.refresh()

    def refresh(self) -> None:
        """Show what the link has heard; when that was is told last, so that it grows old where this fails."""
        shown_ms = round(1e3 * self.link.now_s)
        registers, teaching = self.link.reply("registers"), self.link.reply("teaching")
        state = str(registers.get("state", "STARTING"))
        shape, meaning = texts.STATES[state]
        tell(self.word, f"{shape} {state}")
        words = meaning
        if state in ("INVALID", "DEGRADED", "STARTING") and registers:
            words = f"{registers['name']}: {registers['words']}. {registers['remedy']}"
        tell(self.cause, words)
        self.state.classes(add=state, remove=_STATES.replace(state, ""))
        self._show_tab(self._seen)
        tell(self.version, str(teaching.get("version", "")))
        self.version.props["data-shown"] = shown_ms  # for `assets/watchdog.js`

    def _show_tab(self, name: str) -> None:
        """A tab as it is now, and what of it the daemon does not tell."""
        self.tabs[name].refresh()
        troubles = {op: self.link.trouble(op) for op in _READ[name]}
        what = "; ".join(f"{op}: {words}" for op, words in troubles.items() if words)
        tell(self.untold, texts.UNTOLD.format(what=what) if what else "")
        show_if(self.untold, bool(what))
        needed = _NEEDED.get(name)
        show_if(self.panels[name], needed is None or bool(self.link.reply(needed)))
