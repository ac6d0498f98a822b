"""`vgrd check`: mistakes that people make in a cell file, each named at its line with key and remedy."""

import copy
import dataclasses
import json
import math
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.catalogue import DRIVERS
from fakes.cell.cell import cell_text
from fakes.cell.rehearsal import NO_CAMERA, NO_ROBOT
from fakes.cell.robot_link import RobotLink
from fakes.world.cells import CELLS, CellKind
from vgrd.checking.cell_check import CheckedCell, check_cell

ROOT = Path(__file__).parents[2]
MARK = "# <<"  # of the line at which a mistake is to be told


class Mistake(NamedTuple):
    """What a user writes instead of `old`, and the key and words of what is to be said; a fault or a doubt."""

    old: str
    new: str
    key: str
    words: str
    is_fault: bool = True


AWAY = 'host = "192.0.2.77"  # <<\nallow = ["192.168.1.10"]'  # of TEST-NET-1: no machine has it
HOST = 'host = "192.168.1.10"'
SIZE_A = 'family = "36h11"\nid = 0\nsize_mm = 25.0'
SERVED = 'host = "127.0.0.1"\nport = 1502\nallow = ["127.0.0.1"]'
UR_TABLE = 'driver = "ur_rtde"\nid = "UR5e 20225500001"\nsigma_mm = 0.1\n[robot.settings]'
PAGE_FILES = 'certificate = "a.pem"\nkey = "a.key"\npassword_file = "password"\n'
LAST_TWO = """[[object.targets]]
id = 3
name = "P3"
point_mm = [-30.0, 51.962, 0.0]
[[object.targets]]
id = 4
name = "P4"
point_mm = [-60.0, 0.0, 0.0]
"""
MODBUS = 'driver = "modbus_robot"'
UR = 'driver = "ur_rtde"'
CASES = {
    # drivers and their settings
    "no such driver": Mistake(
        UR, 'driver = "fanuc"  # <<', "robot.driver", "ur_rtde (Universal Robots"
    ),
    "misspelt driver": Mistake(
        UR, 'driver = "ur_rtd"  # <<', "robot.driver", "did you mean 'ur_rtde'?"
    ),
    "no such camera": Mistake(
        'driver = "aravis"', 'driver = "basler"  # <<', "camera.driver", "pylon (Basler cameras"
    ),
    "robot as camera": Mistake(
        'driver = "aravis"',
        'driver = "ur_rtde"  # <<',
        "camera.driver",
        "is a driver of a robot, not of a camera. The drivers of a camera there are: aravis",
    ),
    "no such module": Mistake(
        UR, 'driver = "acme.robots"  # <<', "robot.driver", "there is no driver 'acme.robots'"
    ),
    "misspelt pedal": Mistake(
        "[touch]",
        '[pedal]\ndriver = "seriel_pedal"  # <<\n[touch]',
        "pedal.driver",
        "did you mean 'serial_pedal'?",
    ),
    "setting without a unit": Mistake(
        "exposure_ms = 8.0",
        "exposure_us = 8000  # <<",
        "camera.settings.exposure_us",
        "did you mean 'exposure_ms'?",
    ),
    "missing setting": Mistake(
        f"[robot.settings]\n{HOST}",
        "[robot.settings]  # <<",
        "robot.settings.host",
        "is missing, add it",
    ),
    "missing settings": Mistake(
        f"[robot]\n{UR_TABLE}\n{HOST}",
        f"[robot]  # <<\n{UR}",
        "robot.settings.host",
        "is missing, add it",
    ),
    "setting as a text": Mistake(
        HOST,
        f'{HOST}\nfrequency_hz = "125"  # <<',
        "robot.settings.frequency_hz",
        "expected float, got '125'",
    ),
    "setting out of range": Mistake(
        HOST,
        f"{HOST}\nfrequency_hz = 5000  # <<",
        "robot.settings.frequency_hz",
        "must be in 5 .. 500",
    ),
    "exposure in us": Mistake(
        "exposure_ms = 8.0",
        "exposure_ms = 8000.0  # <<",
        "camera.settings.exposure_ms",
        "in microseconds? Write 8",
    ),
    "unknown pixel format": Mistake(
        "exposure_ms = 8.0",
        'pixel_format = "BayerRG8"  # <<',
        "camera.settings.pixel_format",
        "take one of Mono8",
    ),
    "deep pixels in 8 bits": Mistake(
        "exposure_ms = 8.0",
        'pixel_format = "Mono12"  # <<',
        "camera.settings.pixel_format",
        "write bits = 16",
    ),
    "no such profile": Mistake(
        UR_TABLE,
        f'{MODBUS}\n[robot.settings]\nprofile = "fanuc"  # <<',
        "robot.settings.profile",
        "no such robot profile; known: delta",
    ),
    "no such profile file": Mistake(
        UR_TABLE,
        f'{MODBUS}\n[robot.settings]\nprofile = "/etc/vgrd/nowhere.toml"  # <<',
        "robot.settings.profile",
        "/etc/vgrd/nowhere.toml: no such robot profile",
    ),
    "profile without offset": Mistake(
        UR_TABLE,
        f'{MODBUS}\n[robot.settings]  # <<\nprofile = "jaka"',
        "robot.settings.tcp_offset",
        "give tcp_offset",
    ),
    "neither host nor serial port": Mistake(
        f"{UR_TABLE}\n{HOST}",
        f'{MODBUS}\n[robot.settings]  # <<\nprofile = "ur"',
        "robot.settings.host",
        "give host (Modbus TCP) or serial_port",
    ),
    "serial port that is not there": Mistake(
        f"{UR_TABLE}\n{HOST}",
        f'{MODBUS}\n[robot.settings]\nprofile = "ur"\nserial_port = "/dev/ttyUSB99"  # <<',
        "robot.settings.serial_port",
        "plug it in",
        is_fault=False,
    ),
    "offset in metres": Mistake(
        UR_TABLE,
        f'{MODBUS}\n[robot.settings]\nprofile = "jaka"\ntcp_offset = [0, 0, 0.15, 0, 0, 0]  # <<',
        "robot.settings.tcp_offset",
        "in metres? Write them in mm",
        is_fault=False,
    ),
    # hosts and places
    "no address": Mistake(
        HOST, 'host = "192.168.1.300"  # <<', "robot.settings.host", "four numbers of at most 255"
    ),
    "a web page": Mistake(
        HOST, 'host = "http://192.168.1.10/"  # <<', "robot.settings.host", "the address alone"
    ),
    "host with port": Mistake(
        HOST, 'host = "192.168.1.10:30004"  # <<', "robot.settings.host", "holds a port"
    ),
    "camera's address": Mistake(
        'address = "192.168.2.10"',
        'address = "192.168.210"  # <<',
        "camera.settings.address",
        "is no IP address",
    ),
    "name of a robot": Mistake(
        'allow = ["127.0.0.1"]',
        'allow = ["my-robot"]  # <<',
        "serving.allow.#1",
        "write the robot's address, such as",
    ),
    "network with a host": Mistake(
        'allow = ["127.0.0.1"]',
        'allow = ["127.0.0.1",\n "127.1.1.10/24"]  # <<',
        "serving.allow.#2",
        "did you mean '127.1.1.0/24'",
    ),
    "everybody": Mistake(
        SERVED,
        'host = "0.0.0.0"\nallow = ["0.0.0.0/0"]  # <<',
        "serving.allow.#1",
        "write the robot's address",
        is_fault=False,
    ),
    "robot not listed": Mistake(
        SERVED,
        'host = "0.0.0.0"\nallow = ["192.168.1.11"]  # <<',
        "serving.allow",
        "the robot at 192.168.1.10 is not listed",
        is_fault=False,
    ),
    "served to this machine only": Mistake(
        SERVED,
        'host = "127.0.0.1"  # <<\nallow = ["192.168.1.10"] ',
        "serving.host",
        "is reached from this machine only",
        is_fault=False,
    ),
    "host of another machine": Mistake(
        SERVED,
        AWAY,
        "serving.host",
        "this machine does not have the address",
    ),
    "port of the system": Mistake(
        "port = 1502", "port = 502  # <<", "serving.port", "take 1502", is_fault=False
    ),
    "line port of the system": Mistake(
        "port = 1502",
        "port = 1502\nline_port = 503  # <<",
        "serving.line_port",
        "take 1503",
        is_fault=False,
    ),
    "one port for both": Mistake(
        "port = 1502",
        "port = 1502\nline_port = 1502  # <<",
        "serving.line_port",
        "1502 is [serving] port already: give this one another, such as 1503",
    ),
    "port of the registers for metrics": Mistake(
        "[tool]",
        "[metrics]\nport = 1502  # <<\n[tool]",
        "metrics.port",
        "is [serving] port already",
    ),
    "one port for metrics and page": Mistake(
        "[tool]",
        "[metrics]\nport = 9502\n[page]\nport = 9502  # <<\n[tool]",
        "page.port",
        "is [metrics] port already",
    ),
    "page for everybody": Mistake(
        "[tool]",
        '[page]\nhost = "0.0.0.0"  # <<\nport = 8080\n[tool]',
        "page.host",
        "needs certificate, key, password_file too",
    ),
    "page for everybody without a password": Mistake(
        "[tool]",
        '[page]\nhost = "192.168.1.2"  # <<\ncertificate = "a.pem"\nkey = "a.key"\n[tool]',
        "page.host",
        "needs password_file too",
    ),
    "page with half of its files": Mistake(
        "[tool]",
        '[page]\nkey = "a.key"  # <<\n[tool]',
        "page.key",
        "needs certificate, password_file beside it",
    ),
    "page at a name": Mistake(
        "[tool]",
        '[page]\nhost = "cell1.plant.lan"  # <<\n[tool]',
        "page.host",
        "names that browsers may call go into names",
    ),
    "page at all addresses under no name": Mistake(
        "[tool]",
        f'[page]\nhost = "0.0.0.0"  # <<\n{PAGE_FILES}[tool]',
        "page.host",
        "tell in names",
    ),
    "page without its password file": Mistake(
        "[tool]",
        '[page]\ncertificate = "cell.toml"\nkey = "cell.toml"\npassword_file = "none"  # <<\n[tool]',
        "page.password_file",
        "make it by `vgrd page-password FILE`",
        is_fault=False,
    ),
    "page under an address of the browser": Mistake(
        "[tool]",
        '[page]\nnames = ["https://cell1"]  # <<\n[tool]',
        "page.names.#1",
        "is no host name, such as cell1.plant.lan",
    ),
    "port that is none": Mistake(
        "port = 1502", "port = 70000  # <<", "serving.port", "less than or equal to 65535"
    ),
    "folder of the kernel": Mistake(
        'state_dir = "state"',
        'state_dir = "/proc/vgrd"  # <<',
        "cell.state_dir",
        "name a folder that the daemon's user may write",
    ),
    "file for a folder": Mistake(
        'state_dir = "state"',
        'state_dir = "cell.toml"  # <<',
        "cell.state_dir",
        "is no folder",
    ),
    "folder of somebody else": Mistake(
        'state_dir = "state"',
        'state_dir = "full"  # <<',
        "cell.state_dir",
        "holds what is not the daemon's",
    ),
    "path too long for a socket": Mistake(
        'runtime_dir = "run"',
        f'runtime_dir = "{"run" * 40}"  # <<',
        "cell.runtime_dir",
        "name a shorter path",
    ),
    "no such group": Mistake(
        'runtime_dir = "run"',
        'runtime_dir = "run"\ngroup = "nobodys-group"  # <<',
        "cell.group",
        "groupadd --system nobodys-group",
    ),
    # units
    "tag in metres": Mistake(
        SIZE_A,
        'family = "36h11"\nid = 0\nsize_mm = 0.025  # <<',
        "tags.a.size_mm",
        "in metres? Write 25",
    ),
    "tag in centimetres": Mistake(
        SIZE_A,
        'family = "36h11"\nid = 0\nsize_mm = 2.5  # <<',
        "tags.a.size_mm",
        "did the decimal point slip?",
        is_fault=False,
    ),
    "touch in metres": Mistake(
        "lateral_sigma_mm = 0.25",
        "lateral_sigma_mm = 0.00025  # <<",
        "touch.lateral_sigma_mm",
        "in metres? Write 0.25",
        is_fault=False,
    ),
    "arm in metres": Mistake(
        "sigma_mm = 0.1\n",
        "sigma_mm = 0.0001  # <<\n",
        "robot.sigma_mm",
        "in metres? Write 0.1",
        is_fault=False,
    ),
    "angles in radians": Mistake(
        "point_mm = [-30.0, 51.962, 0.0]",
        "point_mm = [-30.0, 51.962, 0.0]\nwork_rotvec_deg = [3.1416, 0, 0]  # <<",
        "object.targets.P3.work_rotvec_deg",
        "in degrees it is [180.0, 0.0, 0.0]",
        is_fault=False,
    ),
    "hole in metres": Mistake(
        "point_mm = [-30.0, 51.962, 0.0]",
        "point_mm = [-30.0, 51.962, 0.0]\nhole_diameter_mm = 0.006  # <<",
        "object.targets.P3.hole_diameter_mm",
        "in metres? Write 6",
        is_fault=False,
    ),
    "key with another unit": Mistake(
        "axial_sigma_mm = 0.25",
        "axial_sigma_m = 0.00025  # <<",
        "touch.axial_sigma_m",
        "did you mean 'axial_sigma_mm'?",
    ),
    # camera
    "matrix of nine": Mistake(
        "matrix = [6486.0, 6486.0, 2012.0, 1518.0]",
        "matrix = [6486.0, 0.0, 2012.0, 0.0, 6486.0, 1518.0, 0.0, 0.0, 1.0]  # <<",
        "camera.matrix",
        "write [fx, fy, cx, cy], here [6486.0, 6486.0, 2012.0, 1518.0]",
    ),
    "matrix of three rows": Mistake(
        "matrix = [6486.0, 6486.0, 2012.0, 1518.0]",
        "matrix = [  # <<\n[6486.0, 0, 2012.0],\n[0, 6486.0, 1518.0],\n[0, 0, 1]]",
        "camera.matrix",
        "here [6486.0, 6486.0, 2012.0, 1518.0]",
    ),
    "matrix in mm": Mistake(
        "matrix = [6486.0, 6486.0, 2012.0, 1518.0]",
        "matrix = [12.0, 12.0, 2012.0, 1518.0]  # <<",
        "camera.matrix",
        "Give px",
    ),
    "width and height swapped": Mistake(
        "size_px = [4024, 3036]",
        "size_px = [3036, 4024]  # <<",
        "camera.size_px",
        "Write [4024, 3036] (width, height)",
        is_fault=False,
    ),
    "matrix of another size": Mistake(
        "size_px = [4024, 3036]",
        "size_px = [8048, 6072]",
        "camera.matrix",
        "of another picture size",
        is_fault=False,
    ),
    "distortion cut short": Mistake(
        "distortion = [-0.08, 0.10, 0.0002, -0.0001, 0.0]",
        "distortion = [-0.08, 0.10, 0.0002]  # <<",
        "camera.distortion",
        "give 0, 4, 5 or 8",
    ),
    "camera on the wrist": Mistake(
        'mount = "eye-to-hand"',
        'mount = "eye-in-hand"  # <<',
        "camera.mount",
        "`vgrd solve DATASET` does",
    ),
    "tag ids alike": Mistake(
        "id = 1\nsize_mm = 25.0",
        "id = 0  # <<\nsize_mm = 25.0",
        "tags.b.id",
        "must differ in id",
    ),
    "id that the family lacks": Mistake(
        'family = "36h11"\nid = 1\nsize',
        'family = "16h5"\nid = 41  # <<\nsize',
        "tags.b.id",
        "has the ids 0 to 29",
    ),
    # geometry
    "targets on a line": Mistake(
        "51.962, 0.0]",
        "0.0, 0.0]",
        "object.targets.P4.point_mm",
        "add one that lies beside it",
    ),
    "two targets": Mistake(LAST_TWO, "", "object.targets", "Add targets up to 3"),
    "a target typed twice": Mistake(
        "point_mm = [-60.0, 0.0, 0.0]",
        "point_mm = [60.0, 0.0, 0.0]  # <<",
        "object.targets.P4.point_mm",
        "the same point as that of P1",
        is_fault=False,
    ),
    "targets of one id": Mistake(
        'id = 3\nname = "P3"',
        'id = 2  # <<\nname = "P3"',
        "object.targets.P3.id",
        "each needs its own",
    ),
    "targets of one name": Mistake(
        'name = "P3"',
        'name = "P2"  # <<',
        "object.targets.P2.name",
        "each needs its own",
    ),
    "point in a plane": Mistake(
        "point_mm = [-60.0, 0.0, 0.0]",
        "point_mm = [-60.0, 0.0]  # <<",
        "object.targets.P4.point_mm",
        "at least 3 items",
    ),
    "axis as the tip": Mistake(
        "axis = [0.0, 0.0, 1.0]",
        "axis = [0.0, 0.0, 150.0]  # <<",
        "tool.axis",
        "write [0.0, 0.0, 1.0]",
        is_fault=False,
    ),
    "axis of nothing": Mistake(
        "axis = [0.0, 0.0, 1.0]",
        "axis = [0.0, 0.0, 0.0]  # <<",
        "tool.axis",
        "[0, 0, 1] for a tool along",
    ),
    "no centre": Mistake(
        'motion = "turntable"\ncenter_mm = [0.0, 0.0, 0.0]',
        'motion = "turntable"  # <<',
        "object.motion",
        "set center_mm",
        is_fault=False,
    ),
    "centre of what does not turn": Mistake(
        'motion = "turntable"\ncenter_mm = [0.0, 0.0, 0.0]',
        'motion = "free"\ncenter_mm = [0.0, 0.0, 0.0]  # <<',
        "object.center_mm",
        "leave it out",
        is_fault=False,
    ),
    "clearance as the shaft": Mistake(
        "point_mm = [-30.0, 51.962, 0.0]",
        "point_mm = [-30.0, 51.962, 0.0]\nhole_diameter_mm = 6.0\nclearance_mm = 6.5  # <<",
        "object.targets.P3.clearance_mm",
        "the hole minus that of what goes in",
    ),
    "never degraded": Mistake(
        'policy = "fixed"',
        'policy = "fixed"\nwarn_u95_mm = 2.0  # <<',
        "serving.warn_u95_mm",
        "write half of it",
        is_fault=False,
    ),
    "input of a silent robot": Mistake(
        UR_TABLE,
        f'{MODBUS}\n[pedal]\nrobot_input = 3  # <<\n[robot.settings]\nprofile = "ur"',
        "pedal.robot_input",
        "take a pedal",
    ),
}


@pytest.fixture(autouse=True)
def libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine that has the libraries of all drivers."""
    for name, card in DRIVERS.items():
        monkeypatch.setitem(DRIVERS, name, dataclasses.replace(card, trouble=lambda: ""))


def checked(text: str, folder: Path) -> CheckedCell:
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    (folder / "full").mkdir()
    (folder / "full").chmod(0o755)
    (folder / "full" / "letter.txt").touch()
    return check_cell(path, free_from=1024)


def example() -> str:
    """The example without its comments."""
    text = (ROOT / "config" / "cell.example.toml").read_text(encoding="utf-8")
    lines = (line.split("#")[0].rstrip() for line in text.splitlines())
    return "".join(f"{line}\n" for line in lines if line)


@pytest.mark.parametrize("mistake", CASES.values(), ids=CASES.keys())
def test_each_mistake_is_named_at_its_line_with_key_and_remedy(
    tmp_path: Path, mistake: Mistake
) -> None:
    text = example()
    assert mistake.old in text
    text = text.replace(mistake.old, mistake.new)
    result = checked(text, tmp_path)
    (told,) = result.to_json(faults=mistake.is_fault)  # and nothing that follows from it
    assert not result.to_json(faults=not mistake.is_fault)
    assert told["key"] == mistake.key
    assert mistake.words in str(told["message"])
    marked = [i + 1 for i, line in enumerate(text.splitlines()) if MARK in line]
    assert marked in ([told["line"]], [])
    if not marked:  # what is wrong there is one of several lines that stay as they were
        assert mistake.key.rsplit(".", 1)[1] in text.splitlines()[int(str(told["line"])) - 1]


def test_points_in_metres_are_questioned(tmp_path: Path) -> None:
    points = re.compile(r"(?<=point_mm = )\[.*\]")
    text = points.sub(lambda found: str([x / 1000 for x in json.loads(found[0])]), example())
    result = checked(text, tmp_path)
    assert not result.to_json(faults=True)
    (told,) = result.to_json(faults=False)
    assert told["key"] == "object.targets.P1.point_mm"
    assert told["line"] == text.splitlines().index('name = "P1"') + 2
    assert "in metres? Write them in mm, [60.0, 0.0, 0.0] here" in str(told["message"])


def test_all_mistakes_are_told_at_once_in_the_order_of_their_lines(tmp_path: Path) -> None:
    text = example()
    names = ("folder of the kernel", "no such driver", "setting without a unit", "tag in metres")
    names += ("matrix of nine", "touch in metres", "name of a robot", "targets of one id")
    for name in names:
        assert CASES[name].old in text
        text = text.replace(CASES[name].old, CASES[name].new)
    result = checked(text, tmp_path)
    remarks = result.to_json(faults=True) + result.to_json(faults=False)
    marked = [i + 1 for i, line in enumerate(text.splitlines()) if MARK in line]
    assert len(marked) == len(names)
    assert sorted(int(str(one["line"])) for one in remarks) == marked
    assert {str(one["key"]) for one in remarks} == {CASES[name].key for name in names}
    lines = [int(told.split(":")[0].removeprefix("line ")) for told in result.told(faults=True)]
    assert lines == sorted(lines)


def test_a_library_that_is_missing_is_told_at_the_driver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    card = dataclasses.replace(DRIVERS["aravis"], trouble=lambda: "pip install 'vgrd[cameras]'")
    monkeypatch.setitem(DRIVERS, "aravis", card)
    (told,) = checked(example(), tmp_path).told(faults=True)
    line = example().splitlines().index('driver = "aravis"') + 1
    assert told == f"line {line}: camera.driver: pip install 'vgrd[cameras]'"


def test_a_section_that_is_left_out_is_told_once(tmp_path: Path) -> None:
    text = example().split("[tags.b]", maxsplit=1)
    (told,) = checked(text[0] + "[tool]\n" + text[1].split("[tool]\n")[1], tmp_path).told(
        faults=True
    )
    line = example().splitlines().index("[tags.a]") + 1
    assert told == f"line {line}: tags.b: is missing, add it"


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.toml")), ids=lambda p: p.name)
def test_the_files_that_come_along_give_no_remark(path: Path, tmp_path: Path) -> None:
    assert checked(path.read_text(encoding="utf-8"), tmp_path).remarks == ()


@pytest.mark.parametrize("kind", CELLS.values(), ids=CELLS.keys())
def test_the_files_of_the_fake_cells_give_no_remark(kind: CellKind, tmp_path: Path) -> None:
    world = kind.world(1, speed_mm_s=100.0, turn_rad_s=0.5)
    link = RobotLink.free(kind.controller)
    for robot in (NO_ROBOT, link.driver(world.arm.wrist_from_tcp)):
        folder = tmp_path / robot.name
        folder.mkdir(exist_ok=True)
        text = cell_text(world.layout, robot=robot, camera=NO_CAMERA, port=1502)
        (folder / "cell.toml").write_text(text, encoding="utf-8")
        assert check_cell(folder / "cell.toml", free_from=1024).remarks == ()


def paths_in(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    items: Iterable[tuple[str | int, object]] = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    return [
        found for key, inner in items for found in ((*path, key), *paths_in(inner, (*path, key)))
    ]


def literal(value: object) -> str:
    """A value as TOML, tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {literal(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value)


ODD = st.one_of(
    st.none().map(lambda _: {}),
    st.sampled_from(
        [True, -1, 0, 10**9, 1e-9, -0.0, math.inf, math.nan, "", "x", ".", "..a", "[]"]
    ),
    st.sampled_from(
        ["drivers.catalogue", "/", "\\u00e4", "1.2.3", "::1", "modbus_robot", "pylon"]
    ),
    st.just([]),
    st.just([{}]),
    st.just({"a": {"b": 1}}),
)


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_whatever_stands_in_the_file_is_told_or_taken_and_never_breaks_the_check(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """One to three values of the example replaced by something else."""
    table = tomllib.loads(example())
    for _ in range(data.draw(st.integers(1, 3))):
        *parents, last = data.draw(st.sampled_from(paths_in(table)))
        inner: Any = table
        for key in parents:
            inner = inner[key]
        inner[last] = copy.deepcopy(data.draw(ODD))  # else later draws change what strategies hold
    text = "".join(f"{json.dumps(key)} = {literal(value)}\n" for key, value in table.items())
    path = tmp_path_factory.mktemp("odd") / "cell.toml"
    path.write_text(text, encoding="utf-8")
    result = check_cell(path, free_from=1024)
    lines = len(text.splitlines())
    assert all(1 <= result.places.line(one.where) <= lines for one in result.remarks)
    assert (result.config is None) <= bool(result.told(faults=True))
