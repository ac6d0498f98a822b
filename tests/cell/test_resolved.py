"""What was checked at the start is what every process of the run works with."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.world import CellNoise, World
from vgrd.config.cell_file import load_config
from vgrd.config.resolved import (
    Resolved,
    changed_keys,
    forget_resolved,
    load_resolved,
    save_resolved,
)
from vgrd.config.setup import cell_facts, process_table
from vgrd.errors import ConfigError
from vgrd.solving.differences import fact_differences

ROOT = Path(__file__).parents[2]


@pytest.fixture
def checked(tmp_path: Path) -> Resolved:
    text = (ROOT / "config" / "cell.example.toml").read_text(encoding="utf-8")
    path = tmp_path / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return Resolved(load_config(path), str(path), 1.7e9)


def test_every_key_comes_back_as_it_was_checked(checked: Resolved, tmp_path: Path) -> None:
    again = load_resolved(save_resolved(checked, tmp_path))
    assert again.values() == checked.values()
    assert len(again.values()) > 30
    assert (again.source, again.loaded_unix_s) == (checked.source, 1.7e9)
    assert changed_keys(checked, again) == []


def test_the_facts_of_the_resolved_file_are_those_of_the_users_file(tmp_path: Path) -> None:
    facts_of(World(Layout(), 5, CellNoise.none()), tmp_path)
    (path,) = tmp_path.glob("*.toml")
    config = load_config(path)
    resolved = load_resolved(save_resolved(Resolved(config, str(path), 0.0), tmp_path))
    assert fact_differences(cell_facts(config), cell_facts(resolved.config)) == []


def test_a_touch_that_tells_nothing_along_the_axis_comes_back_infinite(
    checked: Resolved, tmp_path: Path
) -> None:
    touch = checked.config.touch.model_copy(update={"axial_sigma_mm": float("inf")})
    config = checked.config.model_copy(update={"touch": touch})
    path = save_resolved(Resolved(config, "x", 0.0), tmp_path)
    assert load_resolved(path).config.touch.axial_sigma_mm == float("inf")


def test_the_file_is_of_its_user_alone(checked: Resolved, tmp_path: Path) -> None:
    assert save_resolved(checked, tmp_path).stat().st_mode & 0o077 == 0


def test_a_file_that_was_touched_is_refused(checked: Resolved, tmp_path: Path) -> None:
    path = save_resolved(checked, tmp_path)
    whole = path.read_text(encoding="utf-8")
    content = json.loads(whole)
    content["config"]["serving"]["max_age_s"] = 30.0
    for text in (json.dumps(content), whole[:-20], "", "[]"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError, match="vgrd run"):
            load_resolved(path)


def test_a_changed_key_changes_the_row_of_the_cell_and_nothing_else_does(
    checked: Resolved, tmp_path: Path
) -> None:
    def cell_row(resolved: Resolved) -> object:
        return process_table(resolved, save_resolved(resolved, tmp_path))["processes"][2]  # type: ignore[index]

    later = Resolved(checked.config, checked.source, 1.8e9)
    assert cell_row(later) == cell_row(checked)
    serving = checked.config.serving.model_copy(update={"max_age_s": 30.0})
    changed = Resolved(checked.config.model_copy(update={"serving": serving}), "x", 1.7e9)
    assert cell_row(changed) != cell_row(checked)
    assert changed_keys(checked, changed) == ["serving.max_age_s"]


def test_a_target_that_changed_is_named(checked: Resolved) -> None:
    first, *others = checked.config.object.targets
    moved = first.model_copy(update={"point_mm": [1.0, 2.0, 3.0]})
    spec = checked.config.object.model_copy(update={"targets": [moved, *others]})
    changed = Resolved(checked.config.model_copy(update={"object": spec}), "x", 0.0)
    assert changed_keys(checked, changed) == [f"object.targets.{first.name}.point_mm"]


def test_what_earlier_runs_left_is_removed(checked: Resolved, tmp_path: Path) -> None:
    (tmp_path / "cell-0123456789abcdef.json").write_text("{}", encoding="utf-8")
    path = save_resolved(checked, tmp_path)
    forget_resolved(tmp_path, but=path)
    assert list(tmp_path.glob("cell-*")) == [path]


def test_the_cell_process_starts_without_pydantic() -> None:
    code = "import sys, vgrd.cell.__main__; sys.exit('pydantic' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
