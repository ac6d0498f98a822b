"""Work that must not delay an answer gives way to what does not wait."""

import os
import threading
from typing import Final

import structlog

NICENESS: Final = 10  # about a tenth of the share of a thread at 0 that wants the same core

log = structlog.get_logger()


def give_way() -> None:
    """Lower the priority of the calling thread (Linux keeps niceness per thread).

    Where the service's filter refuses that, it is logged, and the thread runs on like the others.
    """
    thread = threading.get_native_id()
    try:
        niceness = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, max(niceness, NICENESS))
    except PermissionError as err:
        log.info("niceness_refused", reason=err.strerror)
