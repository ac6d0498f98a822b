"""What was taught when."""

from typing import TYPE_CHECKING

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.parts import Grid, card

if TYPE_CHECKING:
    from vgrd.page.screen import Screen


class SessionsTab:
    """The list is read when somebody asks for it: it takes the daemon some time."""

    def __init__(self, screen: "Screen") -> None:
        self._screen = screen
        with card("Sessions"):
            self._sessions = Grid(("name", "plan", "begun", "samples", "trouble"))
            with ui.element("div").classes("buttons"):
                ui.button("LIST", color=None, on_click=self._list).classes("press").mark("list")

    async def _list(self) -> None:
        try:
            told = await self._screen.link.ask("sessions")
        except ControlError as refusal:
            ui.notify(texts.REFUSED.format(reason=refusal), type="warning")
            return
        self._sessions.show(told["sessions"])

    def refresh(self) -> None:
        """Nothing changes by itself."""
