"""Evidence that the machine has more to do than it can: without it no test blames a figure of time on the load."""

import os
import threading
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

TICK_S = 0.005  # a twentieth of BUSY_LATE_S; 200 looks a second are no load themselves
KEPT = 20_000  # of the moments when this process came late; an hour of a bad machine
BUSY_LATE_S = 0.1  # a process that only wants to wake up waits less than 20 ms on a machine with time to spare
BUSY_SHARE = 0.6  # the fake cell and its daemon by themselves make tasks wait for a processor 10 to 40 % of the time
EXPLAINS = (
    0.2  # of a delay: a chain of processes that hand over to each other waits about five times
)
_PRESSURE = Path("/proc/pressure/cpu")


class Moment(NamedTuple):
    """Where a span begins: now (monotonic), and for how long tasks have waited for a processor so far."""

    at_s: float
    waited_s: float


class Load:
    """Watches the scheduler from `with` to its end."""

    def __init__(self) -> None:
        self._late: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="load", daemon=True)

    def __enter__(self) -> "Load":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def now(self) -> Moment:
        """Begin a span."""
        return Moment(time.monotonic(), _waited_s())

    def evidence(self, start: Moment, missing_s: float = 0.0) -> str:
        """How busy the machine was since then, in words; empty when it had time to spare.

        missing_s: what the load would have to explain; a small delay explains no large one.
        """
        late_s = max((late for at_s, late in list(self._late) if at_s >= start.at_s), default=0.0)
        span_s = max(time.monotonic() - start.at_s, TICK_S)
        share = (_waited_s() - start.waited_s) / span_s
        if late_s < max(BUSY_LATE_S, EXPLAINS * missing_s) and share < BUSY_SHARE:
            return ""
        return (
            f"this process woke up to {1e3 * late_s:.0f} ms late, "
            f"tasks waited for a processor {100 * min(share, 1.0):.0f} % of the time"
        )

    def _watch(self) -> None:
        last_s = time.monotonic()
        while not self._stop.wait(TICK_S):
            now_s = time.monotonic()
            if (late_s := now_s - last_s - TICK_S) > TICK_S:
                self._late.append((now_s, late_s))
            last_s = now_s


def _waited_s() -> float:
    """How long at least one task has waited for a processor so far, s; by the load where that is not told."""
    try:
        line = _PRESSURE.read_text(encoding="ascii").splitlines()[0]
    except OSError:
        tasks = os.getloadavg()[0] / (os.cpu_count() or 1)
        return time.monotonic() * min(max(tasks - 1.0, 0.0), 1.0)
    return int(line.rpartition("total=")[2]) * 1e-6
