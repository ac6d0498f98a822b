"""Every robot program does what the decision table says, whatever happens."""

import pytest

from tests.robot_programs.python_run import FILE, PythonRun, module_of
from tests.robot_programs.scenarios import SCENARIOS, arrived
from tests.robot_programs.world import World
from vgrd.registers.decisions import DECISIONS, LIMITS

LIMIT = {limit.word: limit.value for limit in LIMITS}
SERVER_S = 0.26  # within which the server's own faults reach the registers (docs/registers.md)
ROUNDING_S = 1e-6
RUNS = {"python": lambda world: PythonRun(world, module_of(FILE.read_text()))}


def test_every_row_of_the_table_has_a_scenario():
    assert {scenario.row for scenario in SCENARIOS} == {row.word for row in DECISIONS}


@pytest.mark.parametrize("language", RUNS)
@pytest.mark.parametrize("scenario", SCENARIOS, ids=str)
def test_a_program_reacts_as_the_table_says(tmp_path, scenario, language):
    world = World(tmp_path, scenario.when, scenario.fault)
    run = RUNS[language](world)
    outcome = run.start()
    told_s = outcome.told_s
    assert (outcome.word, outcome.status, outcome.asks, outcome.rest) == (
        scenario.outcome.word,
        scenario.outcome.status,
        scenario.outcome.asks,
        scenario.outcome.rest,
    )
    if told_s is not None:
        late_s = LIMIT["HEARTBEAT_S"] if outcome.word == "HEARTBEAT" else SERVER_S
        assert told_s <= LIMIT["POLL_S"] + late_s + ROUNDING_S
    if outcome.word:
        check_that_one_key_resumes(world, run)


def check_that_one_key_resumes(world, run):
    """RESUME: nothing moves before the key, and then all is well."""
    goals, asks = len(world.arm.goals), len(world.cell.trigs)
    world.heal()
    run.wait(1.0)
    assert (len(world.arm.goals), len(world.cell.trigs)) == (goals, asks)
    outcome = run.press_key()
    assert (outcome.word, outcome.rest) == ("", arrived().rest)
