"""Lines typed at a running fake: `freeze on`, `drop rst`, ...; each is answered by one line.

Actions are known by how they are typed, `turn DEGREES`: the first word chooses, the others are given to it.
"""

import asyncio
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence

Action = Callable[[Sequence[str]], None]


def switch(words: Sequence[str]) -> bool:
    """Read `on` or `off`; ValueError on anything else."""
    if list(words) not in (["on"], ["off"]):
        raise ValueError("expected on or off")
    return words[0] == "on"


def numbers(words: Sequence[str], count: int) -> list[float]:
    """Read `count` numbers; ValueError on anything else."""
    if len(words) != count:
        raise ValueError(f"expected {count} number(s)")
    return [float(word) for word in words]


def word(words: Sequence[str], *choices: str) -> str:
    """Read one of `choices`; ValueError on anything else."""
    if len(words) != 1 or words[0] not in choices:
        raise ValueError(f"expected one of {', '.join(choices)}")
    return words[0]


async def until_stopped(ready: str, actions: Mapping[str, Action]) -> None:
    """Print `ready`, obey lines of standard input; return at Ctrl-C, SIGTERM or a closed terminal."""
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stop.set)

    def read_lines() -> None:
        for line in sys.stdin:
            if line.split():
                loop.call_soon_threadsafe(_obey, line.split(), actions)

    threading.Thread(target=read_lines, daemon=True).start()
    print(ready, flush=True)
    await stop.wait()


def what_can_be_typed(actions: Mapping[str, Action]) -> str:
    """All lines, as the user types them."""
    return ", ".join(sorted([*actions, "help"]))


def _obey(words: Sequence[str], actions: Mapping[str, Action]) -> None:
    action = {usage.split()[0]: action for usage, action in actions.items()}.get(words[0])
    if action is None:
        unknown = "" if words[0] == "help" else f"unknown: {words[0]}; "
        print(f"{unknown}known: {what_can_be_typed(actions)}", flush=True)
        return
    try:
        action(words[1:])
    except ValueError as error:
        print(f"bad {words[0]}: {error}", flush=True)
    else:
        print(f"ok {' '.join(words)}", flush=True)
