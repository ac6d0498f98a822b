"""What `vgrd install` makes of a machine, under a real systemd: an update, a way back, a spare computer."""

import contextlib
import http.client
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from fakes.cell.cell import FakeCell, cell_text
from fakes.cell.rehearsal import NO_CAMERA, NO_ROBOT
from fakes.cell.session import calibrate, check_served
from fakes.confinement.booted import Booted, Unbootable
from fakes.confinement.confined import PROJECT, BootedDaemon, take_folders_from_unit
from fakes.controllers.raw_modbus import RawModbus
from fakes.testing import free_loopback, free_port
from fakes.world.layout import Layout
from fakes.world.world import World
from vgrd.installing.plans import PARTS
from vgrd.installing.steps import Copy
from vgrd.registers import RESPONSE

pytestmark = [pytest.mark.system, pytest.mark.timeout(2400)]

PORT = 502
EXPOSURE = 13  # in tenths: what is promised at most
ARCHIVE = Path("/srv/cell.tar")
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


# As the interpreter, but that its virtual environments find packages in another one too: pip has little to do.
SHARING = """#!/bin/sh
{python} "$@" || exit
[ "$2" != venv ] || echo {packages} > "$3/lib/{version}/site-packages/shared.pth"
"""


class Machine:
    """A cell computer with nothing of vgrd on it at first."""

    def __init__(self, systemd: Booted, cell_file: Path) -> None:
        self.systemd, self.cell_file = systemd, cell_file
        self.daemon = BootedDaemon(systemd, cell_file, cell_file.with_name("vgrd.log"))

    def vgrd(self, *words: str) -> subprocess.CompletedProcess[str]:
        """The installed command, as root."""
        return self.systemd.run("/usr/local/bin/vgrd", *words, timeout_s=INSTALL_S)

    def install(self, *words: str) -> subprocess.CompletedProcess[str]:
        """`make install`, from the project or from another source."""
        source = ["env", f"PYTHONPATH={PROJECT}", PYTHON, "-m", "vgrd.installing", "install"]
        return self.systemd.run(*source, *words, timeout_s=INSTALL_S)

    def sharing(self, packages: str) -> tuple[str, str]:
        """Options for an installation that takes packages from the folder `packages`."""
        path = self.cell_file.with_name("python-sharing")
        version = Path(packages).parent.name
        path.write_text(SHARING.format(python=PYTHON, packages=packages, version=version))
        path.chmod(0o755)
        return "--python", str(path)

    def path(self, inside: str) -> Path:
        """A file of its."""
        return self.systemd.path(inside)

    @property
    def version(self) -> str:
        """The one in use."""
        return self.path("/opt/vgrd/current").readlink().name

    @property
    def is_active(self) -> bool:
        """Whether the service runs."""
        return self.systemd.ask("is-active", "vgrd.service").strip() == "active"


@contextlib.contextmanager
def booted(folder: Path, cell_file: Path, more: str) -> Iterator[Machine]:
    """A machine that sees the folder of the cell file; its service says into vgrd.log what it has to say."""
    log = cell_file.with_name("vgrd.log")
    out = f"StandardOutput=append:{log}\nStandardError=append:{log}\n"
    systemd = Booted(folder, {"vgrd.service.d/test.conf": f"[Service]\n{out}{more}"}, [log.parent])
    try:
        systemd.boot()
    except Unbootable as error:
        pytest.skip(f"no systemd can be started here: {error}")
    with systemd:
        yield Machine(systemd, cell_file)


def python_version() -> str:
    """Such as 3.11."""
    code = "import sys; print('{}.{}'.format(*sys.version_info))"
    return subprocess.run(
        [PYTHON, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


def broken_source(folder: Path) -> Path:
    """A source whose daemon ends at its start."""
    for part in PARTS:
        Copy(PROJECT / part, folder / part, ("__pycache__",)).perform()
    (folder / "vgrd" / "gate" / "__main__.py").write_text("raise SystemExit(1)\n")
    return folder


def serves(machine: Machine, world: World, host: str) -> tuple[str, bytes]:
    """Wait until it serves, let a robot go there; the calibration, and its number in the registers."""
    machine.daemon.wait_until(lambda status: bool(status["serving"]))
    check_served(world, host, PORT)
    field = next(field for field in RESPONSE.fields if field.name == "CALID")
    with RawModbus(host, PORT, timeout_s=30.0) as robot:
        number = robot.read(field.address, field.count)
    return str(machine.daemon.control.call("status")["calibration"]), number


def test_what_was_taught_is_served_after_an_update_too(world, tmp_path, record_property) -> None:
    host = free_loopback(PORT)
    start = time.monotonic()
    with FakeCell(world, tmp_path / "cell", free_port()) as cell:
        take_folders_from_unit(cell.cell_file)
        text = cell.cell_file.read_text().replace('host = "127.0.0.1"', f'host = "{host}"')
        text = text.replace(f"port = {cell.port}", f"port = {PORT}")
        metrics = free_port()
        cell.cell_file.write_text(f'{text}\n[metrics]\nhost = "127.0.0.1"\nport = {metrics}\n')
        seen = f"BindReadOnlyPaths={cell.folder}\n"  # the fake devices' ring
        with booted(tmp_path, cell.cell_file, seen) as machine:
            done = machine.install("--cell", str(cell.cell_file))
            if done.returncode and any(words in done.stdout + done.stderr for words in NO_INDEX):
                pytest.skip(f"pip finds no packages here: {done.stderr.splitlines()[-1]}")
            assert done.returncode == 0, done.stdout + done.stderr
            record_property("install_s", round(time.monotonic() - start, 1))
            enabled = machine.systemd.ask("is-enabled", "vgrd.service", "vgrd.socket")
            assert enabled.split() == ["enabled", "enabled"]
            with machine.daemon as daemon:
                calibrate(world, daemon)
                before = serves(machine, world, host)
                check_operators(machine, before[0])
                check_exposure(machine)
                check_metrics(metrics)
                (packages,) = machine.path("/opt/vgrd/current/lib").glob("python3*/site-packages")
                inside = f"/opt/vgrd/{machine.version}/lib/{packages.parent.name}/site-packages"
                done = machine.install(*machine.sharing(inside))
                assert done.returncode == 0, done.stdout + done.stderr
                assert machine.version.endswith("-2")
                assert serves(machine, world, host) == before
                own = machine.path("/etc/systemd/system/vgrd.service.d/test.conf").read_text()
                move_to_spare(machine, own)
                assert serves(machine, world, host) == before
            assert "Traceback" not in daemon.log.read_text()
    record_property("took_s", round(time.monotonic() - start, 1))


def check_operators(machine: Machine, calibration: str) -> None:
    """A member of the group asks as people do, without any option; somebody else may not."""
    for command in ("useradd --create-home --groups vgrd anna", "useradd --create-home bruno"):
        machine.systemd.do(*command.split())
    asks = ["--", "/bin/bash", "-lc", "vgrd status"]
    anna = machine.systemd.run("runuser", "-u", "anna", *asks)
    assert anna.returncode == 0, anna.stdout + anna.stderr
    assert calibration in anna.stdout
    bruno = machine.systemd.run("runuser", "-u", "bruno", *asks)
    assert bruno.returncode != 0
    assert "adduser NAME vgrd" in " ".join((bruno.stdout + bruno.stderr).split())


def check_exposure(machine: Machine) -> None:
    """Of the unit as it was installed, not of its template."""
    copy = machine.cell_file.with_name("vgrd.service")
    copy.write_text(machine.path("/etc/systemd/system/vgrd.service").read_text())
    tool = shutil.which("systemd-analyze")
    assert tool  # a part of systemd
    words = ("security", "--offline=true", "--no-pager", f"--threshold={EXPOSURE}", str(copy))
    done = subprocess.run([tool, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def check_metrics(port: int) -> None:
    """As Prometheus reads them, from the daemon at work."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)) as link:
        link.request("GET", "/metrics")
        text = link.getresponse().read().decode()
    families = text_string_to_metric_families(text)
    told = {sample.name: sample.value for family in families for sample in family.samples}
    assert told["vgrd_cell_up"] == 1.0
    assert told["vgrd_server_requests_total"] > 0


def move_to_spare(machine: Machine, drop_in: str) -> None:
    """As docs/service.md says, onto a machine from which all of it was purged."""
    assert machine.vgrd("backup", str(ARCHIVE)).returncode == 0
    done = machine.vgrd("uninstall", "--purge", "everything")
    assert done.returncode == 0, done.stderr
    for gone in (
        "/opt/vgrd",
        "/etc/vgrd",
        "/var/lib/vgrd",
        "/var/backups/vgrd",
        "/var/cache/vgrd",
    ):
        assert not os.path.lexists(machine.path(gone)), gone
    own = machine.path("/etc/systemd/system/vgrd.service.d/test.conf")
    own.parent.mkdir()
    own.write_text(drop_in)
    machine.systemd.do("tar", "--directory=/srv", "-xf", str(ARCHIVE), "cell.toml")
    done = machine.install("--cell", "/srv/cell.toml")
    assert done.returncode == 0, done.stdout + done.stderr
    both = ("vgrd.socket", "vgrd.service")
    assert machine.systemd.ask("stop", *both) == ""
    done = machine.vgrd("restore", str(ARCHIVE))
    assert done.returncode == 0, done.stdout + done.stderr
    assert machine.systemd.ask("start", *both) == ""


def test_a_bad_update_and_a_way_back_cost_nothing_and_data_outlive_it_all(tmp_path) -> None:
    folder = tmp_path / "cell"
    folder.mkdir()
    cell_file = folder / "cell.toml"
    text = cell_text(Layout(), robot=NO_ROBOT, camera=NO_CAMERA, port=free_port())
    cell_file.write_text(text)
    take_folders_from_unit(cell_file)
    packages = str(Path(pytest.__file__).parents[1])  # where this test's own packages are
    home = "ProtectHome=tmpfs\n" if packages.startswith(("/root", "/home")) else ""
    if Path(packages).parent.name != f"python{python_version()}":
        pytest.skip(f"{PYTHON} is another version than this test's and cannot share its packages")
    with booted(tmp_path, cell_file, f"{home}BindReadOnlyPaths={packages}\n") as machine:
        sharing = machine.sharing(packages)
        for number in (1, 2):
            done = machine.install("--cell", str(cell_file), *sharing)
            assert done.returncode == 0, done.stdout + done.stderr
            assert machine.version.endswith(f"-{number}")
            assert machine.is_active

        bad = machine.install(str(broken_source(folder / "bad")), *sharing)
        assert bad.returncode == 1
        assert "could not run systemctl restart vgrd.service" in bad.stderr
        assert "The version before is in use again" in bad.stderr
        assert machine.version.endswith("-2")
        assert not list(machine.path("/opt/vgrd").glob("*-3"))
        assert machine.is_active

        done = machine.vgrd("install", "--rollback")
        assert done.returncode == 0, done.stdout + done.stderr
        assert machine.version.endswith("-1")
        assert machine.is_active

        archives = sorted(path.name for path in machine.path("/var/backups/vgrd").iterdir())
        assert archives == ["before-0.1.0-2.tar", "before-0.1.0-3.tar"]
        put_back = ["restore", f"/var/backups/vgrd/{archives[0]}", "--replace"]
        assert "another daemon" in machine.vgrd(*put_back).stderr
        machine.systemd.ask("stop", "vgrd.service")
        machine.path("/etc/vgrd/cell.toml").write_text("# lost\n" + text)
        assert machine.vgrd(*put_back).returncode == 0
        assert machine.path("/etc/vgrd/cell.toml").read_text() == cell_file.read_text()
        assert machine.systemd.ask("start", "vgrd.service") == ""

        done = machine.vgrd("uninstall")
        assert done.returncode == 0, done.stderr
        assert not machine.is_active
        for gone in ("/opt/vgrd", "/usr/local/bin/vgrd", "/etc/systemd/system/vgrd.service"):
            assert not os.path.lexists(machine.path(gone))
        for kept in ("/etc/vgrd/cell.toml", "/var/lib/vgrd", "/var/backups/vgrd"):
            assert kept in done.stdout
            assert machine.path(kept).exists()
