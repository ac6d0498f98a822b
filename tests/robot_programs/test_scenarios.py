"""Every robot program does what the decision table says, whatever happens."""

import pytest

from tests.robot_programs.scenarios import SCENARIOS
from tests.robot_programs.trying import TEXTS, react
from vgrd.registers.decisions import DECISIONS


def test_every_row_of_the_table_has_a_scenario():
    assert {scenario.row for scenario in SCENARIOS} == {row.word for row in DECISIONS}


@pytest.mark.parametrize(
    ("scenario", "language"),
    [(each, language) for each in SCENARIOS for language in TEXTS if each.is_for(language)],
    ids=str,
)
def test_a_program_reacts_as_the_table_says(tmp_path, scenario, language, record_property):
    told_s = react(tmp_path, scenario, language, TEXTS[language])
    if told_s is not None:
        record_property("stop commanded after, s", round(told_s, 3))
