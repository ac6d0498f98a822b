"""A key answers the screen that was shown when it was pressed, whatever has come meanwhile."""

from contextlib import contextmanager
from typing import Any

from rich.console import Console

from tests.page.daemon import teaching
from vgrd.commands.wizard import keyboard, teach
from vgrd.errors import DaemonUnreachable


class Typist:
    """Client and keyboard at once: what is typed lies in a queue until it is read or dropped."""

    def __init__(self, *looks: tuple[Any, str]) -> None:
        self.looks = list(
            looks
        )  # state and what is typed while it is fetched; the last one leaves
        self.typed = ""
        self.given: list[tuple[str, dict[str, Any]]] = []

    def call(self, op: str, timeout_s: float, **arguments: Any) -> Any:
        if op != "teaching":
            self.given.append((op, arguments))
            return {}
        state, typed = self.looks.pop(0)
        self.typed += typed
        if state is None:
            raise DaemonUnreachable("it does not answer")
        return state

    @contextmanager
    def keys(self):
        def key(wait_s: float) -> str | None:
            if not self.looks:
                return "q"
            key, self.typed = self.typed[:1], self.typed[1:]
            return key or None

        yield key

    def forget(self) -> None:
        self.typed = ""


def state(version: str, target: str) -> dict[str, Any]:
    told = teaching()
    step = {**told["step"], "target": target, "words": f"put the tip on {target}"}
    return {**told, "version": version, "step": step}


def given(monkeypatch, *looks: tuple[Any, str]) -> list[tuple[str, dict[str, Any]]]:
    typist = Typist(*looks, (state("v9", "P1"), ""))
    monkeypatch.setattr(keyboard, "single_keys", typist.keys)
    monkeypatch.setattr(keyboard, "forget_typed", typist.forget)
    monkeypatch.setattr("rich.live.get_console", lambda: Console(quiet=True))
    teach._by_keys(typist, "joint")
    return typist.given


def test_a_key_of_the_screen_that_is_shown_is_obeyed(monkeypatch):
    shown = state("v1", "P1")
    assert given(monkeypatch, (shown, ""), (shown, " ")) == [
        ("touch", {"target": "P1", "version": "v1"})
    ]


def test_a_key_of_the_former_screen_is_dropped(monkeypatch):
    assert given(monkeypatch, (state("v1", "P1"), ""), (state("v2", "P1"), " ")) == []
    assert given(monkeypatch, (state("v1", "P1"), ""), (state("v1", "P2"), " ")) == []


def test_a_key_of_a_screen_without_a_link_is_dropped(monkeypatch):
    assert given(monkeypatch, (None, ""), (state("v1", "P1"), " ")) == []
