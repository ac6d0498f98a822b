"""Lines typed at a running fake: `freeze on`, `drop rst`, ...; each is answered by one line."""

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
    """Print `ready`, obey lines of standard input, return at Ctrl-C or SIGTERM."""
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)

    def read_lines() -> None:
        for line in sys.stdin:
            if line.split():
                loop.call_soon_threadsafe(_obey, line.split(), actions)

    threading.Thread(target=read_lines, daemon=True).start()
    print(ready, flush=True)
    await stop.wait()


def _obey(words: Sequence[str], actions: Mapping[str, Action]) -> None:
    action = actions.get(words[0])
    if action is None:
        print(f"unknown: {words[0]}; known: {', '.join(sorted(actions))}", flush=True)
        return
    try:
        action(words[1:])
    except ValueError as error:
        print(f"bad {words[0]}: {error}", flush=True)
    else:
        print(f"ok {' '.join(words)}", flush=True)
