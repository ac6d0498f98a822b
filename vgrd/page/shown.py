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


def offer(
    chosen: Select, names: Sequence[str], meant: str | None = None, before: str | None = None
) -> None:
    """Offer these names. What a person chose stays so while it is among them.

    meant: one of them, for who chose none; before: the one that was meant up to now.
    """
    if list(names) == chosen.options:
        return
    kept = chosen.value if chosen.value in names else None
    chosen.set_options(list(names), value=meant if chosen.value in (None, before) else kept)
