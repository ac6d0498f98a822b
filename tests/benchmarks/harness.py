"""What a benchmark module uses: a row of the table, and a fair comparison of two things."""

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self


@dataclass(frozen=True)
class Row:
    """One figure and the bar it has to clear; times are ratios measured side by side in one run.

    note: the absolute figures behind it, for the printed table only.
    """

    name: str
    value: float
    unit: str
    bar: float
    ok: bool
    relation: Literal[">=", "<="]
    note: str = ""

    @classmethod
    def at_least(cls, name: str, value: float, unit: str, bar: float, note: str = "") -> Self:
        """More is better."""
        return cls(name, value, unit, bar, value >= bar, ">=", note)

    @classmethod
    def at_most(cls, name: str, value: float, unit: str, bar: float, note: str = "") -> Self:
        """Less is better."""
        return cls(name, value, unit, bar, value <= bar, "<=", note)

    def as_json(self) -> dict[str, object]:
        """Entry of build/bench.json."""
        return {
            "name": self.name,
            "value": round(self.value, 6),
            "unit": self.unit,
            "bar": self.bar,
            "ok": self.ok,
        }


def ratio_of(
    ours: Callable[[], float], peers: Callable[[], float], rounds: int
) -> tuple[float, float, float]:
    """Median of ours / peer's over alternating rounds, and both medians.

    Each call measures once and returns a figure. Alternating, and taking the ratio inside each
    round, keeps a machine that is busy for a while from favouring one of them.
    """
    ours(), peers()
    pairs = [(ours(), peers()) for _ in range(rounds)]
    ratio = statistics.median(a / b for a, b in pairs)
    return ratio, statistics.median(a for a, _ in pairs), statistics.median(b for _, b in pairs)
