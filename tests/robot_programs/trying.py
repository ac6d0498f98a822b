"""Tries a program in one scenario."""

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tests.robot_programs import python_run
from tests.robot_programs.python_run import PythonRun, module_of
from tests.robot_programs.scenarios import Scenario, arrived
from tests.robot_programs.urscript import urscript_run
from tests.robot_programs.urscript.urscript_run import UrscriptRun
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


# CB3 cannot ask how old a signal is: without a link it finds no map, and then no heartbeat. It reads
# register by register: when an answer ends, whichever was read first tells it.
WORD_WITHOUT_LINK = {
    When.START: "MAP_VERSION",
    When.APPROACH: "HEARTBEAT",
    When.LAST_LEG: "HEARTBEAT",
}
ENDED = ("STATUS", "POLL")


def expected(scenario: Scenario, language: str, outcome: Outcome) -> Outcome:
    """What a program does; on CB3 another word may tell the same."""
    if language.endswith("CB3"):
        if scenario.outcome.word == "LINK":
            return replace(scenario.outcome, word=WORD_WITHOUT_LINK[scenario.when])
        if scenario.when is not When.START and {scenario.outcome.word, outcome.word} <= {*ENDED}:
            return replace(scenario.outcome, word=outcome.word, status=outcome.status)
    return scenario.outcome


def react(directory: Path, scenario: Scenario, language: str, source: str) -> float | None:
    """Assert that the program does what the table says; return after which time it told the arm to stop."""
    world = World(directory, scenario.when, scenario.fault)
    with contextlib.closing(RUNS[language](world, source)) as run:
        outcome = run.start()
        assert replace(outcome, told_s=None) == expected(scenario, language, outcome)
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
