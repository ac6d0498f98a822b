"""[limits] of the cell file: a target's keys, then the cell's, then defaults; no fact that a calibration rests on."""

import math
from pathlib import Path

import pytest

from tests.config.test_config import GOOD, faults
from vgrd.config.cell_file import CellConfig, load_config
from vgrd.config.resolved import Resolved, changed_keys, load_resolved, save_resolved
from vgrd.config.setup import cell_bounds, cell_facts
from vgrd.model import Bounds
from vgrd.solving.differences import fact_differences

OWN = "limits = { cone_deg = 20, highest_mm = [1, 2, 3] }\n[[object.targets]]\nid = 2"
LIMITS = """
[limits]
lowest_mm = [250, -300, 55]
highest_mm = [750, 300, 500]
outer_radius_mm = 800
step_deg = 90
"""


def loaded(text: str, folder: Path) -> CellConfig:
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return load_config(path)


def test_a_file_without_limits_has_the_careful_defaults(tmp_path: Path) -> None:
    bounds = cell_bounds(loaded(GOOD, tmp_path))
    assert not bounds.targets
    default = bounds.of("p1")
    assert (default.margin_mm, math.degrees(default.cone_rad)) == pytest.approx((10.0, 60.0))
    assert default.highest.tolist() == [math.inf] * 3
    assert default.step_mm == default.step_rad == default.outer_radius_mm == math.inf


def test_keys_of_a_target_count_before_those_of_the_cell(tmp_path: Path) -> None:
    text = GOOD.replace("[[object.targets]]\nid = 2", OWN) + LIMITS
    bounds = cell_bounds(loaded(text, tmp_path))
    own, other = bounds.of("p1"), bounds.of("p2")
    assert (own.highest.tolist(), other.highest.tolist()) == ([1, 2, 3], [750, 300, 500])
    assert math.degrees(own.cone_rad) == pytest.approx(20)
    assert other.cone_rad == Bounds().cone_rad
    assert own.lowest.tolist() == other.lowest.tolist() == [250, -300, 55]
    assert own.step_rad == other.step_rad == pytest.approx(math.pi / 2)
    assert own.outer_radius_mm == 800


def test_processes_read_the_same_limits_from_the_resolved_file(tmp_path: Path) -> None:
    text = GOOD.replace("[[object.targets]]\nid = 2", OWN) + LIMITS
    config = loaded(text, tmp_path)
    again = load_resolved(save_resolved(Resolved(config, "cell.toml", 1.0), tmp_path)).config
    here, there = cell_bounds(config), cell_bounds(again)
    for name in ("p1", "p2"):
        assert here.of(name).highest.tolist() == there.of(name).highest.tolist()
        assert here.of(name).cone_rad == there.of(name).cone_rad
    assert there.targets.keys() == {"p1"}


def test_other_limits_are_told_as_changed_and_are_no_other_cell(tmp_path: Path) -> None:
    old, new = loaded(GOOD, tmp_path), loaded(GOOD + LIMITS, tmp_path)
    changed = changed_keys(Resolved(old, "", 0.0), Resolved(new, "", 0.0))
    assert set(changed) == {
        f"limits.{key}" for key in ("lowest_mm", "highest_mm", "outer_radius_mm", "step_deg")
    }
    assert fact_differences(cell_facts(old), cell_facts(new)) == []


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("lowest_mm = [1, 2]", "limits.lowest_mm"),
        (
            "lowest_mm = [0, 9, 0]\nhighest_mm = [1, 1, 1]",
            "lowest_mm is not below highest_mm in y",
        ),
        ("inner_radius_mm = 9\nouter_radius_mm = 8", "inner_radius_mm is not below"),
        ("cone_deg = 181", "limits.cone_deg"),
        ("volume_margin_mm = 0", "limits.volume_margin_mm"),
        ("lowest_mm = [nan, 0, 0]", "limits.lowest_mm"),
        ("step_m = 0.1", "step_mm"),
    ],
)
def test_faults_are_named(tmp_path: Path, line: str, told: str) -> None:
    assert told in "\n".join(faults(f"{GOOD}\n[limits]\n{line}\n", tmp_path))
