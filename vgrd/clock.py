"""Time, passed in: ages from the monotonic clock, wall time only for records."""

import time
from typing import Protocol


class Clock(Protocol):
    """What everything below the process layer takes instead of the `time` module."""

    def monotonic(self) -> float:
        """Seconds of CLOCK_MONOTONIC, shared by all processes of the machine."""
        ...

    def wall(self) -> float:
        """Unix time in seconds, for records only."""
        ...

    def sleep(self, seconds: float) -> None:
        """Block for `seconds`."""
        ...


class SystemClock:
    """The machine's clock."""

    def monotonic(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()

    def wall(self) -> float:
        """Unix time in seconds."""
        return time.time()

    def sleep(self, seconds: float) -> None:
        """Block for `seconds`."""
        time.sleep(seconds)
