"""A tab of the page without a browser: what it was told is set by hand, what it commands is kept."""

import asyncio
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from nicegui import Client, ElementFilter, core, ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments
from nicegui.page import page

from fakes.testing import ManualClock
from tests.page.daemon import registers, teaching
from vgrd.errors import ControlError
from vgrd.page.link import Heard, Link
from vgrd.page.visitor import Visitor


class PaperLink(Link):
    """Hears what a test sets in `told`; `given` holds what was asked of it."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        super().__init__(Path(), self.clock)
        self.told: dict[str, Any] = {"registers": registers(), "teaching": teaching()}
        self.heard["registers"] = Heard(self.now_s, registers())  # a press is taken
        self.given: list[tuple[str, Mapping[str, Any]]] = []
        self.answers: dict[str, Any] = {}  # to what is asked now and then; else it is refused

    def reply(self, op: str) -> Mapping[str, Any]:
        """As it is set, and not too old."""
        return self.told.get(op, {})

    def trouble(self, op: str) -> str:
        """Nothing is refused."""
        return ""

    async def _call(self, op: str, timeout_s: float, **arguments: object) -> Mapping[str, Any]:
        self.given.append((op, arguments))
        if op not in self.answers:
            raise ControlError(f"{op} is refused")
        return dict(self.answers[op])


class PaperTab:
    """One tab, drawn for nobody. `look` draws it as it is now, `press` presses a button of it."""

    def __init__(self, kind: Callable[[Visitor], Any]) -> None:
        self.link = PaperLink()
        self.told = self.link.told
        self._loop = asyncio.new_event_loop()
        core.loop = self._loop
        self._client = Client(page("/"), request=None)
        self.tab = self._within(lambda: kind(Visitor(self.link, "here")))

    def close(self) -> None:
        """Forget it."""
        self._within(lambda: None)
        self._client.delete()
        self._loop.close()

    def look(self) -> None:
        """Draw what was heard."""
        self._within(self.tab.refresh)

    def step(self, **changes: Any) -> None:
        """Another advice: the version stays, as nobody did anything. version: somebody did."""
        now = self.told["teaching"]
        version = changes.pop("version", now["version"])
        self.told["teaching"] = {**now, "version": version, "step": {**now["step"], **changes}}
        self.look()

    def find(self, marker: str) -> Any:
        """The element with this mark."""
        with self._client:
            (found,) = ElementFilter(marker=marker)
        return found

    def is_lit(self, marker: str) -> bool:
        """Whether a button is the one that the step means."""
        return "next" in self.find(marker).classes

    def press(self, marker: str, **seen: str) -> None:
        """Press a button while the browser shows `seen`, and whatever else it takes as it is."""
        shown = {**self.shown(), **seen}
        sent = json.dumps([self.told["teaching"]["version"], 1e3 * self.link.now_s, shown])
        self._run(self._click(self.find(marker), sent))

    def shown(self) -> dict[str, str]:
        """What `window.vgrdSeen` reads, once the browser shows all that this process knows."""
        with self._client:
            parts = [one for one in ElementFilter() if "data-fact" in one.props]
        return {one.props["data-fact"]: _text(one) for one in parts}

    async def _click(self, button: Element, sent: str) -> None:
        for listener in list(button._event_listeners.values()):
            if listener.type == "click" and listener.handler is not None:
                event = GenericEventArguments(sender=button, client=self._client, args=sent)
                with self._client:
                    done = listener.handler(event)
                    if done is not None:
                        await done

    def _within(self, work: Callable[[], Any]) -> Any:
        async def worked() -> Any:
            with self._client:
                return work()

        return self._run(worked())

    def _run(self, work: Any) -> Any:
        return self._loop.run_until_complete(work)


def _text(part: Element) -> str:
    inside = list(part.descendants(include_self=True))
    chosen = [one.value for one in inside if isinstance(one, ui.select)]
    return str(chosen[0] or "") if chosen else str(part.text)  # type: ignore[attr-defined]
