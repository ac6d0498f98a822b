"""A command that says what it is of is done to that or refused: to what else it might have been, it never is."""

import asyncio
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fakes.testing import ManualClock
from vgrd.cell.control.operations import Operations
from vgrd.errors import ControlError, StaleVersion


class Cell:
    """The operations of a cell of paper; `done`: what they did to what."""

    def __init__(self, session: str = "", active: str = "") -> None:
        self.done: list[str] = []
        parts: dict[str, Any] = dict.fromkeys(signature(Operations).parameters)
        self.operations = Operations(
            **parts | {"runtime_dir": Path(), "clock": ManualClock(), "activation": self}
        )
        self.store, self.active = self, active
        calibration = SimpleNamespace(id=active) if active else None
        self.operations.serving = SimpleNamespace(calibration=calibration)  # type: ignore[assignment]
        writer = SimpleNamespace(header=SimpleNamespace(name=session)) if session else None
        self.recorder, self.last_touch = SimpleNamespace(writer=writer), None
        self.operations.teaching = self  # type: ignore[assignment]
        self.operations.trials = SimpleNamespace(  # type: ignore[assignment]
            add=self.add_trial, undo=self.undo_trial
        )

    def ask(self, op: str, **arguments: str) -> str:
        """What a command did."""
        asyncio.run(self.operations.table()[op].perform(arguments))
        return self.done[-1]

    async def tip_at(self, target: str) -> str:
        return target

    async def touch(self, target: str, kind: str) -> dict[str, Any]:
        self.check_open()
        return self.note(f"{kind} of session")

    async def undo(self, kind: str | None, sample: int | None) -> dict[str, Any]:
        self.check_open()
        return self.note("undo of session")

    async def add_trial(self, touch: str) -> dict[str, Any]:
        return self.note("verify of calibration")

    async def undo_trial(self) -> dict[str, Any]:
        return self.note("undo of calibration")

    async def bear_out(self, touch: str) -> dict[str, Any]:
        return {}

    async def activate(self, name: str, by: str) -> dict[str, Any]:
        return self.note(f"{name} in use")

    def current_id(self) -> str:
        return self.active

    def activations(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(calibration=self.active, previous="cal-000001")]

    def check_open(self) -> None:
        if self.recorder.writer is None:
            raise ControlError("no session is open")

    def note(self, what: str) -> dict[str, Any]:
        self.done.append(what)
        return {}


def verify_or_undo(op: str, **named: str) -> dict[str, str]:
    return {"target": "P1", **named} if op == "verify" else named


@pytest.mark.parametrize("op", ["verify", "undo"])
@pytest.mark.parametrize(
    ("session", "active", "named", "of"),
    [
        ("one", "cal-000002", {}, "session"),
        ("one", "cal-000002", {"session": "one"}, "session"),
        ("", "cal-000002", {}, "calibration"),
        ("", "cal-000002", {"calibration": "cal-000002"}, "calibration"),
    ],
)
def test_what_is_meant_is_what_it_is_done_to(op, session, active, named, of):
    assert Cell(session, active).ask(op, **verify_or_undo(op, **named)) == f"{op} of {of}"


@pytest.mark.parametrize("op", ["verify", "undo"])
@pytest.mark.parametrize(
    ("session", "active", "named"),
    [
        ("one", "cal-000002", {"calibration": "cal-000002"}),  # somebody's session is open
        ("one", "", {"calibration": ""}),
        ("one", "cal-000002", {"session": "two"}),
        ("", "cal-000002", {"session": "one"}),  # it was ended meanwhile
        ("", "cal-000002", {"calibration": "cal-000001"}),
        ("", "", {"calibration": "cal-000001"}),
    ],
)
def test_what_is_not_so_any_more_is_refused_and_nothing_is_done(op, session, active, named):
    cell = Cell(session, active)
    with pytest.raises(StaleVersion, match="look again"):
        cell.ask(op, **verify_or_undo(op, **named))
    assert cell.done == []


@pytest.mark.parametrize("op", ["verify", "undo"])
def test_a_page_that_showed_no_session_means_no_calibration(op):
    cell = Cell("", "cal-000002")
    with pytest.raises(ControlError, match="no session is open"):
        cell.ask(op, **verify_or_undo(op, session=""))
    assert cell.done == []


@pytest.mark.parametrize("named", [{}, {"active": "cal-000002"}])
def test_going_back_leaves_the_calibration_that_was_meant(named):
    assert Cell(active="cal-000002").ask("rollback", **named) == "cal-000001 in use"


def test_one_that_does_not_serve_can_be_left_as_it_is_told():
    cell = Cell(active="cal-000002")
    # Made for another cell, for example.
    cell.operations.serving = SimpleNamespace(calibration=None)  # type: ignore[assignment]
    assert cell.ask("rollback", active="") == "cal-000001 in use"


@pytest.mark.parametrize("left", ["", "cal-000001", "cal-000003"])
def test_going_back_from_one_that_is_not_in_use_is_refused(left):
    cell = Cell(active="cal-000002")
    with pytest.raises(StaleVersion, match="cal-000002 is in use by now"):
        cell.ask("rollback", active=left)
    assert cell.done == []
