"""What a command loads: the short ones neither numpy nor pydantic, whose loading takes longer than they do."""

import subprocess
import sys
from pathlib import Path

import pytest

REPORT = """
finally:
    heavy = ("numpy", "scipy", "cv2", "pydantic", "vgrd.documents", "vgrd.geometry")
    print("loaded:", *(name for name in heavy if name in sys.modules))
"""
VGRD = f"""
import sys
from vgrd.cli import main
sys.argv[0] = "vgrd"
try:
    main(){REPORT}
"""


def run(folder: Path, script: str, *words: str) -> tuple[int, str, set[str]]:
    """Exit code, all output, and what was loaded of what is heavy."""
    command = [sys.executable, "-c", script, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    report = done.stdout.splitlines()[-1]
    assert report.startswith("loaded:"), done.stderr
    return done.returncode, done.stdout + done.stderr, set(report.split()[1:])


def test_help_loads_nothing_heavy(tmp_path: Path) -> None:
    code, output, loaded = run(tmp_path, VGRD, "--help")
    assert (code, loaded) == (0, set())
    assert "Usage: vgrd" in output


@pytest.mark.parametrize(
    ("words", "code", "output_part"),
    [
        (("record", "--help"), 0, "Start and stop recording"),
        (("status", "--socket", "nowhere.sock"), 69, "no answer"),
    ],
)
def test_a_short_command_loads_nothing_heavy(
    tmp_path: Path, words: tuple[str, ...], code: int, output_part: str
) -> None:
    exit_code, output, loaded = run(tmp_path, VGRD, *words)
    assert exit_code == code, output
    assert output_part in output
    assert loaded == set()
