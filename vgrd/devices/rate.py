"""How often the robot tells where it is, from the stamps of its readings; what follows from it.

The daemon takes robots of 5 to 500 readings a second, and need not be told which.
"""

from collections.abc import Iterable, Sequence
from itertools import islice, pairwise

from vgrd.devices import SLOWEST_ROBOT_HZ, FlangeReading

SAME_TIME_S = 0.001  # half of the shortest period (500 Hz): closer ones are repeated
LONGEST_PERIOD_S = 1.75 / SLOWEST_ROBOT_HZ  # a quarter of its readings lost, the others irregular
COUNTED = 33  # newest readings that tell the rate: 32 steps, of which a quarter may be disturbed
SILENCE_S = 0.2  # of a fast robot: with 60 ms for loops and rings "lost" is told within 260 ms
SILENT_PERIODS = 2.0  # one reading may be lost ...
LATE_S = 0.1  # ... and the next be late by the stamps' uncertainty and a busy machine
CATCH_UP_PERIODS = 4.0  # two readings lost, the third late and unsure by half a period


def distinct(stamps: Iterable[float]) -> list[float]:
    """Stamps in ascending order, of which those that repeat an earlier one are left out."""
    result: list[float] = []
    for stamp in sorted(stamps):
        if not result or stamp - result[-1] >= SAME_TIME_S:
            result.append(stamp)
    return result


def reading_period_s(readings: Sequence[FlangeReading]) -> float:
    """Time between the newest readings, s: the mean of the shorter three quarters of the steps.

    Lost and late readings hardly change it, repeated ones do not. While there are too few to tell
    it is the longest that is allowed.
    """
    measured_s = _measured_period_s(readings)
    return LONGEST_PERIOD_S if measured_s is None else measured_s


def silence_limit_s(readings: Sequence[FlangeReading]) -> float:
    """After how long without a reading the robot counts as lost, s.

    0.2 at 20 Hz and above, and while there are too few readings to tell that the robot is slower.
    """
    measured_s = _measured_period_s(readings)
    if measured_s is None:
        return SILENCE_S
    return max(SILENCE_S, SILENT_PERIODS * min(measured_s, LONGEST_PERIOD_S) + LATE_S)


def catch_up_s(readings: Sequence[FlangeReading]) -> float:
    """How long to wait for a reading from after a picture, s."""
    if not readings:
        return SILENCE_S
    period_s = min(reading_period_s(readings), LONGEST_PERIOD_S)
    return max(SILENCE_S, CATCH_UP_PERIODS * period_s)


def _measured_period_s(readings: Sequence[FlangeReading]) -> float | None:
    """Mean of the shorter three quarters of the newest steps; None while there are fewer than two."""
    newest = islice(reversed(readings), COUNTED)
    steps = sorted(b - a for a, b in pairwise(distinct(r.stamp_s for r in newest)))
    usual_steps = steps[: len(steps) * 3 // 4]  # lost and late readings lengthen the others
    return sum(usual_steps) / len(usual_steps) if usual_steps else None
