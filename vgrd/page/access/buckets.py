"""How often somebody may do something: a token bucket for each."""

from collections import OrderedDict

from vgrd.clock import Clock

_MOST_KEYS = 4096  # remembered; who is forgotten starts anew with a full bucket


class Buckets:
    """Full at first; filled by `rate_hz` up to `most`."""

    def __init__(self, clock: Clock, rate_hz: float, most: float) -> None:
        self._clock, self._rate_hz, self._most = clock, rate_hz, most
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, as of when

    def take(self, key: str, cost: float = 1.0) -> bool:
        """Take `cost` tokens of a key's bucket, False where there are too few."""
        left = self._level(key)
        if left < cost:
            return False
        self._put(key, left - cost)
        return True

    def wait_s(self, key: str) -> float:
        """Until there is a token."""
        return max(0.0, (1.0 - self._level(key)) / self._rate_hz)

    def give_back(self, key: str) -> None:
        """A token that was taken in vain."""
        self._put(key, min(self._most, self._level(key) + 1.0))

    def _level(self, key: str) -> float:
        now_s = self._clock.monotonic()
        left, since_s = self._left.get(key, (self._most, now_s))
        return min(self._most, left + (now_s - since_s) * self._rate_hz)

    def _put(self, key: str, level: float) -> None:
        self._left[key] = (level, self._clock.monotonic())
        self._left.move_to_end(key)
        if len(self._left) > _MOST_KEYS:
            self._left.popitem(last=False)
