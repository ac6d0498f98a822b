"""`vgrd check --connect` and `vgrd snapshot` on the fakes' real protocols."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fakes.cell.cell import FakeCell
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.world import World
from vgrd.config.cell_file import load_config
from vgrd.orphans import dying_with_us

pytestmark = pytest.mark.system

LIMIT_S = 600.0  # of a command, on a machine with far more to do than it can


def vgrd(*words: object) -> tuple[int, dict[str, Any], str]:
    """Exit code, the result as JSON, what was said beside it."""
    command = [sys.executable, "-m", "vgrd.cli", *map(str, words), "--json", "-"]
    done = subprocess.run(
        dying_with_us(command), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout), done.stderr


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[FakeCell]:
    with FakeCell(World(Layout(), 3), tmp_path / "cell", free_port()) as cell:
        yield cell


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_every_device_is_asked_and_what_is_missing_is_told(cell: FakeCell) -> None:
    change(cell.cell_file, f"id = {cell.world.layout.tag_b.id}\nsize_mm", "id = 77\nsize_mm")
    code, result, _ = vgrd("check", "--connect", cell.cell_file)
    assert code == 0
    robot, sight = result["devices"]["robot"], result["devices"]["sight"]
    true_mm = cell.world.snapshot(0.0).base_from_wrist.translation
    assert robot["flange"]["position_mm"] == pytest.approx(true_mm, abs=0.5)
    tcp_mm = cell.world.arm.wrist_from_tcp.translation
    assert robot["tcp"]["position_mm"] == pytest.approx(tcp_mm, abs=0.01)
    assert robot["at_rest"] == "yes"
    assert robot["running"] is True
    assert sight["size_px"] == list(cell.world.layout.optics.size_px)
    assert sight["tags"]["a"]["seen"] is True
    assert sight["tags"]["a"]["side_px"] > 100
    assert sight["tags"]["b"]["seen"] is False
    assert "sees 36h11 ids 0, 1; the cell file wants 36h11 id 77 as tag B" in sight["remarks"]
    assert not Path(result["runtime_dir"]).exists()


def test_a_robot_that_is_not_there_keeps_nobody_from_asking_the_camera(cell: FakeCell) -> None:
    config = load_config(cell.cell_file)
    host = config.robot.settings["host"]
    change(cell.cell_file, f"host = {host!r}", "host = '127.9.8.7'")
    change(cell.cell_file, f"size_px = {config.camera.size_px}", "size_px = [4000, 3036]")
    code, result, told = vgrd("check", "--connect", cell.cell_file)
    assert code == 75
    assert result["ok"] is False
    assert "127.9.8.7" in result["devices"]["robot"]["trouble"]
    assert "127.9.8.7" in told
    (remark,) = result["devices"]["sight"]["remarks"]
    assert "has 4024 x 3036 px, the cell file says 4000 x 3036: correct [camera] size_px" in remark


def test_where_a_daemon_runs_it_is_asked_and_shows_its_picture(live, tmp_path: Path) -> None:
    file = live.cell.fake.cell_file
    code, result, _ = vgrd("check", "--connect", file)
    assert code == 0
    assert result["devices"]["asked"] == f"the daemon, process {live.daemon.process.pid}"
    status = live.daemon.call("status")
    robot = result["devices"]["robot"]
    assert robot["flange"]["position_mm"] == pytest.approx(
        status["flange"]["position_mm"], abs=0.5
    )
    tcp_mm = live.cell.wrist_from_tcp.translation
    assert status["tcp"]["position_mm"] == pytest.approx(tcp_mm, abs=0.01)
    out = tmp_path / "seen.png"
    code, sight, _ = vgrd("snapshot", "--config", file, "--out", out)
    assert code == 0
    for name in ("a", "b"):
        of_daemon, seen = status["tags"][name], sight["tags"][name]
        assert seen["wanted"] == of_daemon["wanted"]
        assert seen["side_px"] == pytest.approx(of_daemon["side_px"], rel=0.05)
    drawn = cv2.imread(str(out))
    assert list(drawn.shape[1::-1]) == sight["size_px"]
    assert np.ptp(drawn.astype(int), axis=2).max() > 50  # what is drawn has colours
    plain = tmp_path / "plain.png"
    vgrd("snapshot", "--config", file, "--plain", "--out", plain)
    assert np.ptp(cv2.imread(str(plain)).astype(int), axis=2).max() == 0
    log = live.daemon.log.read_text(encoding="utf-8")
    assert f"robot ok, camera ok, cell ok, serving on 127.0.0.1:{live.cell.port}" in log
