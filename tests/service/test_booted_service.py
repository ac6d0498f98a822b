"""The shipped units under a real systemd: port 502 by the socket unit, the whole work, every restart."""

import contextlib
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from fakes.cell.cell import FakeCell
from fakes.cell.session import work
from fakes.confinement.booted import Booted, Unbootable
from fakes.confinement.confined import (
    PROJECT,
    BootedDaemon,
    drop_in,
    render,
    take_folders_from_unit,
)
from fakes.controllers.raw_modbus import RawModbus
from fakes.testing import free_loopback, free_port
from fakes.world.world import World

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
        socket_unit = (PROJECT / "config" / "vgrd.socket").read_text()
        units = {
            "vgrd.service": render(cell.cell_file, folder / "vgrd.service").read_text(),
            "vgrd.service.d/test.conf": drop_in(log, cell.folder),
            "vgrd.socket": socket_unit.replace("@HOST@", host).replace("@PORT@", str(PORT)),
        }
        booted = Booted(folder, units, [cell.folder])
        try:
            booted.boot()
        except Unbootable as error:
            pytest.skip(f"no systemd can be started here: {error}")
        with booted:
            make_user(booted)
            cache = booted.path("/var/cache/vgrd")
            shutil.copytree(compiled, cache, dirs_exist_ok=True)
            booted.do("chown", "--recursive", "vgrd:vgrd", "/var/cache/vgrd")
            yield Place(booted, BootedDaemon(booted, cell.cell_file, log), cell, host)


def make_user(booted: Booted) -> None:
    """As an installation does."""
    booted.do("groupadd", "--system", "vgrd")
    booted.do("useradd", "--system", "--gid", "vgrd", "--no-create-home", "vgrd")


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
        for inside in ("/run/vgrd", "/var/lib/vgrd"):
            top = place.systemd.path(inside)
            lax = [path for path in (top, *top.rglob("*")) if path.lstat().st_mode & 0o007]
            assert lax == []
    assert show(place, "ActiveState") == "inactive"
    assert show(place, "Result") == "success"
    log = daemon.log.read_text()
    assert '"event": "niceness_refused"' in log
    assert "Traceback" not in log
    record_property("took_s", round(time.monotonic() - start, 1))


def test_a_group_of_operators_commands_and_reads_and_others_do_not(place) -> None:
    systemd = place.systemd
    systemd.do("useradd", "--groups", "vgrd", "anna")
    systemd.do("useradd", "bruno")
    systemd.do("chmod", "755", "/root")  # the interpreter may live there; the namespace's copy
    assert systemd.ask("start", "vgrd.socket") == ""
    with place.daemon as daemon:
        status = [sys.executable, "-m", "vgrd.cli", "status", "--socket", "/run/vgrd/control.sock"]
        may = systemd.run("runuser", "-u", "anna", "--", *status)
        assert may.returncode == 0, may.stderr
        may_not = systemd.run("runuser", "-u", "bruno", "--", *status)
        assert "Permission denied" in may_not.stderr
        assert may_not.returncode != 0
        for inside in ("/run/vgrd", "/var/lib/vgrd"):
            top = systemd.path(inside)
            for path in (top, *top.rglob("*")):
                assert path.lstat().st_mode & 0o007 == 0, path
            assert systemd.run("runuser", "-u", "anna", "--", "ls", inside).returncode == 0
            assert systemd.run("runuser", "-u", "bruno", "--", "ls", inside).returncode != 0
        assert daemon.control.call("status")["camera"] == "ok"


def test_a_faulty_cell_file_is_not_tried_for_ever_by_a_robot_that_polls(place) -> None:
    place.cell.cell_file.write_text("nonsense = 1\n")
    place.systemd.ask("start", "vgrd.socket")
    place.systemd.ask("start", "vgrd.service")
    assert show(place, "ExecMainStatus") == "78"
    assert show(place, "NRestarts") == "0"
    end = time.monotonic() + 300.0
    while show(place, "ActiveState", "vgrd.socket") != "failed":
        assert time.monotonic() < end
        with contextlib.suppress(OSError), RawModbus(place.host, PORT):
            time.sleep(0.2)
    assert show(place, "Result", "vgrd.socket") == "trigger-limit-hit"
    tries = place.daemon.log.read_text().count("unknown key")
    assert 1 < tries <= 6  # the one at its start, and TriggerLimitBurst=
