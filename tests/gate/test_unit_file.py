"""The shipped units are good in systemd's own eyes, and as little exposed as they claim."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from fakes.confinement.confined import TEMPLATE, render
from fakes.confinement.namespaces import ENFORCED, IMPLIED
from fakes.confinement.unit_file import last, read_section, syscall_filter
from vgrd.config.cell_file import ServingSection

SOCKET = TEMPLATE.with_name("vgrd.socket")
TOOL = shutil.which("systemd-analyze")
EXPOSURE = 1.1
CHANGED = 1.3  # with a drop-in of docs/service.md
# Of a [Service] section: what the manager itself does, and what takes control groups.
BY_MANAGER = {
    "KillMode",
    "NotifyAccess",
    "Restart",
    "RestartPreventExitStatus",
    "RestartSec",
    "TimeoutStartSec",
    "TimeoutStopSec",
    "Type",
    "WatchdogSec",
    "WatchdogSignal",
}
NEITHER = {"MemoryMax", "OOMScoreAdjust", "TasksMax"}

analyzed = pytest.mark.skipif(TOOL is None, reason="systemd-analyze is not installed")


def analyze(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(TOOL), *words], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    return render(tmp_path / "cell.toml", tmp_path / "vgrd.service")


@analyzed
def test_systemd_accepts_the_units(tmp_path, unit) -> None:
    socket = tmp_path / "vgrd.socket"
    socket.write_text(SOCKET.read_text().replace("@HOST@", "127.0.0.1").replace("@PORT@", "502"))
    done = analyze("verify", "--man=no", str(unit), str(socket))
    ours = [line for line in done.stderr.splitlines() if "vgrd" in line]
    assert ours == []
    assert done.returncode == 0, done.stderr


@analyzed
def test_the_unit_is_exposed_no_more_than_is_claimed(unit) -> None:
    threshold = f"--threshold={round(10 * EXPOSURE)}"
    options = ("security", "--offline=true", "--no-pager")
    good = analyze(*options, threshold, str(unit))
    assert good.returncode == 0, good.stdout
    unit.write_text(unit.read_text().replace("SystemCallFilter=~@privileged @resources\n", ""))
    assert analyze(*options, threshold, str(unit)).returncode != 0


@analyzed
@pytest.mark.parametrize("number", range(3))
def test_a_drop_in_of_the_page_exposes_it_little_more(unit, number: int) -> None:
    page = (TEMPLATE.parents[1] / "docs" / "service.md").read_text()
    drop_ins = re.findall(r"^```ini\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert len(drop_ins) == 3
    unit.write_text(f"{unit.read_text()}\n{drop_ins[number]}")
    options = ("security", "--offline=true", "--no-pager", f"--threshold={round(10 * CHANGED)}")
    done = analyze(*options, str(unit))
    assert done.returncode == 0, done.stdout
    assert analyze("verify", "--man=no", str(unit)).stderr == ""


@analyzed
def test_no_call_is_allowed_back_into_the_filter(unit) -> None:
    wanted = syscall_filter(read_section(unit, "Service"))
    report = analyze("security", "--offline=true", "--no-pager", "--json=short", str(unit)).stdout
    verdicts = {row["name"]: row["set"] for row in json.loads(report)}
    assert verdicts["SystemCallFilter=~@resources"] is True
    assert verdicts["SystemCallFilter=~@privileged"] is True
    assert {"mbind", "setpriority", "nice", "chown", "setuid"} <= wanted.refused


def test_every_directive_is_put_to_the_test_or_known_not_to_be(unit) -> None:
    directives = set(read_section(unit, "Service"))
    assert directives == (ENFORCED & directives) | IMPLIED | BY_MANAGER | NEITHER


def test_the_unit_is_notified_watched_and_not_restarted_after_a_configuration_error() -> None:
    directives = read_section(TEMPLATE, "Service")
    assert last(directives, "Type") == "notify"
    assert last(directives, "WatchdogSec") == "5"
    assert last(directives, "Restart") == "always"
    assert last(directives, "RestartPreventExitStatus") == "78"


def test_the_unit_may_open_the_port_that_the_cell_file_has_by_default() -> None:
    assert ServingSection().port >= 1024  # below, ports need a capability that the unit drops
