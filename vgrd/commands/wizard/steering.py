"""What a key asks of the daemon in a state of teaching. Pure: states are replies of `teaching`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from vgrd.errors import InputError

DO, UNDO, SOLVE, VERIFY, LEAVE = " ", "u", "s", "v", "q"
KEYS: Final = "enter = do the step, u = undo, s = solve, v = verify, q = leave"
_SAME_KEY: Final = {"\n": DO, "\r": DO, "": DO, "\x04": LEAVE}  # ctrl-d ends input everywhere

State = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Call:
    """An operation of the daemon with its arguments; guarded: it may name the version that was shown."""

    op: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    guarded: bool = True


def key_of(typed: str) -> str:
    """The key that was meant: enter is the space bar, letters count in either case."""
    return _SAME_KEY.get(typed, typed.lower())


def calls_of(key: str, state: State, plan: str) -> tuple[Call, ...]:
    """What a key asks for, in this order; raises InputError where it has no meaning in this state."""
    if key == DO:
        return _of_step(state, plan)
    if key == UNDO:
        return (_undo(state),)
    if key == VERIFY:
        return (Call("verify", {"target": _target_to_verify(state)}),)
    if key == SOLVE:
        return _solve(state)
    raise InputError(f"key {key!r} means nothing here: {KEYS}")


def _of_step(state: State, plan: str) -> tuple[Call, ...]:
    step = state["step"]
    kind = step["kind"]
    if kind in ("look", "spin"):
        return (Call(kind),)
    if kind in ("touch", "verify"):
        return (Call(kind, {"target": step["target"]}),)
    if kind == "point":
        return (Call(kind, {"name": step["target"]}),)
    if kind == "start":
        return (Call("record.start", {"plan": plan}),)
    if kind == "solve":
        return _solve(state)
    if kind == "activate":
        return (Call("activate", {"calibration": state["candidate"]["id"]}),)
    remedy = {
        "mend": "u takes the sample back, `vgrd retag` gives a touch another target",
        "wait": "the daemon is computing: wait",
        "done": "nothing is left to do; `vgrd record start` begins anew",
    }
    raise InputError(remedy.get(kind, f"this vgrd does not know the step {kind!r}: update it"))


def _undo(state: State) -> Call:
    """Of the sample that the step names, else of the last one that was asked for.

    Where something is to be mended and no single sample is named, the last one is rarely the wrong one.
    """
    number = state["step"].get("sample")
    if number is None and state["step"]["kind"] == "mend":
        raise InputError(
            "which one? `vgrd undo SAMPLE` or `vgrd retag SAMPLE TARGET`, as the step says"
        )
    return Call("undo", {} if number is None else {"sample": number})


def _target_to_verify(state: State) -> str:
    """The step's own, else the one whose predicted error is largest: it tells most."""
    step, targets = state["step"], state.get("targets")
    if step["kind"] == "verify":
        return str(step["target"])
    if not targets:
        raise InputError("no session is open, so nothing can be verified: enter starts one")
    return str(max(targets, key=lambda one: one["u95_mm"] or 0.0)["name"])


def _solve(state: State) -> tuple[Call, ...]:
    """End the open session and solve it, or solve the one that was taught last."""
    session = state["session"]
    name = state.get("last") if session is None else session["name"]
    if name is None:
        raise InputError("nothing is taught yet: enter starts a session")
    solve = Call("solve", {"session": name}, guarded=False)
    return (solve,) if session is None else (Call("record.stop"), solve)
