"""A person at the page of a fake cell, who does what it says."""

import re
import time
from collections.abc import Callable

import pytest

from fakes.cell.playground import Playground
from tests.page.browser import press, tab, until

MOST_STEPS = 40  # a teaching that takes more goes in a circle
TARGET = re.compile(r"\bP\d\b")
UNDO = re.compile("^UNDO")  # and the sample that it takes


class Person:
    """Reads the step, moves the arm with the fake's own buttons, presses the page's."""

    def __init__(self, page, playground: Playground, control) -> None:
        self.page, self.playground, self.control = page, playground, control
        self.steps: list[str] = []

    def step(self) -> tuple[str, str]:
        """What is to be done, and the sentence."""
        what = self.page.locator(".step .what").inner_text()
        return what, self.page.locator(".step").inner_text()

    def obey(self) -> str:
        """Do the one next step; returns what it was."""
        what, words = self.step()
        self.steps.append(what)
        assert len(self.steps) < MOST_STEPS, self.steps
        found = TARGET.search(words)
        target = found[0] if found else ""
        if what == "Turn the object":
            self.playground.press("turn the object by 90 degrees")
            self.done("SPIN")
        elif what == "Touch a target":
            tilted = ", tilted" if "tilted" in words else ""
            self.playground.press(f"tip on {target}{tilted}")
            self.done("TOUCH")
        elif what == "Verify":
            if self.steps[-2] != "Something is odd":
                self.playground.press("turn the object by 90 degrees")
            self.playground.press(f"tip on {target}")
            self.done("VERIFY")
        elif what == "Something is odd":
            self.done(self.page.get_by_role("button", name=UNDO).inner_text())
            self.playground.press("turn the object by 30 degrees")
        elif what == "Wait":
            until(lambda: self.step()[0] != "Wait")
            self.steps.pop()
        elif what == "Start a session":
            self.done("START")
        elif what == "Solve":
            self.insist("SOLVE", self.is_solved)
            until(lambda: self.step()[0] not in ("Solve", "Wait"))
        elif what == "Activate":
            tab(self.page, "Result")
            self.done("ACTIVATE")
            tab(self.page, "Teach")
        return what

    def done(self, button: str) -> None:
        """Press until the version changes."""
        before = self.control.call("teaching")["version"]
        self.insist(button, lambda: self.control.call("teaching")["version"] != before)
        until(lambda: self.shown() == self.control.call("teaching")["version"])

    def insist(self, button: str, is_so: Callable[[], object]) -> None:
        """Press until something is so: the daemon may ask to wait and try again, the page refuses late presses."""
        for _ in range(20):
            press(self.page, button)
            end_s = time.monotonic() + 20.0
            while time.monotonic() < end_s:
                if is_so():
                    return
                time.sleep(0.1)
        pytest.fail(f"{button} changed nothing")

    def is_solved(self) -> bool:
        """Whether the daemon asks for something else by now."""
        return self.control.call("teaching")["step"]["kind"] not in ("solve", "wait")

    def shown(self) -> str:
        """The version that the page shows."""
        return str(self.page.locator("#version").text_content())
