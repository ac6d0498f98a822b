"""One request, one picture, one answer, read in simulated time: what the machine of the invariant is made of."""

import pytest

from tests.invariant.reading.robots import Asked
from tests.invariant.rig import Rig, silence
from tests.invariant.simulation.teaching import VARIANTS
from vgrd.registers import Command

REQUESTS = 40


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_a_request_is_answered_right_and_read_by_every_kind_of_reader(tmp_path, variant):
    with silence(), Rig(tmp_path, variant, seed=1) as rig:
        counts = rig.judge.counts
        for _ in range(REQUESTS):  # a reader of single registers is quick now and then
            rig.ask(0, Asked(0, Command.EC_FRESH, 3))
            rig.wait(2.0)
            if counts["sets of registers"]:
                break
    assert counts["valid"] == counts["right"] > 500
    assert counts["sets of registers"] > 0
