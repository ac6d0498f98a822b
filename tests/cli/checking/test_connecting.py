"""Drivers that hang, die or refuse are told by `vgrd check --connect`, and keep nobody from asking the next."""

import os
from pathlib import Path

import pytest

from vgrd.checking.connecting import connect
from vgrd.config.cell_file import CellConfig, load_config

LIMIT_S = 600.0  # of a child, on a machine with far more to do than it can
DRIVERS = {
    "hanging": "import time\ndef open(settings, clock):\n    time.sleep(3600)\n",
    "dying": "import os\ndef open(settings, clock):\n    os.abort()\n",
    "raising": (
        "from vgrd.errors import DeviceRefused\n"
        "def open(settings, clock):\n    raise DeviceRefused('wrong model')\n"
    ),
}


@pytest.fixture
def strange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CellConfig:
    """A cell file whose devices have drivers of the folder `strange`."""
    folder = tmp_path / "strange"
    folder.mkdir()
    for name, text in DRIVERS.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    paths = [str(tmp_path), str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in paths if path))
    example = Path(__file__).parents[3] / "config" / "cell.example.toml"
    return load_config(example)


def with_drivers(config: CellConfig, robot: str, camera: str) -> CellConfig:
    sections = {
        "robot": config.robot.model_copy(update={"driver": f"strange.{robot}"}),
        "camera": config.camera.model_copy(update={"driver": f"strange.{camera}"}),
    }
    return config.model_copy(update=sections)


def test_a_driver_that_dies_or_refuses_is_told(strange: CellConfig) -> None:
    connected = connect(with_drivers(strange, "dying", "raising"), LIMIT_S)
    assert connected.told == {}
    assert connected.picture is None
    assert "died with -6 when it opened the robot" in str(connected.troubles["robot"])
    assert type(connected.troubles["camera"]).__name__ == "DeviceRefused"
    assert str(connected.troubles["camera"]) == "wrong model"


def test_a_driver_that_hangs_is_killed_and_told(strange: CellConfig) -> None:
    connected = connect(with_drivers(strange, "hanging", "hanging"), 1.0)
    for kind in ("robot", "camera"):
        assert f"the {kind} said nothing within 1 s" in str(connected.troubles[kind])
        assert connected.troubles[kind].exit_code == 75
