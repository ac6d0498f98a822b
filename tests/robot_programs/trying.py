"""Tries a program in one scenario."""

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tests.robot_programs import python_run, urscript_run
from tests.robot_programs.python_run import PythonRun, module_of
from tests.robot_programs.scenarios import Scenario, arrived
from tests.robot_programs.urscript_run import UrscriptRun
from tests.robot_programs.world import Outcome, When, World
from vgrd.registers.decisions import LIMITS

LIMIT = {limit.word: limit.value for limit in LIMITS}
SERVER_S = 0.26  # within which the server's own faults reach the registers (docs/registers.md)
ROUNDING_S = 1e-6
WAITED_S = 1.0  # for somebody to come

TEXTS = {
    "python": python_run.FILE.read_text(),
    "urscript": urscript_run.FILE.read_text(),
    "urscript for CB3": urscript_run.script_for_cb3(),
}
RUNS: dict[str, Callable[[World, str], PythonRun | UrscriptRun]] = {
    "python": lambda world, source: PythonRun(world, module_of(source)),
    "urscript": UrscriptRun,
    "urscript for CB3": UrscriptRun,
}


# CB3 cannot ask how old a signal is: without a link it finds no map, and then no heartbeat.
WORD_WITHOUT_LINK = {When.START: "MAP_VERSION"}


def expected(scenario: Scenario, language: str) -> Outcome:
    """What a program does; where the link cannot be told, that it stops all the same."""
    if language.endswith("CB3") and scenario.row == "LINK":
        word = WORD_WITHOUT_LINK.get(scenario.when, "HEARTBEAT")
        return replace(scenario.outcome, word=word)
    return scenario.outcome


def react(directory: Path, scenario: Scenario, language: str, source: str) -> float | None:
    """Assert that the program does what the table says; return after which time it told the arm to stop."""
    world = World(directory, scenario.when, scenario.fault)
    with contextlib.closing(RUNS[language](world, source)) as run:
        outcome = run.start()
        assert replace(outcome, told_s=None) == expected(scenario, language)
        if outcome.told_s is not None:
            late_s = LIMIT["HEARTBEAT_S"] if outcome.word == "HEARTBEAT" else SERVER_S
            assert outcome.told_s <= LIMIT["POLL_S"] + late_s + ROUNDING_S
        if outcome.word:
            _resume(world, run)
    return outcome.told_s


def _resume(world: World, run: PythonRun | UrscriptRun) -> None:
    """RESUME: nothing moves before the key; then all is well."""
    goals, asks = len(world.arm.goals), len(world.cell.trigs)
    world.heal()
    run.wait(WAITED_S)
    assert (len(world.arm.goals), len(world.cell.trigs)) == (goals, asks)
    outcome = run.press_key()
    assert (outcome.word, outcome.rest) == ("", arrived().rest)
