"""What `vgrd install` makes of a machine, under a real systemd: an update, a way back, a spare computer."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.cell.cell import FakeCell
from fakes.cell.session import calibrate, check_served
from fakes.confinement.booted import Booted, Unbootable
from fakes.confinement.confined import PROJECT, BootedDaemon, take_folders_from_unit
from fakes.controllers.raw_modbus import RawModbus
from fakes.testing import free_loopback, free_port
from fakes.world.world import World
from vgrd.installing.plans import PARTS
from vgrd.installing.steps import Copy
from vgrd.registers import RESPONSE

pytestmark = [pytest.mark.system, pytest.mark.timeout(2400)]

PORT = 502
PYTHON = "/usr/bin/python3"
INSTALL_S = 600.0  # a minute, on a machine that is not busy: packages, and the hot loops compiled
NO_INDEX = ("No matching distribution", "connection", "Temporary failure")  # what pip says then
NEEDED = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))"


@pytest.fixture(scope="module", autouse=True)
def _able() -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can start a systemd of its own")
    for tool in ("/lib/systemd/systemd", "nsenter", "systemctl", "systemd-sysusers", PYTHON):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    if subprocess.run([PYTHON, "-c", NEEDED], check=False, capture_output=True).returncode:
        pytest.skip(f"{PYTHON} is too old, or python3-venv is not installed")


class Machine:
    """A cell computer with nothing of vgrd on it, and a fake cell at its network."""

    def __init__(self, systemd: Booted, cell: FakeCell, host: str, world: World) -> None:
        self.systemd, self.cell, self.host, self.world = systemd, cell, host, world
        self.daemon = BootedDaemon(systemd, cell.cell_file, cell.folder / "vgrd.log")

    def vgrd(self, *words: str) -> subprocess.CompletedProcess[str]:
        """The installed command, as root."""
        return self.systemd.run("/usr/local/bin/vgrd", *words, timeout_s=INSTALL_S)

    def install(self, *words: str) -> subprocess.CompletedProcess[str]:
        """`make install`, from the project or from another source."""
        source = ["env", f"PYTHONPATH={PROJECT}", PYTHON, "-m", "vgrd.installing", "install"]
        return self.systemd.run(*source, *words, timeout_s=INSTALL_S)

    def path(self, inside: str) -> Path:
        return self.systemd.path(inside)

    @property
    def version(self) -> str:
        """The one in use."""
        return self.path("/opt/vgrd/current").readlink().name

    def serves(self) -> tuple[str, bytes]:
        """Wait until it serves, let a robot go there; the calibration, and its number in the registers."""
        self.daemon.wait_until(lambda status: bool(status["serving"]))
        check_served(self.world, self.host, PORT)
        field = next(field for field in RESPONSE.fields if field.name == "CALID")
        with RawModbus(self.host, PORT, timeout_s=30.0) as robot:
            number = robot.read(field.address, field.count)
        return str(self.daemon.control.call("status")["calibration"]), number


@pytest.fixture
def machine(world: World, tmp_path: Path) -> Iterator[Machine]:
    host = free_loopback(PORT)
    with FakeCell(world, tmp_path / "cell", free_port()) as cell:
        take_folders_from_unit(cell.cell_file)
        text = cell.cell_file.read_text().replace('host = "127.0.0.1"', f'host = "{host}"')
        cell.cell_file.write_text(text.replace(f"port = {cell.port}", f"port = {PORT}"))
        log = cell.folder / "vgrd.log"
        drop_in = f"StandardOutput=append:{log}\nStandardError=append:{log}\n"
        seen = (
            f"BindReadOnlyPaths={cell.folder}\n"  # the fake devices' ring, hidden by PrivateTmp=
        )
        units = {"vgrd.service.d/test.conf": f"[Service]\n{drop_in}{seen}"}
        systemd = Booted(tmp_path, units, [cell.folder])
        try:
            systemd.boot()
        except Unbootable as error:
            pytest.skip(f"no systemd can be started here: {error}")
        with systemd:
            yield Machine(systemd, cell, host, world)


def broken_source(folder: Path) -> Path:
    """A source whose daemon ends at its start."""
    for part in PARTS:
        Copy(PROJECT / part, folder / part, ("__pycache__",)).perform()
    gate = folder / "vgrd" / "gate" / "__main__.py"
    gate.write_text("raise SystemExit(1)\n")
    return folder


def test_a_machine_is_installed_updated_put_back_and_cleared_with_its_data(
    machine, world, record_property
) -> None:
    systemd = machine.systemd
    start = time.monotonic()
    done = machine.install("--cell", str(machine.cell.cell_file))
    if done.returncode and any(words in done.stdout + done.stderr for words in NO_INDEX):
        pytest.skip(f"pip finds no packages here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stdout + done.stderr
    record_property("install_s", round(time.monotonic() - start, 1))
    assert machine.version.endswith("-1")
    assert systemd.ask("is-enabled", "vgrd.service", "vgrd.socket").split() == ["enabled"] * 2

    with machine.daemon as daemon:  # teach, and remember what is served
        calibrate(world, daemon)
        before = machine.serves()

        for command in ("useradd --create-home --groups vgrd anna", "useradd --create-home bruno"):
            systemd.do(*command.split())
        asks = ["--", "/bin/bash", "-lc", "vgrd status"]  # as they would, without any option
        anna = systemd.run("runuser", "-u", "anna", *asks)
        assert anna.returncode == 0, anna.stdout + anna.stderr
        assert before[0] in anna.stdout
        assert systemd.run("runuser", "-u", "bruno", *asks).returncode != 0

        done = machine.install()  # the update: the same state, the same number in the registers
        assert done.returncode == 0, done.stdout + done.stderr
        assert machine.version.endswith("-2")
        assert machine.serves() == before
        (archive,) = machine.path("/var/backups/vgrd").glob("*.tar")
        assert archive.name == f"before-{machine.version}.tar"

        bad = machine.install(str(broken_source(machine.cell.folder / "bad")))
        assert bad.returncode == 1
        assert "systemctl restart vgrd.service" in bad.stderr
        assert "The version before is in use again" in bad.stderr
        assert machine.version.endswith("-2")
        assert not list(machine.path("/opt/vgrd").glob("*-3"))
        assert machine.serves() == before

        done = machine.vgrd("install", "--rollback")
        assert done.returncode == 0, done.stdout + done.stderr
        assert machine.version.endswith("-1")
        assert machine.serves() == before

        refused = machine.vgrd("restore", "/var/backups/vgrd/" + archive.name)
        assert "another daemon" in refused.stderr
        systemd.ask("stop", "vgrd.socket", "vgrd.service")
        shutil.rmtree(machine.path("/var/lib/vgrd/calibrations"))  # a spare computer
        done = machine.vgrd("restore", "/var/backups/vgrd/" + archive.name)
        assert done.returncode == 0, done.stderr
        systemd.ask("start", "vgrd.socket", "vgrd.service")
        assert machine.serves() == before

    done = machine.vgrd("uninstall")
    assert done.returncode == 0, done.stderr
    assert "/var/lib/vgrd" in done.stdout
    for gone in ("/opt/vgrd", "/usr/local/bin/vgrd", "/etc/systemd/system/vgrd.service"):
        assert not os.path.lexists(machine.path(gone))
    for kept in ("/etc/vgrd/cell.toml", "/var/lib/vgrd/calibrations", "/var/lib/vgrd/sessions"):
        assert machine.path(kept).exists()
    assert "Traceback" not in daemon.log.read_text()
    record_property("took_s", round(time.monotonic() - start, 1))
