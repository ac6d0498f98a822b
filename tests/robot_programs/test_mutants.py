"""A program that leaves a decision out fails a scenario of that row: no check stands there for nothing."""

import pytest

from tests.robot_programs.mutants import python_mutants, statement_mutants, urscript_mutants
from tests.robot_programs.scenarios import SCENARIOS
from tests.robot_programs.trying import TEXTS, react
from tests.robot_programs.urscript.single_registers import OTHER, accepted
from tests.robot_programs.world import COORDINATE
from vgrd.registers.decisions import DECISIONS

MUTANTS = [
    *(("python", mutant) for mutant in python_mutants(TEXTS["python"])),
    *(("python", mutant) for mutant in statement_mutants(TEXTS["python"])),
    *(
        (language, mutant)
        for language in ("urscript", "urscript for CB3")
        for mutant in urscript_mutants(TEXTS[language], language)
    ),
]


def is_found(directory, language, mutant):
    """Whether a scenario of its row, or one in which all is well, fails."""
    seen = [scenario for scenario in SCENARIOS if scenario.is_for(language)]
    own = [scenario for scenario in seen if scenario.row == mutant.row]
    well = [scenario for scenario in SCENARIOS if scenario.row == "ASK_AGAIN"]
    for number, scenario in enumerate([*own, *well]):
        (directory / str(number)).mkdir()
        try:
            react(directory / str(number), scenario, language, mutant.source)
        except Exception:  # noqa: BLE001 - whatever goes wrong shows it
            return True
    one_by_one = language.endswith("CB3") and mutant.row == "SEQ"
    return one_by_one and is_torn(directory / "torn", mutant.source)


def is_torn(directory, source):
    """Whether a coordinate of two answers is accepted."""
    directory.mkdir()
    return bool({*accepted(directory, source)} - {COORDINATE, OTHER})


@pytest.mark.parametrize(("language", "mutant"), MUTANTS, ids=str)
def test_a_program_without_a_decision_is_found_out(tmp_path, language, mutant):
    assert is_found(tmp_path, language, mutant)


@pytest.mark.parametrize("language", TEXTS)
def test_every_row_has_a_mutant(language):
    assert {mutant.row for of, mutant in MUTANTS if of == language} == {
        row.word for row in DECISIONS
    }
