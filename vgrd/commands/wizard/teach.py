"""The command that teaches in a terminal; what it knows is the daemon's, so it may be left at any time."""

import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.asking import (
    SAMPLE_TIMEOUT_S,
    SOLVE_TIMEOUT_S,
    ConfigOption,
    SocketOption,
    client_of,
)
from vgrd.commands.wizard.steering import KEYS, LEAVE, State, calls_of, key_of
from vgrd.commands.wizard.words import details, headline, line_of
from vgrd.errors import ControlError, DaemonUnreachable, InputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from vgrd.ipc.control import ControlClient

_LOOK_S = (
    0.5  # between two looks at the daemon: NO LINK within a second, with the wait for a reply
)
_LINK_S = 0.5  # a living daemon tells the state in some 20 ms
_COMPUTING_S = 60.0  # as long as the daemon lets an advice take


def register(app: typer.Typer) -> None:
    """Add teach."""
    app.command()(teach)


def teach(
    plan: Annotated[str, typer.Option(help="Of a session that is started here.")] = "joint",
    plain: Annotated[
        bool,
        typer.Option(
            "--plain", help="A line per state, a line of input per key; so without a terminal."
        ),
    ] = False,
    config: ConfigOption = None,
    socket: SocketOption = None,
) -> None:
    """Teach step by step: it tells the next step, one key does it; leave and come back as you like."""
    client = client_of(config, socket)
    if plain or not (sys.stdin.isatty() and sys.stdout.isatty()):
        _by_lines(client, plan)
    else:
        _by_keys(client, plan)


def _by_lines(client: "ControlClient", plan: str) -> None:
    """Drive it by lines of standard input, until q or their end."""
    while True:
        state = _settled(client)
        typer.echo(line_of(state))
        typed = sys.stdin.readline()
        key = key_of(typed.strip())
        if not typed or key == LEAVE:
            return
        for told in _done(client, key, state, plan):
            typer.echo(" ".join(told.split()))


def _settled(client: "ControlClient") -> State:
    """The state, once the daemon has computed the next step or has had its time for it."""
    end_s = time.monotonic() + _COMPUTING_S
    while True:
        state = client.call("teaching", timeout_s=SAMPLE_TIMEOUT_S)
        is_open = state["session"] is not None
        if not (is_open and state["computing"]) or time.monotonic() > end_s:
            return state
        time.sleep(_LOOK_S)


def _done(client: "ControlClient", key: str, state: State, plan: str) -> Iterator[str]:
    """Do what the key asks for; tells what was done, or why not. Only a daemon that is gone raises."""
    version = state["version"]
    try:
        for call in calls_of(key, state, plan):
            seen = {"version": version} if call.guarded else {}
            timeout_s = SOLVE_TIMEOUT_S if call.op == "solve" else SAMPLE_TIMEOUT_S
            reply = client.call(call.op, timeout_s=timeout_s, **call.arguments, **seen)
            version = reply.get("version", version)
            yield f"done: {call.op} {_told(reply)}".rstrip()
    except DaemonUnreachable:
        raise
    except (ControlError, InputError) as refusal:
        yield f"not done: {refusal}"


def _told(reply: State) -> str:
    """What of a reply a person wants to read."""
    keys = ("good", "limits", "remark", "warning", "calibration")
    return "; ".join(str(reply[key]) for key in keys if reply.get(key))


def _by_keys(client: "ControlClient", plan: str) -> None:
    """Show the state live and obey single keys; none is obeyed while the daemon does not answer."""
    from rich.live import Live

    from vgrd.commands.wizard.keyboard import forget_typed, single_keys

    told, shown = "", None
    with single_keys() as next_key, Live(screen=True, auto_refresh=False) as live:
        while True:
            try:
                state: State | None = client.call("teaching", timeout_s=_LINK_S)
            except DaemonUnreachable:
                state = None
            asked = None if state is None else (state["version"], state["step"])
            if asked != shown:
                forget_typed()  # a key answers what was shown when it was pressed
                shown = asked
            live.update(_screen(state, told), refresh=True)
            typed = next_key(_LOOK_S)
            if typed is None:
                continue
            if (key := key_of(typed)) == LEAVE:
                return
            if state is None:
                continue
            live.update(_screen(state, "doing it ..."), refresh=True)
            try:
                told = "\n".join(_done(client, key, state, plan))
            except DaemonUnreachable as gone:
                told = f"perhaps not done, look at the samples: {gone}"
            forget_typed()


def _screen(state: State | None, told: str) -> "RenderableType":
    from rich.text import Text

    if state is None:
        return Text(
            f"NO LINK: the daemon does not answer; keys are off, q leaves\n\n{told}", "bold"
        )
    text = Text(f"{headline(state)}\n\n", "bold blue")  # blue: it is the operator's turn
    text.append("\n".join(details(state)), "not bold default")
    text.append(f"\n\n{told}\n\n{KEYS}", "not bold default")
    return text
