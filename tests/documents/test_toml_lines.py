"""Lines of keys: every key that tomllib finds has the line at which it was written."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.documents.toml_lines import Location, key_places

EXAMPLE = """\
# a comment with [brackets] and "quotes
title = "x = 1 # no comment"   # [no.table]
'a "key"'."with.dot" = 1
[robot]
driver = 'a\\b'
[robot.settings]
text = \"\"\"
[no.table]
key = 1 \\"\"\"
\"\"\"\"\"
lines = '''
# no comment
'''
matrix = [ # of rows
  [1, 2], [3,
  4,], # more
]
[object]
center = {x = 1, "y" = {z = 2}, list = [{a = 1}, {a = 2}]}
day = 1979-05-27 07:32:00
[[object.targets]]
name = "P1"
[[object.targets.holes]]
d = 1
[[object.targets]]
name = "P2"
[[object.targets.holes]]
d = 2
  [[ object . targets . holes ]]
  d = 3
[object.targets.tool]
x = 1
"""
EXPECTED: dict[Location, int] = {
    ("title",): 2,
    ('a "key"', "with.dot"): 3,
    ("robot",): 4,
    ("robot", "driver"): 5,
    ("robot", "settings", "text"): 7,
    ("robot", "settings", "lines"): 11,
    ("robot", "settings", "matrix"): 14,
    ("robot", "settings", "matrix", 1): 15,
    ("robot", "settings", "matrix", 1, 1): 16,
    ("object", "center", "y", "z"): 19,
    ("object", "center", "list", 1, "a"): 19,
    ("object", "day"): 20,
    ("object", "targets"): 21,
    ("object", "targets", 0, "holes", 0, "d"): 24,
    ("object", "targets", 1): 25,
    ("object", "targets", 1, "holes", 0, "d"): 28,
    ("object", "targets", 1, "holes", 1): 29,
    ("object", "targets", 1, "holes", 1, "d"): 30,
    ("object", "targets", 1, "tool", "x"): 32,
}


def places_in(value: object, where: Location = ()) -> set[Location]:
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    return {where}.union(*(places_in(inner, (*where, key)) for key, inner in items))


def test_every_form_of_key_has_its_line() -> None:
    places = key_places(EXAMPLE)
    assert {where: places.lines[where] for where in EXPECTED} == EXPECTED
    assert set(places.lines) == places_in(tomllib.loads(EXAMPLE)) - {()}


def test_keys_are_called_as_people_call_them() -> None:
    places = key_places(EXAMPLE)
    assert places.key(("object", "targets", 1, "holes", 0)) == "object.targets.P2.holes.#1"
    assert places.key(("object", "targets", 7, "id")) == "object.targets.#8.id"
    assert places.key(()) == "(file)"
    assert places.told(("object", "targets", 1, "id"), "is missing") == (
        "line 25: object.targets.P2.id: is missing"
    )
    assert places.line(("serving", "port")) == 1


@pytest.mark.parametrize("text", ["a = ", "[a", "a = [1", "= 1"])
def test_what_is_no_toml_is_left_to_tomllib(text: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError):
        key_places(text)


KEYS = st.text("abc-_1", min_size=1, max_size=3)
VALUES = st.recursive(
    st.integers(-9, 9).map(str)
    | st.booleans().map(lambda flag: str(flag).lower())
    | st.text("ab #[]{},=.'", max_size=6).map(lambda text: f'"{text}"')
    | st.text('ab #[]{},=."\n', max_size=6).map(lambda text: f"'''{text}x'''"),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: "[" + ",\n".join(items) + "]")
        | st.dictionaries(KEYS, inner, max_size=3).map(
            lambda table: "{" + ", ".join(f"{k} = {v}" for k, v in table.items()) + "}"
        )
    ),
    max_leaves=8,
)
TABLES = st.dictionaries(KEYS, st.dictionaries(KEYS, VALUES, max_size=4), min_size=1, max_size=4)


@given(TABLES, st.integers(0, 3))
def test_every_key_of_any_file_has_a_line_that_holds_it(
    tables: dict[str, dict[str, str]], blank: int
) -> None:
    gap = "\n" * blank
    text = gap.join(
        f"[{name}] # [{name}.x]\n{gap}" + "".join(f"{k} = {v}\n" for k, v in table.items())
        for name, table in tables.items()
    )
    places = key_places(text)
    assert set(places.lines) == places_in(tomllib.loads(text)) - {()}
    lines = text.splitlines()
    for where, line in places.lines.items():
        if len(where) == 1:
            assert lines[line - 1].startswith(f"[{where[0]}]")
        elif len(where) == 2:
            assert lines[line - 1].startswith(f"{where[1]} = ")
