"""Log in and out, where the page has a password."""

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.access.guard import Guard
from vgrd.page.access.password import LONGEST
from vgrd.page.parts import tell
from vgrd.page.visitor import Visitor

_REFRESH_S = 0.5


class LogIn:
    """Tells whether this browser may command, and asks for the password; draws nothing where there is none."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        if visitor.guard is not None:
            self._draw(visitor.guard)

    def _draw(self, guard: Guard) -> None:
        with ui.element("div").classes("buttons items-center"):
            self._session = ui.label().mark("session")
            self._in = _button(texts.LOG_IN).mark("log-in")
            self._out = _button(texts.LOG_OUT).mark("log-out")
        self._dialog = ui.dialog().props(f'aria-label="{texts.LOG_IN}"')
        with self._dialog, ui.element("div").classes("card"):
            self._word = ui.input(texts.PASSWORD, password=True)
            self._word.props(
                f"outlined autofocus autocomplete=current-password maxlength={LONGEST}"
            )
            with ui.element("div").classes("buttons"):
                enter = _button(texts.ENTER).mark("enter")
        self._in.on_click(self._open)
        self._out.on_click(lambda: guard.log_out(self._visitor.mark, self._visitor.address))
        enter.on_click(lambda: self._log_in(guard))
        self._word.on("keydown.enter", lambda: self._log_in(guard))
        self._refresh(guard)
        ui.timer(_REFRESH_S, lambda: self._refresh(guard))

    def _open(self) -> None:
        self._word.set_value("")  # what somebody typed and left
        self._dialog.open()

    async def _log_in(self, guard: Guard) -> None:
        word = str(self._word.value or "")
        self._word.set_value("")
        try:
            await guard.log_in(self._visitor.mark, self._visitor.address, word)
        except ControlError as refusal:
            ui.notify(texts.REFUSED.format(reason=refusal), type="warning", timeout=8000)
        else:
            self._dialog.close()

    def _refresh(self, guard: Guard) -> None:
        left_s = guard.left_s(self._visitor.mark)
        is_in = left_s is not None
        words = (
            texts.MAY_COMMAND.format(minutes=left_s / 60) if left_s is not None else texts.MAY_VIEW
        )
        tell(self._session, words)
        self._in.set_visibility(not is_in)
        self._out.set_visibility(is_in)


def _button(words: str) -> ui.button:
    return ui.button(words, color=None).classes("press")
