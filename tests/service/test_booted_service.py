"""The shipped units under a real systemd: port 502 by the socket unit, the whole work, every restart."""

import os
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from fakes.booted import Booted, Unbootable
from fakes.confined import (
    PROJECT,
    BootedDaemon,
    drop_in,
    render,
    take_folders_from_unit,
)
from fakes.session import work

from fakes.cell import FakeCell, free_port
from fakes.raw_modbus import RawModbus
from fakes.testing import free_loopback
from fakes.world import World

pytestmark = [pytest.mark.system, pytest.mark.timeout(900)]

PORT = 502


class Place(NamedTuple):
    """A systemd with both units of a fake cell, nothing started."""

    systemd: Booted
    daemon: BootedDaemon
    cell: FakeCell
    host: str


@pytest.fixture(scope="module", autouse=True)
def _able() -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can start a systemd of its own")
    for tool in ("/lib/systemd/systemd", "nsenter", "systemctl"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")


@pytest.fixture
def place(world: World, compiled: Path, tmp_path: Path) -> Iterator[Place]:
    folder = tmp_path
    host = free_loopback(PORT)
    (folder / "cell").mkdir()
    log = folder / "cell" / "vgrd.log"
    with FakeCell(world, folder / "cell", free_port()) as cell:
        take_folders_from_unit(cell.cell_file)
        text = cell.cell_file.read_text()
        text = text.replace('host = "127.0.0.1"', f'host = "{host}"')
        cell.cell_file.write_text(text.replace(f"port = {cell.port}", f"port = {PORT}"))
        socket_unit = (PROJECT / "config" / "vgrd.socket").read_text().replace("@HOST@", host)
        units = {
            "vgrd.service": render(cell.cell_file, folder / "vgrd.service").read_text(),
            "vgrd.service.d/test.conf": drop_in(log, cell.folder),
            "vgrd.socket": socket_unit,
        }
        booted = Booted(folder, units, [cell.folder])
        try:
            booted.boot()
        except Unbootable as error:
            pytest.skip(f"no systemd can be started here: {error}")
        with booted:
            shutil.copytree(compiled, booted.path("/var/cache/private/vgrd"))
            yield Place(booted, BootedDaemon(booted, cell.cell_file, log), cell, host)


def show(place: Place, name: str, unit: str = "vgrd.service") -> str:
    return place.systemd.ask("show", "--value", "--property", name, unit).strip()


def main_pid(place: Place) -> int:
    return place.systemd.pid_out_here(int(show(place, "MainPID")))


def test_the_daemon_does_its_whole_work_at_port_502_under_systemd(
    place, world, record_property
) -> None:
    assert place.systemd.ask("start", "vgrd.socket") == ""
    start = time.monotonic()
    with place.daemon as daemon:
        record_property("start_s", round(time.monotonic() - start, 1))
        assert show(place, "ActiveState") == "active"
        assert "robot ok" in show(place, "StatusText")
        work(world, daemon, place.host, PORT)
        gate = main_pid(place)
        os.kill(gate, signal.SIGKILL)
        with RawModbus(place.host, PORT, timeout_s=30.0) as robot:  # waits, and is not refused
            assert len(robot.read(100, 68)) == 136
        daemon.wait_until(lambda status: bool(status["serving"]), timeout_s=60.0)
        assert main_pid(place) != gate
        assert show(place, "NRestarts") == "1"
        for inside in ("/run/vgrd", "/var/lib/private/vgrd"):
            top = place.systemd.path(inside)
            lax = [path for path in (top, *top.rglob("*")) if path.lstat().st_mode & 0o077]
            assert lax == []
    assert show(place, "ActiveState") == "inactive"
    assert show(place, "Result") == "success"
    log = daemon.log.read_text()
    assert '"event": "niceness_refused"' in log
    assert "Traceback" not in log
    record_property("took_s", round(time.monotonic() - start, 1))
