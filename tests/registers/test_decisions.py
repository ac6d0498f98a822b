"""The table of decisions holds together, and its documentation is of today."""

from pathlib import Path

from vgrd.registers import Status
from vgrd.registers.decisions import DECISIONS, LIMITS, STATUS_REACTIONS, Reaction
from vgrd.registers.program_document import document


def test_words_and_numbers_name_one_row_each():
    assert [row.number for row in DECISIONS] == list(range(1, len(DECISIONS) + 1))
    assert len({row.word for row in DECISIONS}) == len(DECISIONS)
    assert len({limit.word for limit in LIMITS}) == len(LIMITS)


def test_every_limit_is_named_by_a_row_or_the_introduction():
    text = document().partition("## Limits")[0]
    assert [limit.word for limit in LIMITS if limit.word not in text] == []


def test_every_status_without_a_coordinate_has_a_reaction():
    assert {status for status in Status if not status.is_ok} <= STATUS_REACTIONS.keys()
    for reaction, why in STATUS_REACTIONS.values():
        assert reaction in {Reaction.ASK_AGAIN, Reaction.STOP}
        assert why


def test_the_documentation_of_robot_programs_is_up_to_date():
    path = Path(__file__).parents[2] / "docs" / "robot-programs.md"
    assert path.read_text() == document(), (
        "run: python -m vgrd.registers.program_document docs/robot-programs.md"
    )
