"""docs/paper.md names something for everything in the paper, and what it names exists."""

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import typer

from fakes.studies.catalogue import STUDIES
from vgrd.cli import app

ROOT = Path(__file__).parents[2]
NOT_YET = "not yet"
MAY_WAIT = {f"[{n}]" for n in (3, 4, 5, 6, 7)}  # another kind of tag, kinematics of the robot
COUNTS = {"Eq.": range(1, 31), "Figure": range(1, 11), "Table": range(1, 5), "[": range(2, 22)}


def items(cell):
    """What a first cell stands for: `Eq. 7-8` is Eq. 7 and Eq. 8."""
    kind = cell.split(" ")[0] if cell[0] != "[" else "["
    first, *last = [int(number) for number in re.findall(r"\d+", cell)]
    numbers = range(first, (last or [first])[0] + 1)
    return [f"[{n}]" if kind == "[" else f"{kind} {n}" for n in numbers]


def index():
    """Rows by item: function, test, command, result."""
    rows = {}
    for line in (ROOT / "docs" / "paper.md").read_text(encoding="utf-8").splitlines():
        if not re.match(r"\| (Eq\.|Figure|Table|\[)", line):
            continue
        first, _, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        for item in items(first):
            assert item not in rows, f"{item} stands there twice"
            rows[item] = tuple(cell.strip("`") for cell in cells)
    return rows


ROWS = index()
DONE = {item: row for item, row in ROWS.items() if row[0] != NOT_YET}


@cache
def functions(path):
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_equation_figure_table_and_cited_method_is_in_the_index():
    every = {
        f"[{n}]" if kind == "[" else f"{kind} {n}"
        for kind, numbers in COUNTS.items()
        for n in numbers
    }
    assert set(ROWS) == every


def test_only_what_may_wait_is_not_there_yet():
    assert set(ROWS) - set(DONE) == MAY_WAIT
    for item in MAY_WAIT:
        assert ROWS[item][:3] == (NOT_YET,) * 3, f"{item} exists in part: say what"


@pytest.mark.parametrize("item", DONE)
def test_what_the_index_names_exists(item):
    function, test, command, result = DONE[item]
    module, name = function.split(":")
    assert hasattr(import_module(module), name)
    path, test_name = test.split("::")
    assert test_name in functions(path)
    program, subcommand, *rest = command.split(" ")
    assert program == "vgrd"
    assert subcommand in typer.main.get_command(app).commands
    assert set(rest) <= set(STUDIES)
    assert result
