"""What a command takes from the page: as the browser showed it when the button was pressed (`window.vgrdSeen`).

What this process knows by then may be newer than what the person saw.
"""

from collections.abc import Sequence

from nicegui import ui
from nicegui.elements.label import Label
from nicegui.elements.select import Select


def choice(key: str, label: str) -> Select:
    """A choice that a press sends as `key`."""
    with ui.element("div").props(f"data-fact={key}"):
        return ui.select([], label=label).props("outlined").mark(key)


def fact(key: str) -> Label:
    """A text that a press sends as `key`; people read it in other words, drawn together with it."""
    return ui.label("").props(f"data-fact={key}").classes("hidden").mark(key)


def offer(chosen: Select, names: Sequence[str], first: str | None = None) -> None:
    """Offer these names. What is chosen stays so while it is among them; first: where nothing was chosen yet."""
    if list(names) == chosen.options:
        return
    kept = chosen.value if chosen.value in names else None
    chosen.set_options(list(names), value=first if chosen.value is None else kept)
