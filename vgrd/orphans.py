"""No process outlives the one that started it, however that one ends (Linux: PDEATHSIG)."""

import ctypes
import os
import signal
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
