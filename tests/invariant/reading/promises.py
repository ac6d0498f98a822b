"""What docs/registers.md promises of times: how long after a fault nothing is valid any more."""

import math
from dataclasses import dataclass

LOST_S = 0.26  # a process of the daemon died or stopped


@dataclass(frozen=True, slots=True)
class _Promise:
    words: str
    from_s: float
    until_s: float


class Promises:
    """Those that hold now, by name; kept when their cause is gone."""

    def __init__(self) -> None:
        self._made: dict[str, _Promise] = {}

    def made(
        self, name: str, words: str, now_s: float, within_s: float, until_s: float = math.inf
    ) -> None:
        """Nothing is valid from `within_s` on, until `until_s` or until it is kept; the first one counts."""
        if name in self._made and now_s < self._made[name].until_s:
            return
        self._made[name] = _Promise(words, now_s + within_s, until_s)

    def kept(self, name: str) -> None:
        """Its cause is gone."""
        self._made.pop(name, None)

    def broken(self, now_s: float) -> str:
        """What a valid read breaks now; empty when nothing."""
        for promise in self._made.values():
            if promise.from_s < now_s < promise.until_s:
                return f"{promise.words}, {now_s - promise.from_s:.3f} s beyond the limit"
        return ""
