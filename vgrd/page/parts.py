"""What all tabs are made of: cards, tables, words for numbers, buttons that say which version they were shown at."""

import time
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from nicegui import events, ui
from nicegui.elements.echart import EChart
from nicegui.elements.label import Label
from nicegui.elements.table import Table

from vgrd.page import texts
from vgrd.page.visitor import Seen

# What the person saw when the button was pressed, not what this process knows by now.
_PRESSED: Final = "() => emit(window.vgrdSeen())"
_MINUTE_S, _DAY_S = 60, 86400
Act = Callable[[Seen], Awaitable[None]]


def card(title: str = "", kind: str = "") -> ui.element:
    """A grey area with a title."""
    area = ui.element("section").classes(f"card {kind}")
    if title:
        with area:
            heading(title)
    return area


def heading(words: str) -> None:
    """Of a card."""
    with ui.element("h2"):
        ui.label(words)


def button(key: str, act: Act) -> ui.button:
    """A large button; act gets what its page showed when it was pressed."""

    async def pressed(event: events.GenericEventArguments) -> None:
        await act(Seen.of(event.args))

    shown = ui.button(texts.BUTTONS[key], color=None).classes("press").mark(key)
    return shown.on("click", pressed, js_handler=_PRESSED)


def plain_button(words: str, act: Callable[[], Awaitable[None]]) -> ui.button:
    """A large button that changes nothing in the cell."""
    return ui.button(words, color=None, on_click=act).classes("press")


def live_picture() -> None:
    """The picture that `assets/watchdog.js` fetches and marks."""
    with ui.element("div").classes("view"):
        ui.element("img").classes("live").props('alt="what the camera sees, with its tags"')
        ui.element("svg").classes("marks").props("aria-hidden=true")
    ui.label(texts.NO_PICTURE).classes("picture-words quiet")


class Grid:
    """A table of which only what changed is sent."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)
        heads = [
            {"name": key, "label": texts.COLUMNS[key], "field": key, "align": "left"}
            for key in self._columns
        ]
        self.table: Table = ui.table(columns=heads, rows=[], row_key="row")
        self.table.props(
            'flat dense hide-pagination :rows-per-page-options="[0]" no-data-label="-"'
        )

    def show(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Show these rows."""
        new = [
            {"row": i, **{key: _cell(key, row.get(key)) for key in self._columns}}
            for i, row in enumerate(rows)
        ]
        if new != self.table.rows:
            self.table.rows = new


def redraw(chart: EChart, options: dict[str, Any]) -> None:
    """Draw a chart anew, if it shows something else."""
    if {**chart.options, **options} != chart.options:
        chart.options.update(options)
        chart.update()


def show_if(area: ui.element, is_shown: bool) -> None:
    """Show or hide, if it is not so already."""
    if area.visible != is_shown:
        area.set_visibility(is_shown)


def dress_if(area: ui.element, kind: str, is_so: bool) -> None:
    """Give it this class of `assets/page.css`, or take that away."""
    area.classes(add=kind if is_so else "", remove="" if is_so else kind)


def tell(label: Label, words: str) -> None:
    """Change a text, if it is another one."""
    if label.text != words:
        label.set_text(words)


def in_words(value: object) -> str:
    """A value as people read it."""
    if value is None or value == "":
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {in_words(one)}" for key, one in value.items()) or "-"
    return str(value)


def moment(unix_s: float, now_unix_s: float | None = None) -> str:
    """Hour, minute and second of this computer, and the day where it is not that of now (None: the clock's)."""
    then, now = time.localtime(unix_s), time.localtime(now_unix_s)
    return day_time(unix_s) if then[:3] != now[:3] else time.strftime("%H:%M:%S", then)


def day_time(unix_s: float) -> str:
    """Day too."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(unix_s))


def span(seconds: float, digits: int = 1) -> str:
    """How long something took, with its days; digits: behind the point, below a minute."""
    if seconds < _MINUTE_S:
        return texts.LASTED.format(seconds=f"{seconds:.{digits}f}")
    days, rest = divmod(round(seconds), _DAY_S)
    words = f"{rest // 3600:02d}:{rest // 60 % 60:02d}:{rest % 60:02d}"
    return texts.DAYS.format(days=days, time=words) if days else words


def _cell(column: str, value: object) -> str:
    """A value as its column says it: a number alone does not tell whether it is a time."""
    known = _BY_COLUMN.get(column)
    return known(value) if known and isinstance(value, int | float) else in_words(value)


_BY_COLUMN: Final[Mapping[str, Callable[[float], str]]] = {"unix_s": moment, "lasted_s": span}


def numbers(values: Sequence[float] | None, digits: int = 1) -> str:
    """x, y, z."""
    return "-" if values is None else ", ".join(f"{value:.{digits}f}" for value in values)


def ago(seconds: float | None) -> str:
    """Since when, in words."""
    return texts.NEVER if seconds is None else texts.AGO.format(time=span(seconds, digits=0))
