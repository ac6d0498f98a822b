"""`vgrd backup` and `vgrd restore` as people call them: what they print, and that no daemon may run meanwhile."""

import os
from pathlib import Path

import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from tests.cli.conftest import vgrd  # noqa: F401  (a fixture)
from vgrd.errors import AlreadyRunning
from vgrd.gate.gate import LOCK_FILE, lock
from vgrd.store.calibrations import CalibrationStore

EXAMPLE = Path(__file__).parents[2] / "config" / "cell.example.toml"


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    path.write_text(EXAMPLE.read_text())
    store = CalibrationStore(tmp_path / "state", ManualClock())
    store.activate(store.save(Samples(1).calibration()), "anna")
    return path


def test_a_backup_and_its_way_back_are_told(vgrd, cell_file, tmp_path) -> None:  # noqa: F811
    told = vgrd("backup", tmp_path / "a.tar", "--config", cell_file, "--json", "-").result
    assert told["files"] == 5  # calibration, CURRENT, activations, cell file, manifest
    store = CalibrationStore(tmp_path / "state")
    store.activate(store.save(Samples(2).calibration()), "anna")
    refused = vgrd("restore", tmp_path / "a.tar", "--config", cell_file)
    assert refused.code == os.EX_DATAERR
    assert "--replace" in refused.err
    told = vgrd(
        "restore", tmp_path / "a.tar", "--replace", "--config", cell_file, "--json", "-"
    ).result
    assert told["calibration"] == store.current_id() == "cal-000001"
    assert Path(told["set_aside"], "calibrations", "cal-000002.json").exists()


def test_nothing_is_restored_under_a_running_daemon(vgrd, cell_file, tmp_path) -> None:  # noqa: F811
    vgrd("backup", tmp_path / "a.tar", "--config", cell_file)
    (tmp_path / "run").mkdir()
    held = lock(tmp_path / "run")
    try:
        refused = vgrd("restore", tmp_path / "a.tar", "--replace", "--config", cell_file)
    finally:
        os.close(held)
    assert refused.code == AlreadyRunning.exit_code
    assert "stop it" in refused.err
    assert (tmp_path / "run" / LOCK_FILE).exists()
    assert vgrd("restore", tmp_path / "a.tar", "--config", cell_file).code == 0


def test_without_a_name_the_cell_file_of_the_service_is_meant(
    vgrd,  # noqa: F811
    cell_file,
    tmp_path,
    monkeypatch,
) -> None:
    monkeypatch.delenv("VGRD_CONFIG", raising=False)
    monkeypatch.setattr("vgrd.commands.asking._INSTALLED", tmp_path / "nowhere.toml")
    refused = vgrd("backup", tmp_path / "a.tar")
    assert refused.code == os.EX_DATAERR
    assert "--config CELL.toml" in refused.err
    monkeypatch.setattr("vgrd.commands.asking._INSTALLED", cell_file)
    assert vgrd("backup", tmp_path / "a.tar").code == 0


def test_a_cell_file_that_is_closed_to_somebody_names_the_remedy(
    vgrd,  # noqa: F811
    cell_file,
    monkeypatch,
) -> None:
    def refused(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    cell_file.chmod(0o640)
    monkeypatch.setattr("os.access", lambda *_, **__: False)
    monkeypatch.setattr(Path, "read_bytes", refused)
    told = vgrd("status", "--config", cell_file)
    assert told.code != 0
    assert "adduser NAME" in " ".join(told.err.split())
