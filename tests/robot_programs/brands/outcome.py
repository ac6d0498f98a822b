"""What became of a program, and whether that is what the decision table wants."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from tests.robot_programs.brands.scenarios import LIMIT, NUMBERS, Scenario
from tests.robot_programs.brands.world import SERVED, StoppedError, World

STOPPED_WITHIN_S = LIMIT["POLL_S"] + 0.26  # as docs/robot-programs.md promises
NO_BEAT_WITHIN_S = (
    LIMIT["HEARTBEAT_S"] + 0.1 + 2 * LIMIT["POLL_S"]
)  # HB may have changed just before


@dataclass(frozen=True)
class Outcome:
    """decisions: the numbers of those that ended an attempt, in their order. pose: what a block without an arm gave."""

    world: World
    arrived: bool
    decisions: tuple[int, ...]
    asks_at_decision: tuple[int, ...]
    pose: tuple[float, ...] = ()


def run(world: World, go: Callable[[], object], word: Callable[[], int]) -> Outcome:
    """Run `go`; `word` is asked for the decision whenever the program pauses or halts."""
    decisions: list[int] = []
    asks: list[int] = []
    told = world.told

    class Telling(list[str]):
        def append(self, text: str) -> None:
            super().append(text)
            if text in ("pause", "halt"):
                decisions.append(int(word()))
                asks.append(len(world.asks))

    world.told = Telling(told)
    try:
        go()
        for _ in range(world.visits - 1):
            world.be_silent()
            go()
        arrived = True
    except StoppedError:
        arrived = False
    return Outcome(world, arrived, tuple(decisions), tuple(asks))


def faults_of(
    scenario: Scenario, program: Callable[[World, Mapping[str, object]], Outcome]
) -> list[str]:
    """Return in which ways a robot's program does not do what the decision table says."""
    world = World(replace(scenario.fault), keys=scenario.keys)
    outcome = program(world, scenario.settings)
    found = _lawful(outcome)
    if scenario.word == "USE" and not scenario.again:
        if not outcome.arrived or outcome.decisions or len(world.asks) != 2:
            found.append(f"did not use it: {outcome.decisions}, {len(world.asks)} asked")
        return found
    number = NUMBERS.get(scenario.word)
    if number and outcome.decisions[:1] != (number,):
        found.append(f"decided {outcome.decisions[:1]}, not {number}")
    if scenario.keys:
        return found if outcome.arrived else [*found, "did not begin anew by the key"]
    asked_again = (
        len(world.asks) > outcome.asks_at_decision[0] if outcome.asks_at_decision else False
    )
    if asked_again != scenario.again:
        found.append(f"asked again: {asked_again}")
    on_the_way = scenario.fault.since in ("approach", "last")
    if scenario.fault.task_dies and world.legs and not on_the_way:
        found.append("moved unwatched")
    if scenario.fault.since == "ask" and not scenario.fault.task_dies:
        found += _stayed(outcome, scenario)
    if on_the_way:
        found += _stopped(outcome, scenario)
    return found


def faults_of_block(
    scenario: Scenario, program: Callable[[World, Mapping[str, object]], Outcome]
) -> list[str]:
    """Return the same of a block that decides, and moves nothing."""
    world = World(replace(scenario.fault), keys=scenario.keys)
    outcome = program(world, scenario.settings)
    found = _lawful(replace(outcome, arrived=False))
    if any(ask.options != 16 for ask in world.asks):
        found.append("asked in another rotation format")
    number = NUMBERS.get(scenario.word)
    if number and outcome.decisions[:1] != (number,):
        found.append(f"decided {outcome.decisions[:1]}, not {number}")
    if scenario.keys:
        return found if outcome.arrived else [*found, "did not ask anew"]
    if (len(world.asks) > 1) != scenario.again:
        found.append(f"asked {len(world.asks)} times")
    if outcome.arrived != (scenario.word == "USE"):
        found.append(f"valid: {outcome.arrived}")
    if outcome.arrived and math.dist(outcome.pose, world.read().pose) > 0.01:
        found.append(f"gave {outcome.pose}")
    if scenario.fault.since == "ask" and scenario.word != "USE" and world.legs:
        found.append("was valid")
    if scenario.fault.since == "approach" and scenario.word == "POLL":
        within = NO_BEAT_WITHIN_S if "heartbeat" in scenario.name else STOPPED_WITHIN_S
        if not world.stopped_s - world.lost_s <= within:
            found.append(f"fell after {world.stopped_s - world.lost_s:.3f} s")
    return found


def _lawful(outcome: Outcome) -> list[str]:
    """What holds whatever happens."""
    found, world = [], outcome.world
    trigs = [ask.trig for ask in world.asks]
    if any(
        trig == 0 or ask.point != 7 or ask.command != 2
        for trig, ask in zip(trigs, world.asks, strict=True)
    ):
        found.append(f"asked for what was not wanted: {world.asks}")
    if any((b - a) % 65535 != 1 for a, b in pairwise(trigs)):
        found.append(f"TRIG goes {trigs}")
    if outcome.arrived:
        way, place = world.moves[-1]
        if way != "leg" or math.dist(place, world.read().pose[:3]) > 0.02:
            found.append(f"arrived at {place}")
    if any(way == "leg" and math.dist(place, SERVED[:3]) > 120 for way, place in world.moves):
        found.append("went where nothing was served")
    return found


def _stayed(outcome: Outcome, scenario: Scenario) -> list[str]:
    found = []
    if outcome.world.legs:
        found.append("moved to what it may not use")
    asked = LIMIT["ATTEMPTS"] if scenario.again else 1
    if outcome.arrived or len(outcome.world.asks) != asked:
        found.append(f"asked {len(outcome.world.asks)} times")
    return found


def _stopped(outcome: Outcome, scenario: Scenario) -> list[str]:
    found, world = [], outcome.world
    ends = (
        [] if scenario.word == "APPROACH" else ["stop"]
    )  # else it is over, and there is nothing to stop
    within = NO_BEAT_WITHIN_S if "heartbeat" in scenario.name else STOPPED_WITHIN_S
    if ends and not world.stopped_s - world.lost_s <= within:
        found.append(f"stopped after {world.stopped_s - world.lost_s:.3f} s")
    ways = [way for way, _ in world.moves]
    legs = [place for way, place in world.moves if way == "leg"]
    if scenario.fault.since == "approach" and ways != ["free", "leg", *ends]:
        found.append(f"went on after the stop: {ways}")
    if scenario.fault.since == "last" and ways != ["free", "leg", "leg", *ends, "straight"]:
        found.append(f"did not retreat: {ways}")
    if scenario.fault.since == "last" and world.moves[-1][1] != legs[0]:
        found.append(f"retreated to {world.moves[-1][1]}, not {legs[0]}")
    return found
