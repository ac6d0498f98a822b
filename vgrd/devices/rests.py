"""When the arm came to rest: pictures of one rest share the error that the arm made as it stopped."""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable

from vgrd.devices import FlangeReading
from vgrd.devices.stillness import RestLimits, is_apart

SILENCE_S = 1.0  # chosen: nobody jogs an arm away and back in it
MEMORY = 4096  # rests: an arm that moves begins one with each reading, for 8 s at 500 Hz


class Rests:
    """Notes, from readings in the order they come, since when the arm stands.

    A silence in which the arm may have moved and come back ends a rest too.
    """

    def __init__(self, limits: RestLimits | None = None) -> None:
        self._limits = limits or RestLimits()
        self._since_s: deque[float] = deque(maxlen=MEMORY)
        self._first: FlangeReading | None = None  # of the rest
        self._last_s = 0.0

    def add(self, readings: Iterable[FlangeReading]) -> None:
        """Take readings that came."""
        for reading in readings:
            if self._first is None or self._begins(self._first, reading):
                self._first = reading
                self._since_s.append(reading.stamp_s)
            self._last_s = reading.stamp_s

    def since_s(self, stamp_s: float) -> float | None:
        """When the rest began in which the arm stood at `stamp_s`; None where no reading is so old."""
        ordered = sorted(self._since_s)  # a better mapping of the clocks can set a stamp back
        count = bisect_right(ordered, stamp_s)
        return ordered[count - 1] if count else None

    def _begins(self, first: FlangeReading, reading: FlangeReading) -> bool:
        if reading.stamp_s - self._last_s > SILENCE_S:
            return True
        return is_apart(first.base_from_wrist, reading.base_from_wrist, *self._limits.of(reading))
