"""`vgrd calibrations`: what there is, what serves, what did; and what `activate` says of others."""

from dataclasses import replace
from pathlib import Path

import pytest

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.samples import Samples
from fakes.world.world import CellNoise, World
from vgrd.clock import SystemClock
from vgrd.errors import InputError
from vgrd.model import Finding, Verdict
from vgrd.store.calibrations import CalibrationStore


@pytest.fixture
def store(tmp_path: Path) -> CalibrationStore:
    """Two calibrations of the cell in tmp_path, the second was tried and taken back."""
    facts = facts_of(World(Layout(), 5, CellNoise.none()), tmp_path)
    store = CalibrationStore(tmp_path / "state", SystemClock())
    good = replace(
        Samples(1).calibration(), facts=facts, verdict=Verdict(), created_unix_s=1_700_000_000.0
    )
    rejected = Verdict((Finding("targets_swapped", "two targets are swapped", fatal=True),))
    store.save(good)
    store.save(replace(good, verdict=rejected, residuals={"predicted_u95_mm": 0.4}))
    for name in ("cal-000001", "cal-000002", "cal-000001"):
        store.activate(name, by="ann")
    return store


def test_calibrations_are_listed_with_date_verdict_error_and_history(vgrd, store, tmp_path):
    result = vgrd("calibrations", "--config", tmp_path / "cell.toml", "--json", "-").result
    first, second = result["calibrations"]
    assert (first["id"], first["active"], first["verdict"]) == ("cal-000001", True, "good")
    assert first["made"].startswith("2023-11-1")
    assert second["active"] is False
    assert second["verdict"] == "rejected: targets_swapped"
    assert second["u95_mm"] == 0.4
    assert [one["calibration"] for one in result["activations"]] == [
        "cal-000001",
        "cal-000002",
        "cal-000001",
    ]
    assert [one["by"] for one in result["activations"]] == ["ann"] * 3
    shown = vgrd("calibrations", "--config", tmp_path / "cell.toml").out
    assert "cal-000002" in shown
    assert "activations" in shown


def test_a_damaged_calibration_is_told_in_its_place(vgrd, store, tmp_path):
    path = store.path / "cal-000002.json"
    path.write_text(path.read_text(encoding="utf-8").replace("0.4", "0.5", 1), encoding="utf-8")
    result = vgrd("calibrations", "--config", tmp_path / "cell.toml", "--json", "-").result
    first, second = result["calibrations"]
    assert first["verdict"] == "good"
    assert "checksum" in second["verdict"]


def test_where_there_are_none_that_is_told(vgrd, tmp_path):
    facts_of(World(Layout(), 5, CellNoise.none()), tmp_path)
    result = vgrd("calibrations", "--config", tmp_path / "cell.toml", "--json", "-").result
    assert result["calibrations"] == []
    assert result["active"] is None
    assert vgrd("calibrations").code == 65


@pytest.mark.parametrize("name", ["cal-999", "cal-000003", "the last one"])
def test_an_id_that_is_not_there_is_answered_with_those_that_are(store, name):
    with pytest.raises(InputError, match="there are: cal-000001, cal-000002"):
        store.activate(name)
