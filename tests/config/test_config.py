"""The cell file: everything wrong is said at once, with key and remedy."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.config.cell_file import CellConfig, load_config
from vgrd.config.document import document
from vgrd.config.setup import cell_facts
from vgrd.errors import ConfigError, InputError

GOOD = """
[cell]
name = "demo"
state_dir = "state"
runtime_dir = "run"
[robot]
driver = "ur_rtde"
[camera]
driver = "aravis"
matrix = [6486.0, 6486, 2012.0, 1518.0]
size_px = [4024, 3036]
[tags.a]
id = 0
size_mm = 25.0
[tags.b]
id = 1
size_mm = 25.0
[object]
[[object.targets]]
id = 1
name = "p1"
point_mm = [60, 0, 0]
[[object.targets]]
id = 2
name = "p2"
point_mm = [0, 60, 0]
"""


def faults(text: str, folder: Path) -> list[str]:
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 78
    return list(caught.value.faults)


def test_a_good_file_loads_with_folders_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(GOOD, encoding="utf-8")
    config = load_config(path)
    assert config.cell.state_dir == str(tmp_path / "state")
    assert config.cell.runtime_dir == str(tmp_path / "run")
    assert [target.name for target in config.object.targets] == ["p1", "p2"]


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("size_mm = 25.0", "size_m = 0.025", 1).replace('driver = "ur_rtde"', "")
    told = faults(text.replace("id = 2", "id = 1") + "\n[serving]\nprot = 1", tmp_path)
    joined = "\n".join(told)
    assert "tags.a.size_m: unknown key, did you mean 'size_mm'?" in joined
    assert "tags.a.size_mm: is missing" in joined
    assert "robot.driver: is missing" in joined
    assert "serving.prot: unknown key, did you mean 'port'?" in joined
    assert "share the id 1" in joined


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("size_mm = 25.0", "size_mm = 0.025", "tags.a.size_mm: Input should be greater than"),
        ("6486.0, 6486", "-6486.0, 6486", "focal lengths positive"),
        ("6486.0, 6486", "8.5, 8.5", "fx = 8.5 is no focal length"),
        ("id = 1\nsize", "id = 0\nsize", "must differ in id"),
        ("id = 1\nsize", 'id = 0\nfamily = "25h9"\nsize', "must differ in id"),
        ('driver = "aravis"', 'driver = "aravis"\ndistortion = [0.1]', "0, 4, 5 or 8"),
        ('name = "p2"', 'name = "p1"', "share the name p1"),
        (
            "[camera]",
            "[robot.settings]\nsince = 2026-01-01\n[camera]",
            "robot.settings: holds a date",
        ),
        ("[60, 0, 0]", "[60, 0]", "at least 3 items"),
        ("[60, 0, 0]", '["60", 0, 0]', "valid number"),
        ("[object]", "[object]\nmotion = 'spinning'", "turntable"),
    ],
)
def test_each_fault_names_key_and_remedy(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    assert expected in "\n".join(faults(GOOD.replace(old, new, 1), tmp_path))


def test_broken_toml_tells_the_line(tmp_path: Path) -> None:
    assert "line 3" in faults("[cell]\nname = 'x'\nname\n[robot]", tmp_path)[0]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load_config(tmp_path / "nowhere.toml")


def keys_of(table: dict, prefix: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for key, value in table.items():
        found.append((*prefix, key))
        if isinstance(value, dict):
            found += keys_of(value, (*prefix, key))
    return found


@given(st.sampled_from(keys_of(tomllib.loads(GOOD))), st.integers(0, 3))
def test_any_misspelt_key_is_named(
    tmp_path_factory: pytest.TempPathFactory, key: tuple[str, ...], position: int
) -> None:
    """One letter doubled in any key of the file."""
    name = key[-1]
    at = min(position, len(name) - 1)
    wrong = name[: at + 1] + name[at] + name[at + 1 :]
    data = tomllib.loads(GOOD)
    table = data
    for part in key[:-1]:
        table = table[part]
    table[wrong] = table.pop(name)
    folder = tmp_path_factory.mktemp("typo")
    told = faults(to_toml(data), folder)
    assert any(f"{wrong}: unknown key" in fault and name in fault for fault in told)


def to_toml(data: dict, prefix: str = "") -> str:
    plain = {k: v for k, v in data.items() if not isinstance(v, dict) and not is_tables(v)}
    text = "".join(f"{key} = {literal(value)}\n" for key, value in plain.items())
    for key, value in data.items():
        if isinstance(value, dict):
            text += f"[{prefix}{key}]\n" + to_toml(value, f"{prefix}{key}.")
        elif is_tables(value):
            for item in value:
                text += f"[[{prefix}{key}]]\n" + to_toml(item, f"{prefix}{key}.")
    return text


def is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def literal(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


def test_the_model_covers_every_section_with_a_docstring() -> None:
    assert all(
        field.annotation.__doc__
        for field in CellConfig.model_fields.values()
        if field.annotation is not None
    )


ROOT = Path(__file__).parents[2]


def test_the_documentation_of_the_cell_file_is_up_to_date() -> None:
    page = (ROOT / "docs" / "cell-file.md").read_text(encoding="utf-8")
    assert page == document(), "run: python -m vgrd.config.document docs/cell-file.md"


def test_the_example_is_good() -> None:
    load_config(ROOT / "config" / "cell.example.toml")


THIRD = '[[object.targets]]\nid = 3\nname = "p3"\npoint_mm = [-60, 0, 0]\n'
BARE = '[[object.targets]]\nid = 4\nname = "p4"\n'


def test_a_target_may_have_no_cad(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(GOOD + THIRD + BARE, encoding="utf-8")
    facts = cell_facts(load_config(path))
    assert facts.object.bare == ("p4",)
    assert facts.object.has_cad
    assert facts.object.targets["p4"].point_in_object is None
    with pytest.raises(InputError, match="'p4' is not in CAD: give its point_mm"):
        _ = facts.object.targets["p4"].cad
    lines = GOOD.splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "point_mm" not in line), encoding="utf-8")
    assert not cell_facts(load_config(path)).object.has_cad


def test_what_needs_cad_is_refused_without_it(tmp_path: Path) -> None:
    (fault,) = faults(GOOD + THIRD + BARE + "hole_diameter_mm = 4.0\n", tmp_path)
    assert "targets" in fault
    assert "hole_diameter_mm needs point_mm" in fault
    bare = "".join(line for line in GOOD.splitlines(keepends=True) if "point_mm" not in line)
    (fault,) = faults(bare.replace("[object]", "[object]\ncenter_mm = [0, 0, 0]"), tmp_path)
    assert "no target has one: leave center_mm out" in fault
    for few in (GOOD + BARE, GOOD + THIRD.replace("-60, 0", "30, 30") + BARE):
        (fault,) = faults(few, tmp_path)
        assert "p4 have no point_mm" in fault
        assert "three targets that are not on one line, or of none" in fault
    (fault,) = faults(GOOD.replace("point_mm = [0, 60, 0]", "point_mm = []"), tmp_path)
    assert "point_mm" in fault
