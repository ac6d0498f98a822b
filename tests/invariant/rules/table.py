"""What may happen to a cell: a table of rules, each with the faults of the lists that it stands for.

F: cases of the reliability study, S, T and R: faults found in the code, C: attacks on the running daemon;
docs/invariant.md lists them. One table serves the state machine, which searches and shrinks, and the walk, which
reads millions of times.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from tests.invariant.rig import Rig


@dataclass(frozen=True, slots=True)
class Among:
    """One of these."""

    values: Sequence[Any]

    def strategy(self) -> st.SearchStrategy[Any]:
        return st.sampled_from(self.values)

    def draw(self, rng: np.random.Generator) -> Any:
        return self.values[int(rng.integers(len(self.values)))]


@dataclass(frozen=True, slots=True)
class Between:
    """A number of this range."""

    low: float
    high: float

    def strategy(self) -> st.SearchStrategy[Any]:
        return st.floats(self.low, self.high)

    def draw(self, rng: np.random.Generator) -> Any:
        return float(rng.uniform(self.low, self.high))


@dataclass(frozen=True, slots=True)
class Rule:
    """act: on a rig, with arguments drawn from `draws`. weight: how often the walk takes it."""

    act: Callable[..., None]
    faults: str
    weight: float
    draws: Mapping[str, Among | Between]

    def walk(self, rig: Rig, rng: np.random.Generator) -> None:
        """Let it happen, arguments drawn at random."""
        self.act(rig, **{name: draw.draw(rng) for name, draw in self.draws.items()})


RULES: dict[str, Rule] = {}
SEEDS = Among(range(1000))


def rule(
    faults: str = "", *, weight: float = 1.0, **draws: Among | Between
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Enter a function into the table, by its name."""

    def enter(act: Callable[..., None]) -> Callable[..., None]:
        RULES[act.__name__] = Rule(act, faults, weight, draws)
        return act

    return enter
