"""What a benchmark module uses: a row of the table, and a fair comparison of two things."""

import math
import signal
import statistics
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Literal, Self


@dataclass(frozen=True)
class Row:
    """One figure and the bar it has to clear; times are ratios measured side by side in one run.

    note: the absolute figures behind it, for the printed table only. failure: why there is no figure.
    """

    name: str
    value: float
    unit: str
    bar: float
    ok: bool
    relation: Literal[">=", "<=", ""]
    note: str = ""
    failure: str = ""
    skip: str = ""

    @classmethod
    def at_least(cls, name: str, value: float, unit: str, bar: float, note: str = "") -> Self:
        """More is better."""
        return cls(name, value, unit, bar, value >= bar, ">=", note)

    @classmethod
    def at_most(cls, name: str, value: float, unit: str, bar: float, note: str = "") -> Self:
        """Less is better."""
        return cls(name, value, unit, bar, value <= bar, "<=", note)

    @classmethod
    def failed(cls, name: str, failure: str) -> Self:
        """A figure, or all figures of a module, that could not be measured."""
        return cls(name, math.nan, "", math.nan, ok=False, relation="", failure=failure)

    @classmethod
    def skipped(cls, name: str, skip: str) -> Self:
        """A figure that needs something that is not on this machine."""
        return cls(name, math.nan, "", math.nan, ok=True, relation="", skip=skip)

    def as_json(self) -> dict[str, object]:
        """Entry of build/bench.json; one that failed or was skipped has no value and says why."""
        if self.skip:
            return {"name": self.name, "value": None, "ok": True, "skip": self.skip}
        if self.failure:
            return {"name": self.name, "value": None, "ok": False, "failure": self.failure}
        return {
            "name": self.name,
            "value": round(self.value, 6),
            "unit": self.unit,
            "bar": self.bar,
            "ok": self.ok,
        }

    def as_message(self) -> dict[str, object]:
        """All fields; `Row(**message)` takes them back."""
        return asdict(self) | {
            "value": float(self.value),
            "bar": float(self.bar),
            "ok": bool(self.ok),
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


def ending(code: int) -> str:
    """An exit code in words."""
    return f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
