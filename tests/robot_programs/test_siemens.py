"""SCL is judged as the IEC 61131-3 that is left when what only SCL has is taken away."""

import math
import re
from types import SimpleNamespace

import pytest
import tree_sitter_iec61131_3_st
from tree_sitter import Language, Parser

from tests.robot_programs.brands.programs import PROGRAMS
from tests.robot_programs.brands.scenarios import NUMBERS
from tests.robot_programs.brands.scl import (
    BLOCKS,
    Builtins,
    executable,
    load,
    normalised,
    variables,
)
from tests.robot_programs.brands.translation import NotUnderstoodError, translate
from tests.robot_programs.brands.world import SERVED, TAUGHT, World
from vgrd.registers.layout import REQUEST, RESPONSE

SOURCE = PROGRAMS["siemens"].source
SEEDED = (
    ("END_IF;", ""),
    ("END_FOR;", "END_IF;"),
    ("#valid := FALSE;", "#valid = FALSE;"),
    (" THEN", ""),
    ("VAR_OUTPUT", "VAR_OUTPUTS"),
)
SEEN_BY_THE_TRANSLATION = (  # the grammar takes them
    ("END_CASE;", "END_CASE"),
    ("#pollTimer(IN :=", "#pollTimer(IN ="),
    ("WORD_TO_UINT(", "WORD_TO_UNIT("),
)


def has_error(source):
    parser = Parser(Language(tree_sitter_iec61131_3_st.language()))
    return parser.parse(normalised(source).encode()).root_node.has_error


def test_the_block_has_the_grammar_of_structured_text():
    assert not has_error(SOURCE)


@pytest.mark.parametrize(("right", "wrong"), SEEDED)
def test_a_seeded_fault_is_found(right, wrong):
    assert right in SOURCE
    assert has_error(SOURCE.replace(right, wrong, 1))


@pytest.mark.parametrize(("right", "wrong"), SEEN_BY_THE_TRANSLATION)
def test_a_fault_that_the_grammar_takes_is_refused_by_the_translation(right, wrong):
    assert right in SOURCE
    with pytest.raises(NotUnderstoodError):
        translate(executable(SOURCE.replace(right, wrong, 1)), PROGRAMS["siemens"].dialect)


def test_every_name_of_the_block_is_declared():
    declared = {name.lower() for name in re.findall(r"^\s+(\w+) : ", SOURCE, re.MULTILINE)}
    used = {name.lower() for name in re.findall(r"(?<!\w)#(\w+)", SOURCE)}
    assert used <= declared
    assert "words" in declared


def test_inputs_of_a_called_block_are_its_inputs():
    types = dict(re.findall(r"^\s+(\w+) : (MB_CLIENT|TON_TIME);", SOURCE, re.MULTILINE))
    calls = re.findall(r"#(\w+)\(((?:\s*\w+ := [^,;]+,?)+)\);", SOURCE)
    assert len(calls) == len(types) == 5
    for instance, arguments in calls:
        given = [name.lower() for name in re.findall(r"(\w+) :=", arguments)]
        assert tuple(given) == BLOCKS[types[instance].lower()]


def test_the_data_that_mb_client_writes_is_in_a_block_that_is_not_optimised():
    block = SOURCE[SOURCE.index("DATA_BLOCK") : SOURCE.index("END_DATA_BLOCK")]
    assert "S7_Optimized_Access := 'FALSE'" in block
    assert f"Array[0..{RESPONSE.end - RESPONSE.start - 1}] of Word" in block
    assert all(field.address < 29 for field in REQUEST.fields)


def test_the_registers_that_are_compared_are_those_of_the_map():
    addresses = {field.name: field.address - RESPONSE.start for field in RESPONSE.fields}
    meant = (
        *(
            "MAPVER",
            "HB",
            "ECHO",
            "STATUS",
            "DETAIL",
            "POINT",
            "AGE",
            "U95P",
            "OBJECT",
            "FMT",
            "SEQ",
        ),
        *("EC32_ECHO", "EC32_STATUS", "EC32_SEQ"),
    )
    compared = {int(number) for number in re.findall(r"words\[(\d+)\](?! :=)", SOURCE)}
    assert compared == {addresses[name] for name in meant}
    assert addresses["EC32_X"] == 30


def test_the_first_request_of_all_begins_with_the_trig_that_clears():
    world = World()
    v = variables(SOURCE, world)
    scan = load(executable(SOURCE), PROGRAMS["siemens"].dialect, v, Builtins()).fb_vgrdask
    for ask in (True, False, True):
        v.ask = ask
        for _ in range(200):
            world.now_s += 0.01
            scan()
    assert [wrote[0] for wrote in v.client.wrote] == [0, 1, 2]


def test_a_job_that_runs_is_waited_for_when_ask_rises_again():
    world = World()
    v = variables(SOURCE, world)
    v.pointid = 7
    scan = load(executable(SOURCE), PROGRAMS["siemens"].dialect, v, Builtins()).fb_vgrdask
    for number in range(400):
        v.ask = number % 7 != 0
        world.now_s += 0.01
        scan()
        assert isinstance(v, SimpleNamespace)
    assert len(v.client.wrote) > 20


@pytest.mark.parametrize("name", ["taughtx", "taughtyaw", "atx"])
def test_a_number_that_is_none_is_no_place(name):
    """Comparisons with it are FALSE on an S7 too: none may be written so that FALSE lets it pass."""
    world = World()
    v = variables(SOURCE, world)
    v.pointid, v.stands = 7, 2
    (v.taughtx, v.taughty, v.taughtz, v.taughtroll, v.taughtpitch, v.taughtyaw) = TAUGHT
    (v.atx, v.aty, v.atz) = SERVED[:3]
    setattr(v, name, math.nan)
    scan = load(executable(SOURCE), PROGRAMS["siemens"].dialect, v, Builtins()).fb_vgrdask
    v.ask = True
    for _ in range(400):
        world.now_s += 0.01
        scan()
    assert (v.valid, v.word) == (False, NUMBERS["APPROACH" if name == "atx" else "STEP"])
