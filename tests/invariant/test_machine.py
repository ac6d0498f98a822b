"""The invariant as a state machine: whatever happens, in whatever order, no robot reads a lie.

What it found is pinned by name in the tests of the rooms; docs/invariant.md says where.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from tests.invariant.rig import Rig, silence
from tests.invariant.rules.catalogue import RULES
from tests.invariant.rules.table import Rule
from tests.invariant.simulation.teaching import VARIANTS, Variant

MOMENT_S = 0.03  # between two rules at least


class LyingCell(RuleBasedStateMachine):
    """A cell to which the rules of the table happen; a valid read that is wrong fails."""

    def __init__(self) -> None:
        super().__init__()
        self.silence = silence()
        self.silence.__enter__()
        self.folder = TemporaryDirectory()
        self.rig: Rig | None = None

    @initialize(variant=st.sampled_from(VARIANTS), seed=st.integers(0, 9))
    def taught(self, variant: Variant, seed: int) -> None:
        self.rig = Rig(Path(self.folder.name), variant, seed)

    @rule(seconds=st.floats(0.0, 2.0))
    def time_passes(self, seconds: float) -> None:
        self.rig.wait(seconds)

    def teardown(self) -> None:
        if self.rig is not None:
            self.rig.__exit__()
        self.folder.cleanup()
        self.silence.__exit__(None, None, None)


def _as_rule(entry: Rule) -> Callable[..., None]:
    def happen(self: LyingCell, **arguments: Any) -> None:
        entry.act(self.rig, **arguments)
        self.rig.wait(MOMENT_S)

    happen.__name__ = entry.act.__name__
    return rule(**{name: draw.strategy() for name, draw in entry.draws.items()})(happen)


for name, entry in RULES.items():
    setattr(LyingCell, name, _as_rule(entry))

TestLyingCell = LyingCell.TestCase
TestLyingCell.settings = settings(
    max_examples=30,
    stateful_step_count=30,
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
