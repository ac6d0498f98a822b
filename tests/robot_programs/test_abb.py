"""RAPID is RAPID: its grammar is judged by rapidchecker."""

import subprocess
import sys

import pytest

from tests.robot_programs.brands.programs import PROGRAMS

SEEDED = (
    ("ENDIF", ""),
    ("RETURN;", "RETURN"),
    ("PROC VgrdGo(", "PROC VgrdGo"),
    ("vgrdLost := TRUE;", "vgrdLost = TRUE;"),
    ("ENDWHILE", "END_WHILE"),
    ("ENDMODULE", ""),
)


def judged(tmp_path, source):
    (tmp_path / "rapidchecker.toml").write_text("indentation_check = false\n")
    (tmp_path / "Vgrd.mod").write_text(source)
    argv = [sys.executable, "-m", "rapidchecker", "Vgrd.mod"]
    return subprocess.run(
        argv, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )


def test_the_module_has_the_grammar_of_rapid(tmp_path):
    result = judged(tmp_path, PROGRAMS["abb"].source)
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize(("right", "wrong"), SEEDED)
def test_a_seeded_fault_is_found(tmp_path, right, wrong):
    source = PROGRAMS["abb"].source
    assert right in source
    assert judged(tmp_path, source.replace(right, wrong, 1)).returncode != 0
