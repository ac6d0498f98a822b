"""Lines beside the registers in simulated time; and line servers that lie, which the machine must find."""

from dataclasses import replace

import pytest

from tests.invariant.reading.judge import Lie
from tests.invariant.reading.robots import Asked
from tests.invariant.rig import Rig, silence
from tests.invariant.simulation.teaching import VARIANTS, Variant
from vgrd.gate.register_bank import RegisterBank
from vgrd.registers import Answer, Command

HONEST = RegisterBank.answer_to
FORMATS = (0x00, 0x02, 0x12, 0x20, 0x30)


@pytest.mark.parametrize("variant", VARIANTS[::6], ids=str)
def test_a_line_is_answered_as_the_registers_are_in_every_format(tmp_path, variant):
    with silence(), Rig(tmp_path, variant, seed=1) as rig:
        for options in FORMATS:
            rig.ask_by_line(0, Asked(0, Command.EC_FRESH, 3, options))
            rig.wait(1.5)
    counts = rig.judge.counts
    assert counts["valid lines"] > 30 * len(FORMATS)
    assert counts["valid"] == counts["right"]


def two_ask_and_the_table_turns(rig: Rig) -> None:
    for client in (0, 1):
        rig.ask_by_line(client, Asked(0, Command.EC_FRESH, 3 + client))
        rig.wait(1.5)
    now = rig.clock.now_s
    rig.plant.jerk(rig.plant.placements[-1].angle(now) + 0.3, now)
    rig.wait(2.0)


def tells_everybody(bank: RegisterBank, nonce: int) -> Answer:
    """The answer in force, whoever asked for it."""
    del nonce
    bank.refresh()
    return bank._view.answer


def keeps_the_last_good(bank: RegisterBank, nonce: int) -> Answer:
    """The last valid answer, for as long as nothing else is asked."""
    answer = HONEST(bank, nonce)
    kept = getattr(bank, "kept", {})
    if answer.status.is_ok:
        bank.kept = {nonce: answer}
    return kept.get(nonce, answer)


def tells_a_millimetre_more(bank: RegisterBank, nonce: int) -> Answer:
    answer = HONEST(bank, nonce)
    x, y, z = answer.position_um
    return replace(answer, position_um=(x + 1000, y, z))


@pytest.mark.parametrize(
    "lying",
    [tells_everybody, keeps_the_last_good, tells_a_millimetre_more],
    ids=lambda f: f.__name__,
)
def test_a_line_server_that_lies_is_found(tmp_path, monkeypatch, lying):
    monkeypatch.setattr(RegisterBank, "answer_to", lying)
    with (
        silence(),
        Rig(tmp_path, Variant(), seed=1) as rig,
        pytest.raises(Lie, match="line"),
    ):
        two_ask_and_the_table_turns(rig)
