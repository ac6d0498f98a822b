"""The one loader of TOML: what cannot be read is told with the cause, a fault with its key and remedy."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field, ValidationError

from vgrd.documents.tables import Table, faults_of, one_of
from vgrd.documents.toml import hint, one_word, read_toml, unknown_keys
from vgrd.errors import ConfigError


class Tool(Table):
    """A table inside another."""

    length_mm: float
    kind: Annotated[str, one_of(("needle", "gripper"))] = "needle"


class Cell(Table):
    """The whole file."""

    tools: Annotated[list[Tool], Field(min_length=1)] | None = None
    port: int = 1502
    mode: Literal["slow"] = "slow"


@pytest.mark.parametrize(
    ("write", "fault"),
    [
        (lambda _: None, "no such file: give the path of a list of tools"),
        (lambda path: path.mkdir(), "cannot be read: "),
        (lambda path: path.write_bytes(b"\xe9"), "cannot be read: "),
        (lambda path: path.write_text("a = 1\na = 2\n"), "not valid TOML: "),
    ],
)
def test_a_file_that_cannot_be_read_is_told_with_the_cause(
    tmp_path: Path, write: Callable[[Path], object], fault: str
) -> None:
    path = tmp_path / "tools.toml"
    write(path)
    with pytest.raises(ConfigError) as caught:
        read_toml(path, "a list of tools")
    assert caught.value.source == str(path)
    assert len(caught.value.faults) == 1
    assert caught.value.faults[0].startswith(fault)


def faults(data: dict[str, object], where: str = "") -> list[str]:
    with pytest.raises(ValidationError) as caught:
        Cell.model_validate(data)
    return faults_of(caught.value, Cell, where)


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ({"prot": 1}, "prot: unknown key, did you mean 'port'?"),
        ({"xyz": 1}, "xyz: unknown key; known: mode, port, tools"),
        (
            {"tools": [{"length_mm": 1.0, "knid": "needle"}]},
            "tools.0.knid: unknown key, did you mean 'kind'?",
        ),
        ({"tools": [{}]}, "tools.0.length_mm: is missing, add it"),
        (
            {"tools": [{"length_mm": 1.0, "kind": "neddle"}]},
            "tools.0.kind: 'neddle' is unknown, did you mean 'needle'?",
        ),
        (
            {"tools": [{"length_mm": "long"}]},
            "tools.0.length_mm: Input should be a valid number (got 'long')",
        ),
    ],
)
def test_a_fault_names_its_key_and_the_remedy(data: dict[str, object], fault: str) -> None:
    assert faults(data) == [fault]
    assert faults(data, "cell") == [f"cell.{fault}"]


def test_a_section_that_is_none_is_not_written_out() -> None:
    assert faults({"port": [{"a": 1}] * 100}) == ["port: Input should be a valid integer"]
    assert "got 'x'" in faults({"port": "x"}, "cell")[0]


def test_the_nearest_word_is_named_or_all_of_them() -> None:
    assert hint("plan", ("plane", "sphere")) == ", did you mean 'plane'?"
    assert hint("cube", ("sphere", "plane")) == "; known: plane, sphere"
    assert hint("cube", ("plane",), list_name="known here") == "; known here: plane"


def test_words_and_keys_of_the_whole_file() -> None:
    found: list[str] = []
    assert one_word({"kind": "plane"}, "kind", ("plane",), "'plane'", found) == "plane"
    assert one_word({}, "kind", ("plane",), "'plane'", found) is None
    assert one_word({"kind": ["plane"]}, "kind", ("plane",), "'plane'", found) is None
    assert found == [
        "kind: is missing, add kind = 'plane'",
        "kind: ['plane'] is unknown, did you mean 'plane'?",
    ]
    assert unknown_keys({"kind": 1, "knd": 1}, ("kind",)) == [
        "knd: unknown key, did you mean 'kind'?"
    ]
