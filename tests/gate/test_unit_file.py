import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TEMPLATE = Path(__file__).parents[2] / "config" / "vgrd.service"
TOOL = shutil.which("systemd-analyze")


def render(folder: Path) -> Path:
    """Write the unit with this environment's path, as an installation does."""
    cell = folder / "cell.toml"
    text = TEMPLATE.read_text().replace("@CELL@", str(cell)).replace("@VENV@", sys.prefix)
    unit = folder / "vgrd.service"
    unit.write_text(text)
    return unit


@pytest.mark.skipif(TOOL is None, reason="systemd-analyze is not installed")
def test_systemd_accepts_the_unit_file(tmp_path):
    unit = render(tmp_path)
    done = subprocess.run(
        [str(TOOL), "verify", "--man=no", str(unit)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    ours = [line for line in done.stderr.splitlines() if "vgrd" in line]
    assert ours == []
    assert done.returncode == 0, done.stderr


def test_the_unit_is_notified_watched_and_not_restarted_after_a_configuration_error():
    text = TEMPLATE.read_text()
    for line in ("Type=notify", "WatchdogSec=5", "Restart=always", "RestartPreventExitStatus=78"):
        assert f"\n{line}\n" in text
