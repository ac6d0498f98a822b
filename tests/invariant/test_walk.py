"""A million reads of one long random walk through all variants of the cell: none of them is a lie."""

from collections import Counter

import pytest

from tests.invariant.simulation.teaching import VARIANTS
from tests.invariant.walk import walked

READS = 1_000_000
SEED = 2026
READ_S = 0.008  # so that twelve times some five minutes pass in the cell


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_no_read_of_a_twelfth_of_a_million_is_a_lie(variant, record_property) -> None:
    walk = walked(variant, SEED, READS // len(VARIANTS) + 1, read_s=READ_S)
    record_property("reads", walk.summary())
    assert walk.counts["reads"] > READS / len(VARIANTS)
    assert walk.counts["valid"] > 0.02 * walk.counts["reads"]
    assert walk.counts["sets of registers"] > 0
    assert walk.counts["valid lines"] > 0


def test_counts_add_up() -> None:
    walk = walked(VARIANTS[0], 1, 5000)
    kinds = Counter(walk.counts)
    for name in (
        "reads",
        "reads of one register",
        "reads of lines",
        "sets of registers",
        "valid lines",
    ):
        del kinds[name]
    assert kinds["valid"] == sum(count for name, count in kinds.items() if name != "valid")
