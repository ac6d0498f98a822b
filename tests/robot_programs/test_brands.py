"""Programs of every brand take the decisions of docs/robot-programs.md, and not one check too many is in them."""

import re
from dataclasses import replace
from functools import cache

import pytest

from tests.robot_programs.brands.programs import CASES, PROGRAMS
from tests.robot_programs.brands.scenarios import LIMIT, NUMBERS
from tests.robot_programs.brands.translation import (
    NotUnderstoodError,
    statements,
    without_each_check,
)
from tests.robot_programs.brands.world import LEG_S, World

CHECKS = [
    (brand, name, rest)
    for brand, program in PROGRAMS.items()
    for name, rest in without_each_check(program.source, program.dialect)
]


@pytest.mark.parametrize(("brand", "scenario"), CASES, ids=lambda case: str(case))
def test_a_program_decides_as_the_table_says(brand, scenario):
    program = PROGRAMS[brand]
    assert program.faults(scenario, program.source) == []


@pytest.mark.parametrize(
    ("brand", "rest"),
    [(brand, rest) for brand, _, rest in CHECKS],
    ids=[f"{b}-{n}" for b, n, _ in CHECKS],
)
def test_a_program_without_one_of_its_checks_is_found(brand, rest):
    program = PROGRAMS[brand]
    assert any(_fails(program, scenario, rest) for scenario in _quick_first(brand))


@cache
def _quick_first(brand):
    """Return the scenarios by the time that the program as it is takes for each."""
    program = PROGRAMS[brand]

    def lasts_s(scenario):
        world = World(replace(scenario.fault))
        program.run(program.source, world, scenario.settings)
        return world.now_s

    return sorted(program.scenarios, key=lasts_s)


def _fails(program, scenario, source):
    try:
        return bool(program.faults(scenario, source))
    except Exception:  # noqa: BLE001, a program that is cut may do anything, and that is found
        return True


def written(brand):
    """Return the words and the numbers that the program gives them."""
    pattern = r"^[^;!/-]*?\b(?:VGRD_)?([A-Z][A-Z0-9_]+)\b *(?:: *\w+ *)?:?= *(?:T#)?(\d+(?:\.\d+)?)(ms)?\b"
    found = re.findall(pattern, PROGRAMS[brand].source, re.MULTILINE)
    return [
        (word, float(number) / (1000 if unit else 1))
        for word, number, unit in found
        if word in NUMBERS or word in LIMIT
    ]


@pytest.mark.parametrize("brand", PROGRAMS)
def test_the_scenarios_take_every_decision_that_the_program_has(brand):
    decided = {word for word, _ in written(brand)} & NUMBERS.keys()
    assert len(decided) >= 12
    assert decided == {scenario.word for scenario in PROGRAMS[brand].scenarios} & NUMBERS.keys()


@pytest.mark.parametrize("brand", PROGRAMS)
def test_numbers_of_a_program_are_those_of_the_table(brand):
    words = written(brand)
    assert len(words) >= 18
    assert words == [(word, (NUMBERS | LIMIT)[word]) for word, _ in words]


@pytest.mark.parametrize("brand", PROGRAMS)
def test_trig_goes_from_65535_to_1(brand):
    program = PROGRAMS[brand]
    scenario = next(s for s in program.scenarios if s.fault.since == "recovered")
    world = World(scenario.fault, first_trig=65534)
    assert program.run(program.source, world, {}).arrived
    assert [ask.trig for ask in world.asks][:2] == [65535, 1]


@pytest.mark.parametrize("asked_before", [7, 29_999, 30_000, 30_001, 2**24 - 1, 2**24, 2**24 + 2])
@pytest.mark.parametrize("brand", [name for name, program in PROGRAMS.items() if program.moves])
def test_after_a_restart_it_asks_when_it_is_told_to_and_however_often_it_asked_before(
    brand, asked_before
):
    """A 32-bit float, as a num of RAPID is, does not count beyond 2^24."""
    world = World(asked_before=asked_before)
    assert PROGRAMS[brand].run(PROGRAMS[brand].source, world, {}).arrived
    assert [ask.trig for ask in world.asks] == [1, 2]
    assert [way for way, _ in world.moves] == ["free", "leg", "leg"]
    assert world.asks[0].at_s > world.began_s + LEG_S / 2, "it asked before it was where it asks"


@pytest.mark.parametrize("brand", [name for name, program in PROGRAMS.items() if program.moves])
def test_one_key_begins_anew_by_asking(brand):
    program = PROGRAMS[brand]
    scenario = next(s for s in program.scenarios if s.name == "hidden in last leg")
    world = World(scenario.fault, keys=1)
    outcome = program.run(program.source, world, {})
    assert outcome.arrived
    assert len(outcome.decisions) == 1
    assert [way for way, _ in world.moves] == [
        "free",
        "leg",
        "leg",
        "stop",
        "straight",
        "free",
        "leg",
        "leg",
    ]
    assert len(world.asks) == 4


@pytest.mark.parametrize("brand", [name for name, program in PROGRAMS.items() if program.moves])
def test_a_connection_that_was_closed_in_a_minute_of_silence_is_opened_anew(brand):
    program = PROGRAMS[brand]
    world = World(visits=3)
    assert program.run(program.source, world, {}).arrived
    assert [ask.trig for ask in world.asks] == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("brand", PROGRAMS)
def test_the_table_of_built_ins_holds_what_is_used(brand):
    program = PROGRAMS[brand]
    used = set(re.findall(r"\b[a-z_0-9]+\b", program.called))
    assert set(program.dialect.builtins) <= used


LONGEST_NAME = {"abb": 32, "kuka": 24, "fanuc": 12, "siemens": 125}


@pytest.mark.parametrize("brand", PROGRAMS)
def test_names_and_lines_are_as_short_as_the_controller_wants(brand):
    program = PROGRAMS[brand]
    text = program.source.partition("/PROG")[0]  # the head of a TP program has words of its own
    for _, line in statements(text, program.dialect.comment):
        bare = re.sub(r"'[^']*'|\"[^\"]*\"", "", line)
        assert all(
            len(name) <= LONGEST_NAME[brand] for name in re.findall(r"[A-Za-z_]\w*", bare)
        ), line
    assert all(len(line) <= 120 for line in program.source.splitlines())


@pytest.mark.parametrize("brand", PROGRAMS)
def test_a_built_in_that_does_not_exist_is_refused(brand):
    program = PROGRAMS[brand]
    name, ways = next(
        (n, w) for n, w in program.dialect.builtins.items() if f"{n}(" in program.called
    )
    for wrong in (f"{name}x(", f"{name}(1, 2, 3, 4, 5, 6, 7, 8, 9, "):
        changed = re.sub(rf"\b{name}\(", wrong, program.source, count=1, flags=re.IGNORECASE)
        assert changed != program.source, ways
        with pytest.raises(NotUnderstoodError):
            program.run(changed, World(), {})


@pytest.mark.parametrize("brand", PROGRAMS)
def test_a_program_says_that_it_did_not_run_on_hardware(brand):
    head = PROGRAMS[brand].source[:1500].lower()
    assert "not run on hardware" in head
    assert "not a safety function" in head
