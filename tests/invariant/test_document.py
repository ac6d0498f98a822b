"""docs/invariant.md lists every rule with the faults that it stands for, and every fault of the lists."""

import re
from pathlib import Path

from tests.invariant.rules.catalogue import RULES

TEXT = (Path(__file__).parents[2] / "docs" / "invariant.md").read_text(encoding="utf-8")
ROOT = Path(__file__).parents[2]


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\b[FSRC]\d+\b", text))


def test_every_rule_has_its_row_with_the_faults_that_it_stands_for():
    rows = {
        name: numbers(line)
        for line in TEXT.splitlines()
        if line.startswith("| `")
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
    }
    assert set(RULES) == rows.keys()
    assert {n: r.faults for n, r in RULES.items() if not numbers(r.faults) <= rows[n]} == {}


def test_every_fault_of_the_lists_is_a_rule_or_is_said_to_be_held_elsewhere():
    listed = {f"F{i}" for i in range(1, 46)} | {"F48"} | {f"S{i}" for i in range(1, 11)}
    listed |= {f"R{i}" for i in range(1, 8)} | {f"C{i}" for i in range(1, 18)}
    assert listed - numbers(TEXT) == set()


def test_every_test_that_the_page_names_is_there():
    named = re.findall(r"`(tests/[a-z_/]+(?:\.py)?)`", TEXT)
    assert [name for name in named if not (ROOT / name).exists()] == []
