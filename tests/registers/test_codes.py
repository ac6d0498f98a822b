"""Nothing is declared that does not work, and no number ever gets a second meaning."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import vgrd
from vgrd.registers import REQUEST, Command, Request, Status
from vgrd.registers.codes import RESERVED
from vgrd.registers.document import document

SOURCES = Path(vgrd.__file__).parent
DECLARING = ("registers/codes.py", "registers/document.py", "registers/remedies.py")


def uses(codes: str, *, compared: bool) -> Iterator[str]:
    """Names of the members of `codes` in the sources; compared: also those in comparisons."""
    for path in SOURCES.rglob("*.py"):
        if str(path.relative_to(SOURCES)) in DECLARING:
            continue
        tree = ast.parse(path.read_text())
        questions = [
            inner
            for node in ast.walk(tree)
            if isinstance(node, ast.Compare)
            for inner in ast.walk(node)
        ]
        for node in ast.walk(tree):
            match node:
                case ast.Attribute(value=ast.Name(id=owner), attr=name) if owner == codes:
                    if compared or node not in questions:
                        yield name


@pytest.mark.parametrize("codes", RESERVED, ids=lambda codes: codes.__name__)
def test_no_code_has_a_reserved_number(codes):
    assert not RESERVED[codes].keys() & {int(code) for code in codes}
    names = {why.partition(":")[0] for why in RESERVED[codes].values()}
    assert len(names) == len(RESERVED[codes])
    assert not names & set(codes.__members__)


@pytest.mark.parametrize("codes", RESERVED, ids=lambda codes: codes.__name__)
def test_no_reserved_code_is_in_the_documentation(codes):
    lines = document().splitlines()
    for number, why in RESERVED[codes].items():
        name = why.partition(":")[0]
        assert not [line for line in lines if line.startswith(f"| {number} | {name} |")]


def test_every_status_is_emitted():
    assert set(Status.__members__) == set(uses("Status", compared=False))


def test_every_command_is_obeyed():
    assert set(Command.__members__) == set(uses("Command", compared=True))


@pytest.mark.parametrize("register", range(32))
def test_only_a_register_that_is_read_may_hold_something(register):
    words = bytearray(64)
    words[2 * register + 1] = 1
    named = Request.parse(bytes(words)).reserved_register
    assert named == (register if register in REQUEST.reserved else None)
    assert (register in REQUEST.reserved) == (register in (*range(10, 22), 29, 30, 31))
