"""What a study is made of: cases, trials with their own random numbers, figures with bars."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import SeedSequence

from vgrd.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Parameters = Mapping[str, Any]
Row = dict[str, Any]
REFUSED = "refused"


class Trials:
    """Rows of all trials, in the order of cases and runs, whoever computed them.

    A row holds the parameters of its case, `run`, what the trial measured, and `refused`: 1.0 for
    a trial whose data the method refused, which then has measured nothing.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        self.rows = tuple(rows)

    def values(self, column: str, **case: object) -> Array:
        """Measured values (n,) of the trials of the cases given; refused trials are left out."""
        chosen = [row for row in self.select(**case) if not row[REFUSED]]
        return np.array([row[column] for row in chosen], dtype=np.float64)

    def mean(self, column: str, **case: object) -> float:
        """Mean of those values; NaN without any."""
        values = self.values(column, **case)
        return float(values.mean()) if values.size else float("nan")

    def finite_mean(self, column: str, **case: object) -> float:
        """Mean of those that are finite; NaN without any. A trial that has no answer measures NaN."""
        values = self.values(column, **case)
        known = values[np.isfinite(values)]
        return float(known.mean()) if known.size else float("nan")

    def select(self, **case: object) -> list[Row]:
        """Rows of the cases given, refused ones included."""
        return [row for row in self.rows if all(row[key] == value for key, value in case.items())]

    def distinct(self, column: str) -> list[Any]:
        """Values of a parameter, in the order of the cases."""
        return list(dict.fromkeys(row[column] for row in self.rows))


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of a study; at_least, at_most: its bar; paper: what was published, in words.

    interval: where 95 % of experiments with as few repetitions as the paper's lie; published: the paper's
    statement as (low, high).
    """

    name: str
    value: float
    unit: str = ""
    at_least: float | None = None
    at_most: float | None = None
    paper: str = ""
    interval: tuple[float, float] | None = None
    published: tuple[float, float] | None = None

    @property
    def ok(self) -> bool | None:
        """Whether the bar is cleared; None without a bar. NaN clears none."""
        if self.at_least is None and self.at_most is None:
            return None
        low = -np.inf if self.at_least is None else self.at_least
        high = np.inf if self.at_most is None else self.at_most
        return bool(low <= self.value <= high)

    @property
    def paper_inside(self) -> bool | None:
        """Whether chance explains what the paper states; None where it is not known."""
        if self.interval is None or self.published is None or np.isnan(self.interval).any():
            return None
        return bool(
            self.published[0] <= self.interval[1] and self.interval[0] <= self.published[1]
        )

    @property
    def bar(self) -> str:
        """The bar in words."""
        if self.at_least is not None and self.at_most is not None:
            return f"{self.at_least:g} .. {self.at_most:g}"
        if self.at_least is not None:
            return f">= {self.at_least:g}"
        return "" if self.at_most is None else f"<= {self.at_most:g}"

    def as_json(self) -> dict[str, object]:
        """Entry of the JSON file; a value that is not finite becomes null."""
        return {
            "name": self.name,
            "value": float(self.value) if np.isfinite(self.value) else None,
            "unit": self.unit,
            "bar": self.bar,
            "at_least": self.at_least,
            "at_most": self.at_most,
            "ok": self.ok,
            "paper": self.paper,
            "interval": None if self.paper_inside is None else list(self.interval or ()),
            "paper_inside": self.paper_inside,
        }


@dataclass(frozen=True, slots=True)
class Study:
    """A simulation or experiment.

    trial(seed, parameters) is pure: all that is random comes from the seed. Each of `cases` is
    run `runs` times (`full_runs` with --full). figures and draw see all trials. most_refused: share of
    the trials whose data the method may refuse.
    """

    name: str
    title: str
    cases: tuple[Parameters, ...]
    runs: int
    trial: Callable[[SeedSequence, Parameters], Mapping[str, float | str]]
    figures: Callable[[Trials], list[Figure]]
    draw: Callable[[Trials], "Drawing"]
    full_runs: int | None = None
    most_refused: float = 1e-3  # chance; studies in which a lack of data is drawn say more
