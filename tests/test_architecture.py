"""The house is as it is drawn: rooms of at most 15 files, floors without a circle."""

import ast
import re
from pathlib import Path

import grimp
import pytest

from tests.architecture import arrows_of, drawing, floors_of

ROOT = Path(__file__).parents[1]
MOST_FILES = 15
MOST_FLOORS = 7


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph("vgrd", "drivers", "fakes", cache_dir=None)


def test_the_drawing_shows_the_imports_as_they_are():
    assert (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8") == drawing(), (
        "draw it anew: python -m tests.architecture docs/architecture.svg"
    )


@pytest.mark.parametrize("top", ["vgrd", "drivers", "fakes", "tests"])
def test_a_room_has_at_most_fifteen_files(top):
    folders = {path.parent for path in (ROOT / top).rglob("*.py")}
    full = {
        str(folder.relative_to(ROOT)): count
        for folder in folders
        if (count := sum(p.name != "__init__.py" for p in folder.glob("*.py"))) > MOST_FILES
    }
    assert not full


def test_every_room_says_what_lives_there_and_what_it_may_import():
    silent = [
        str(path.relative_to(ROOT))
        for top in ("vgrd", "drivers", "fakes")
        for path in (ROOT / top).rglob("__init__.py")
        if len((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n"))
        < 3
    ]
    assert not silent


def test_no_package_has_a_circle_of_rooms(graph):
    for package in sorted(graph.modules):
        if graph.find_children(package):
            floors_of(arrows_of(package, graph))


def test_the_calibration_has_at_most_seven_floors(graph):
    assert max(floors_of(arrows_of("vgrd.calibration", graph)).values()) < MOST_FLOORS


def test_a_circle_is_named():
    with pytest.raises(ValueError, match=r"circle of imports: a -> b -> a"):
        floors_of({"a": frozenset("b"), "b": frozenset("a")})


def test_every_file_that_the_page_names_is_there():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:vgrd|drivers|fakes)/[a-z_/]+(?:\.py)?)`", text))
    assert len(named) > 20
    assert not [name for name in named if not (ROOT / name).exists()]
