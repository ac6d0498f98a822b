"""Which flange readings a recording keeps: all of a moving arm and around pictures, few of one at rest.

An arm that stands still for a day at 125 Hz would fill 10 GB with one pose. A reading is left out when
it lies within the limits of rest around the reading recorded before it, comes at most `REST_S` after
that one, and is farther than `AROUND_S` from every picture and sample. So rest is judged from the
replay as it was judged live.
"""

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from vgrd.devices import FlangeReading
from vgrd.devices.stillness import RestLimits, is_apart
from vgrd.geometry import Pose

REST_S = 1.0  # one reading a second says that the arm still stands and the robot still answers
AWAKE_S = 1.0  # an arm that came to rest settles within this
AROUND_S = 1.0  # the longest window in which rest is judged: three readings of the slowest robot
HOLD_S = 4.0  # a picture is told at most this late: evaluation 2 s, catching up 1.4 s


class PoseThinning:
    """Takes readings in their order and returns, in order, those to be recorded.

    Readings of an arm at rest are returned `HOLD_S` later, since a picture of them may still come.
    Readings of a moving arm, and those around pictures and samples, are returned at once.
    """

    def __init__(self, limits: RestLimits | None = None) -> None:
        self._limits = limits or RestLimits()
        self._held: deque[FlangeReading] = deque()
        self._last: FlangeReading | None = None
        self._strays = 0
        self._awake_until_s = -np.inf
        self._wanted_spans: deque[tuple[float, float]] = deque()

    def add(self, readings: Iterable[FlangeReading]) -> list[FlangeReading]:
        """What is to be recorded now, of these and earlier readings."""
        due: list[FlangeReading] = []
        for reading in readings:
            self._held.append(reading)
            self._strays = self._strays + 1 if self._is_news(reading) else 0
            # A stray reading is noise, two in a row are a move.
            if self._strays > 1 or self._last is None:
                self._awake_until_s = reading.stamp_s + AWAKE_S
            due += self._due(reading.stamp_s)
        return due

    def want(self, begin_s: float, end_s: float) -> None:
        """Keep every reading between two stamps: of a picture or sample, and `AROUND_S` around it.

        What has come of them is given back with the next reading, so that a kill costs none of them.
        """
        self._wanted_spans.append((begin_s - AROUND_S, end_s + AROUND_S))
        self._awake_until_s = max(self._awake_until_s, end_s + AROUND_S)

    def rest(self) -> list[FlangeReading]:
        """Everything that is still held back, at the end of a recording."""
        held = list(self._held)
        self._held.clear()
        return held

    def _due(self, now_s: float) -> Sequence[FlangeReading]:
        if now_s <= self._awake_until_s:
            due = self.rest()
            self._last = due[-1]
            return due
        due = []
        while self._held[0].stamp_s < now_s - HOLD_S:
            reading = self._held.popleft()
            if self._is_needed(reading):
                due.append(reading)
                self._last = reading
        while self._wanted_spans and self._wanted_spans[0][1] < now_s - HOLD_S:
            self._wanted_spans.popleft()
        return due

    def _is_needed(self, reading: FlangeReading) -> bool:
        is_due = self._last is None or reading.stamp_s - self._last.stamp_s >= REST_S
        is_wanted = any(begin <= reading.stamp_s <= end for begin, end in self._wanted_spans)
        return is_due or is_wanted or self._is_news(reading)

    def _is_news(self, reading: FlangeReading) -> bool:
        """Whether a reading tells something else than the one recorded last."""
        last = self._last
        if last is None:
            return True
        same_state = (reading.running, reading.digital_inputs) == (
            last.running,
            last.digital_inputs,
        )
        return not same_state or self._has_moved(last, reading)

    def _has_moved(self, old: FlangeReading, new: FlangeReading) -> bool:
        most_mm, most_rad = self._limits.of(new)
        pairs: list[tuple[Pose | None, Pose | None]] = [
            (old.base_from_wrist, new.base_from_wrist),
            (old.wrist_from_tcp, new.wrist_from_tcp),
        ]
        for before, after in pairs:
            if before is None or after is None:
                if before is not after:
                    return True
            elif before is not after and is_apart(before, after, most_mm, most_rad):
                return True
        return False
