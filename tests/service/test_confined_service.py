"""The daemon does its whole work under the filter, the rights and the file system of the shipped unit."""

import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.cell.cell import FakeCell
from fakes.cell.session import work
from fakes.confinement.confined import (
    PROJECT,
    ConfinedDaemon,
    render,
    take_folders_from_unit,
    visible,
)
from fakes.testing import free_port
from fakes.world.world import World
from vgrd.orphans import dying_with_us

# All that confining needs of a machine: a library, a tool, and the right to namespaces.
ABLE = """
from fakes.confinement.namespaces import enter_namespaces
from fakes.confinement.seccomp import library
from fakes.confinement.unit_file import members
library()
members("@known")
enter_namespaces()
"""


@pytest.fixture(scope="module", autouse=True)
def _able() -> None:
    """Skip where a process cannot be confined, whatever the unit says."""
    done = subprocess.run(
        [sys.executable, "-c", ABLE], capture_output=True, text=True, check=False, cwd=PROJECT
    )
    if done.returncode:
        pytest.skip(f"cannot confine here: {done.stderr.strip().splitlines()[-1]}")


def confined(folder: Path, unit_text: str, code: str) -> subprocess.CompletedProcess[str]:
    """Python code run under a unit's directives."""
    unit = render(folder / "cell.toml", folder / "probe.service", unit_text)
    command = [
        sys.executable,
        "-m",
        "fakes.confinement.namespaces",
        str(unit),
        str(folder),
        *visible(),
    ]
    return subprocess.run(
        dying_with_us([*command, "--", sys.executable, "-c", code]),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=PROJECT,
    )


def shipped() -> str:
    return (PROJECT / "config" / "vgrd.service").read_text()


def test_without_its_error_number_the_filter_kills_the_daemon_at_its_first_import(
    tmp_path,
) -> None:
    error_number = "SystemCallErrorNumber=EPERM\n"
    assert error_number in shipped()
    deadly = shipped().replace(error_number, "")  # as the unit once was, and no daemon started
    for code in ("import numpy", "import os; os.nice(1)"):
        assert confined(tmp_path, deadly, code).returncode == -signal.SIGSYS, code
    lives = confined(tmp_path, shipped(), "import numpy; print('alive')")
    assert lives.stdout == "alive\n", lives.stderr


@pytest.mark.parametrize(
    "code",
    [
        "os.setpriority(os.PRIO_PROCESS, 0, 5)",
        "os.chown(STATE, 0, 0)",
        "os.sched_setaffinity(0, {0})",
        "os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))",
        "os.sethostname('x') if hasattr(os, 'sethostname') else socket.sethostname('x')",
        "os.chmod(STATE, 0o4700)",
        "call(libc.unshare(0x10000000))",
        "call(libc.ptrace(0, 0, 0, 0))",
        "call(libc.mount(b'x', b'/tmp', b'tmpfs', 0, b''))",
        "call(libc.personality(0x40000))",
        "socket.socket(socket.AF_PACKET, socket.SOCK_RAW)",
        "socket.socket(socket.AF_VSOCK, socket.SOCK_STREAM)",
        "socket.create_server(('127.0.0.1', 502))",
        "open('/etc/vgrd-probe', 'w')",
        "open('/usr/vgrd-probe', 'w')",
        "open('/var/lib/vgrd-probe', 'w')",
        "open('/proc/sys/vm/swappiness', 'w')",
        "open('/dev/vda')",
        "open('/dev/mem')",
        "os.kill(1, 0)",
    ],
)
def test_what_the_unit_forbids_is_refused_and_survived(tmp_path, code: str) -> None:
    wrapped = f"""
import ctypes, os, socket
STATE = os.environ["STATE_DIRECTORY"]
libc = ctypes.CDLL(None, use_errno=True)
def call(answer):
    if answer < 0:
        raise OSError(ctypes.get_errno(), "refused")
try:
    {code}
except OSError as error:
    print("refused", error)
"""
    done = confined(tmp_path, shipped(), wrapped)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("refused"), done.stdout


def test_the_unit_leaves_what_the_daemon_needs(tmp_path) -> None:
    code = """
import os, socket, tempfile
for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY", "CACHE_DIRECTORY"):
    path = os.path.join(os.environ[name], "probe")
    open(path, "w").close()
    assert os.stat(path).st_mode & 0o077 == 0, name
tempfile.TemporaryFile().close()
socket.create_server(("127.0.0.1", 0)).close()
socket.socket(socket.AF_NETLINK, socket.SOCK_RAW).close()
assert os.environ["NUMBA_CACHE_DIR"] == os.environ["CACHE_DIRECTORY"]
assert "CapEff:\\t0000000000000000" in open("/proc/self/status").read()
assert "NoNewPrivs:\\t1" in open("/proc/self/status").read()
print("alive")
"""
    done = confined(tmp_path, shipped(), code)
    assert done.stdout == "alive\n", done.stderr


@pytest.fixture
def cell(tmp_path: Path, world: World, compiled: Path) -> Iterator[FakeCell]:
    (tmp_path / "cell").mkdir()
    shutil.copytree(compiled, tmp_path / "cell" / "cache")
    with FakeCell(world, tmp_path / "cell", free_port(), page=free_port()) as fake:
        take_folders_from_unit(fake.cell_file)
        yield fake


@pytest.mark.system
@pytest.mark.timeout(900)
def test_the_daemon_teaches_solves_serves_and_restarts_under_the_unit(
    cell, world, tmp_path, record_property
) -> None:
    start = time.monotonic()
    daemon = ConfinedDaemon(cell.cell_file, tmp_path / "vgrd.log")
    with daemon:
        record_property("start_s", round(time.monotonic() - start, 1))
        work(world, daemon, "127.0.0.1", cell.port)
        with urllib.request.urlopen(f"http://127.0.0.1:{cell.page}/", timeout=60.0) as answer:
            page = answer.read().decode()
        told = daemon.heard()
        folders = [cell.folder / "state", cell.folder / "run"]
        lax = [p for top in folders for p in top.rglob("*") if p.lstat().st_mode & 0o007]
    assert {"READY=1", "WATCHDOG=1"} <= set(told)
    assert "STOPPING=1" in daemon.last_words
    assert daemon.process.returncode == 0
    assert lax == []
    log = daemon.log.read_text(encoding="utf-8")
    assert "Traceback" not in log
    assert '"event": "niceness_refused"' in log
    assert "<title>vgrd" in page
    record_property("took_s", round(time.monotonic() - start, 1))
