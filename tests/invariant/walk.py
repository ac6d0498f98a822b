"""A long random walk over the rules: millions of reads, in one simulated cell after the other."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.invariant.rig import Rig, silence
from tests.invariant.rules.catalogue import RULES
from tests.invariant.simulation.teaching import VARIANTS, Variant

WAIT_S = 0.9  # the longest pause between two rules
REMEMBERED = 25  # rules that a failure names, the last ones
_OF_ALL = (
    "reads",
    "reads of one register",
    "reads of lines",
    "sets of registers",
    "valid",
    "valid lines",
)


@dataclass(slots=True)
class Walk:
    """What a walk read. worst: the largest miss of a right read, in u95; simulated_s: that the cell was awake."""

    variant: Variant
    seed: int
    counts: Counter[str] = field(default_factory=Counter)
    worst: float = 0.0
    simulated_s: float = 0.0

    def add(self, other: "Walk") -> None:
        """Sum up."""
        self.counts.update(other.counts)
        self.worst = max(self.worst, other.worst)
        self.simulated_s += other.simulated_s

    def summary(self) -> str:
        """Several lines."""
        counts = self.counts
        kinds = sorted((name, n) for name, n in counts.items() if name not in _OF_ALL)
        return "\n".join(
            [
                f"{counts['reads']:,} reads in {self.simulated_s / 3600:.2f} h of the cell, of these "
                f"{counts['reads of one register']:,} of single registers "
                f"({counts['sets of registers']:,} sets that were the same before and after) and "
                f"{counts['reads of lines']:,} of lines ({counts['valid lines']:,} of them valid)",
                f"{counts['valid']:,} valid; worst right one at {self.worst:.2f} u95 (limit 3)",
                *(f"  {count:>9,} {name}" for name, count in kinds),
            ]
        )


def walked(
    variant: Variant,
    seed: int,
    reads: int,
    *,
    read_s: float = 0.004,
    at_least_s: float = 0.0,
    on_step: Callable[[Rig], None] = lambda _: None,
    on_end: Callable[[Rig], None] = lambda _: None,
) -> Walk:
    """Let things happen until so many reads were made, and so much of the cell's time has passed.

    Raises Lie, with what happened before in its notes.
    """
    rng = np.random.default_rng((seed, VARIANTS.index(variant)))
    walk, trace = Walk(variant, seed), list[str]()
    with (
        silence(),
        TemporaryDirectory() as folder,
        Rig(Path(folder), variant, seed, read_s) as rig,
    ):
        walk.counts = rig.judge.counts
        try:
            while walk.counts["reads"] < reads or rig.awake_s < at_least_s:
                _step(rig, rng, trace)
                on_step(rig)
            on_end(rig)
        except BaseException as err:
            lines = [f"{variant}, seed {seed}", *trace]
            err.add_note("\n".join(lines))
            raise
        walk.worst, walk.simulated_s = rig.judge.worst, rig.awake_s
    return walk


def _step(rig: Rig, rng: np.random.Generator, trace: list[str]) -> None:
    names = list(RULES)
    weights = np.array([RULES[name].weight for name in names])
    name = names[int(rng.choice(len(names), p=weights / weights.sum()))]
    arguments = {key: draw.draw(rng) for key, draw in RULES[name].draws.items()}
    trace.append(f"{rig.clock.now_s:.3f} {name} {arguments}")
    del trace[:-REMEMBERED]
    RULES[name].act(rig, **arguments)
    rig.wait(float(rng.uniform(0, 1) ** 2 * WAIT_S))
