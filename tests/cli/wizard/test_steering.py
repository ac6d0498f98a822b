"""What each key asks for in each state."""

from typing import Any

import pytest

from vgrd.commands.wizard.steering import Call, calls_of, key_of
from vgrd.errors import InputError


def state(kind: str, session: str | None = "one", **step: Any) -> dict[str, Any]:
    return {
        "session": None if session is None else {"name": session},
        "last": "one",
        "step": {"kind": kind, "target": "P1", "sample": None, **step},
        "targets": [{"name": "P1", "u95_mm": 0.3}, {"name": "P2", "u95_mm": 0.6}],
        "candidate": {"id": "cal-000002"},
    }


@pytest.mark.parametrize(
    ("key", "shown", "calls"),
    [
        (" ", state("spin"), [Call("spin")]),
        (" ", state("touch"), [Call("touch", {"target": "P1"})]),
        (" ", state("point", target="pivot"), [Call("point", {"name": "pivot"})]),
        (" ", state("start", None), [Call("record.start", {"plan": "special"})]),
        (" ", state("activate", None), [Call("activate", {"calibration": "cal-000002"})]),
        (" ", state("solve", None), [Call("solve", {"session": "one"}, guarded=False)]),
        (
            "s",
            state("touch"),
            [Call("record.stop"), Call("solve", {"session": "one"}, guarded=False)],
        ),
        ("u", state("touch"), [Call("undo")]),
        ("u", state("mend", sample=5), [Call("undo", {"sample": 5})]),
        ("v", state("verify"), [Call("verify", {"target": "P1"})]),
        ("v", state("touch"), [Call("verify", {"target": "P2"})]),  # known worst, tells most
    ],
)
def test_a_key_asks_for_what_the_state_says(key, shown, calls):
    assert list(calls_of(key, shown, "special")) == calls


@pytest.mark.parametrize(
    ("key", "shown"),
    [
        (" ", state("mend", sample=5)),
        ("u", state("mend", sample=None)),  # the last one is rarely the wrong one
        (" ", state("wait")),
        (" ", state("done", None)),
        (" ", state("a step of tomorrow")),
        ("x", state("touch")),
        ("v", {**state("start", None), "targets": []}),
        ("s", {**state("start", None), "last": None}),
    ],
)
def test_a_key_without_a_meaning_does_nothing_and_says_so(key, shown):
    with pytest.raises(InputError):
        calls_of(key, shown, "joint")


def test_enter_is_the_space_bar_and_letters_count_in_either_case():
    assert {key_of(typed) for typed in ("\n", "\r", " ", "")} == {" "}
    assert key_of("Q") == key_of("\x04") == "q"
