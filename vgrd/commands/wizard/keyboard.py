"""Single keys of a terminal, without enter and without echo."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def single_keys() -> Iterator[Callable[[float], str | None]]:
    """Yields `key(wait_s)`: the next key of standard input, None without one; the terminal is put back."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)

    def key(wait_s: float) -> str | None:
        if not select.select([descriptor], [], [], wait_s)[0]:
            return None
        return os.read(descriptor, 1).decode("ascii", "replace") or "\x04"  # closed: as ctrl-d

    try:
        yield key
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def forget_typed() -> None:
    """Drop what was typed meanwhile: a key answers what is shown, not what was."""
    termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
