"""`vgrd check` and `vgrd drivers`: what they print, and their exit codes."""

import json
from pathlib import Path

import pytest

from drivers.catalogue import DRIVERS
from fakes.cell.cell import cell_text
from fakes.cell.rehearsal import NO_ROBOT
from fakes.cell.robot_link import Driver
from fakes.world.layout import Layout

CAMERA = Driver("fakes.camera.pylon_camera", {})  # needs no library that a machine may lack


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    text = cell_text(Layout(), robot=NO_ROBOT, camera=CAMERA, port=1502)
    path.write_text(text, encoding="utf-8")
    return path


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_what_is_only_odd_is_a_warning_and_the_file_is_good(vgrd, cell_file) -> None:
    change(cell_file, "lateral_sigma_mm = 0.233", "lateral_sigma_mm = 0.000233")
    done = vgrd("check", cell_file)
    assert done.code == 0
    assert "is good" in done.out
    assert "touch.lateral_sigma_mm: 0.000233 mm, no hand touches so well" in done.out
    result = vgrd("check", cell_file, "--json", "-").result
    (warning,) = result["warnings"]
    lines = cell_file.read_text(encoding="utf-8").splitlines()
    assert lines[warning["line"] - 1] == "lateral_sigma_mm = 0.000233"


def test_faults_end_with_78_and_warnings_are_told_beside_them(vgrd, cell_file) -> None:
    change(cell_file, "lateral_sigma_mm = 0.233", "lateral_sigma_mm = 0.000233")
    change(cell_file, 'driver = "ur_rtde"', 'driver = "fanuc"')
    done = vgrd("check", cell_file, "--json", "-")
    assert done.code == 78
    assert "robot.driver: there is no driver 'fanuc'" in done.err
    assert "warning: line" in done.err
    told = json.loads(done.out)
    assert told["ok"] is False
    assert [fault["key"] for fault in told["faults"]] == ["robot.driver"]
    assert [one["key"] for one in told["warnings"]] == ["touch.lateral_sigma_mm"]
    assert vgrd("check", cell_file).out == ""


def test_check_writes_nothing(vgrd, cell_file) -> None:
    vgrd("check", cell_file)
    assert [path.name for path in cell_file.parent.iterdir()] == ["cell.toml"]


def test_the_drivers_are_told_with_their_settings(vgrd) -> None:
    result = vgrd("drivers", "--json", "-").result
    assert [driver["name"] for driver in result["drivers"]] == list(DRIVERS)
    (ur,) = vgrd("drivers", "ur_rtde", "--json", "-").result["drivers"]
    (host, *_) = ur["settings"]
    assert host == {
        "key": "host",
        "type": "str",
        "required": True,
        "default": None,
        "meaning": "address of the controller",
    }
    out = " ".join(vgrd("drivers", "pylon").out.split())
    assert "pylon (camera): Basler cameras" in out
    assert "exposure_ms" in out
    done = vgrd("drivers", "basler")
    assert done.code == 65
    assert "there is no driver 'basler'" in done.err
