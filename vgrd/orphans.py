"""No process outlives the one that started it, however that one ends (Linux: PDEATHSIG).

As a program, `orphans.py PARENT PROGRAM ARGUMENT...` becomes PROGRAM and dies with PARENT.
"""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
_libc = ctypes.CDLL(None)


def die_with(parent: int) -> None:
    """End this process by SIGKILL when its parent, pid `parent`, ends, or now if that has happened.

    It holds across exec, and neither a handler of SIGTERM nor the GIL is in its way. The death of
    the very thread that started this process counts.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def dying_with_us(argv: Sequence[str]) -> list[str]:
    """Command that becomes `argv` under the same process id and ends with this process.

    For parents with threads, where code between fork and exec (`preexec_fn`) may deadlock; costs the
    start of a bare interpreter. RuntimeError off the main thread, whose end alone would end it.
    """
    if threading.current_thread() is not threading.main_thread():
        raise RuntimeError(f"{argv[0]} would die with this thread: start it from the main thread")
    return [sys.executable, "-I", "-S", __file__, str(os.getpid()), *argv]


if __name__ == "__main__":
    die_with(int(sys.argv[1]))
    os.execvp(sys.argv[2], sys.argv[2:])  # noqa: S606
