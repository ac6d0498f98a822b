"""What was taught when."""

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.parts import Grid, card
from vgrd.page.visitor import Visitor


class SessionsTab:
    """The list is read when somebody asks for it: it takes the daemon some time."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with card("Sessions"):
            self._sessions = Grid(("name", "plan", "begun", "samples", "trouble"))
            with ui.element("div").classes("buttons"):
                ui.button("LIST", color=None, on_click=self._list).classes("press").mark("list")

    async def _list(self) -> None:
        try:
            told = await self._visitor.link.ask("sessions")
        except ControlError as refusal:
            ui.notify(texts.REFUSED.format(reason=refusal), type="warning")
            return
        self._sessions.show(told["sessions"])

    def refresh(self) -> None:
        """Nothing changes by itself."""
