"""One text for every finding: nothing is found that is not in the tables, and the page tells them all."""

import re
from pathlib import Path

import pytest

from vgrd.judging import thresholds
from vgrd.judging.document import document
from vgrd.judging.findings import BEFORE_SOLVING, KINDS, OF_A_SESSION, OF_FILES, finding

ROOT = Path(__file__).parents[2]
SOURCES = {
    path: path.read_text(encoding="utf-8")
    for room in ("calibration", "solving")
    for path in (ROOT / "vgrd" / room).rglob("*.py")
}


def test_the_page_is_what_the_tables_say():
    page = (ROOT / "docs" / "checks.md").read_text(encoding="utf-8")
    assert page == document(), "python -m vgrd.judging.document docs/checks.md"


def test_every_kind_is_found_somewhere_and_stands_in_one_table():
    everything = "\n".join(SOURCES.values())
    assert not [code for code in KINDS if f'"{code}"' not in everything]
    assert len(KINDS) == len(BEFORE_SOLVING) + len(OF_A_SESSION) + len(OF_FILES)


def test_no_finding_is_made_beside_the_tables():
    made = [str(path) for path, text in SOURCES.items() if re.search(r"\bFinding\(", text)]
    assert not made


def test_a_sentence_ends_with_the_remedy_of_its_kind():
    doubt = finding("tag_size", "tag A measures 24 mm")
    assert doubt.message.startswith("tag A measures 24 mm: measure its black square")
    assert finding("few_points", "sample 2").message == "sample 2"
    with pytest.raises(KeyError):
        finding("unheard_of", "something")


def test_every_threshold_says_why():
    text = Path(thresholds.__file__).read_text(encoding="utf-8")
    values = [line for line in text.splitlines() if re.match(r"[A-Z_]+ = ", line)]
    silent = [line for line in values if "#" not in line]
    # The second of a pair, mm and rad, shares the reason of the first.
    assert {line.split(" ")[0] for line in silent} <= {"SAME_POSE_RAD", "SAME_TEXT_RAD"}
    assert len(values) > 20
