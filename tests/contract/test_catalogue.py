"""The catalogue of drivers: every driver is in it, and takes the settings that it names."""

import ast
import importlib
from pathlib import Path

import pytest

import drivers
from drivers.catalogue import DRIVERS
from vgrd.devices.catalogue import driver_cards, is_there, unknown_driver

FOLDER = Path(str(drivers.__file__)).parent


def has_entry(path: Path) -> bool:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return any(isinstance(part, ast.FunctionDef) and part.name == "open" for part in tree.body)


def test_every_driver_is_in_the_catalogue_and_nothing_else_is():
    assert {path.stem for path in FOLDER.glob("*.py") if has_entry(path)} == set(DRIVERS)
    assert driver_cards() is DRIVERS


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_whose_library_is_here_has_its_entry(name):
    if trouble := DRIVERS[name].trouble():
        pytest.skip(trouble)
    assert callable(importlib.import_module(f"drivers.{name}").open)


@pytest.mark.parametrize(("name", "card"), DRIVERS.items(), ids=DRIVERS)
def test_every_setting_has_type_and_meaning_and_defaults_are_good(name, card):
    assert all(setting.type and setting.meaning for setting in card.settings)
    required = {
        s.key: {"host": "192.168.1.10"}.get(s.key, "ur") for s in card.settings if s.is_required
    }
    given = required | ({"host": "192.168.1.10"} if name == "modbus_robot" else {})
    assert not [remark for remark in card.remarks(given) if remark.is_fault]
    (missing, *_) = card.remarks({"nonsense": 1})
    assert missing.key == "nonsense"
    assert "known: " in missing.message


def test_what_is_not_there_is_told_with_what_is():
    assert "did you mean 'pylon'? The drivers of a camera there are: aravis" in unknown_driver(
        "pilon", "camera"
    )
    assert "serial_pedal" in unknown_driver("x")
    assert is_there("fakes.camera.pylon_camera")
    assert not is_there("fakes.camera.nowhere")
    assert not is_there("nowhere.at.all")
