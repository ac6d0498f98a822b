"""`vgrd page-password`: asked twice and hidden, or a line of the input; only the owner reads its file."""

import os
import pty
import subprocess
import sys
from contextlib import suppress

import pytest
from typer.testing import CliRunner

from vgrd.cli import app
from vgrd.errors import InputError
from vgrd.orphans import dying_with_us
from vgrd.page.access.password import Password

pytestmark = pytest.mark.timeout(60)
WORD = "a horse, a battery"


def made(path, text: str) -> None:
    CliRunner().invoke(app, ["page-password", str(path)], input=text, catch_exceptions=False)


@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
def test_a_line_of_the_input_is_the_password(tmp_path, end):
    made(tmp_path / "password", WORD + end)
    assert Password.read(tmp_path / "password").fits(WORD)


@pytest.mark.parametrize("text", ["", "short\n"])
def test_a_short_one_is_refused_and_the_old_one_stays(tmp_path, text):
    made(tmp_path / "password", WORD)
    with pytest.raises(InputError, match="take 12 to"):
        made(tmp_path / "password", text)
    assert Password.read(tmp_path / "password").fits(WORD)


def at_a_terminal(path, *answers: str) -> tuple[int, bytes]:
    """Exit code of the command, and all that its terminal showed."""
    ours, its = pty.openpty()
    command = subprocess.Popen(
        dying_with_us([sys.executable, "-m", "vgrd.cli", "page-password", str(path)]),
        stdin=its,
        stdout=its,
        stderr=its,
        start_new_session=True,
    )
    os.close(its)
    shown = b""
    for answer in answers:
        while not shown.endswith(b": "):  # the space comes once the terminal echoes nothing
            shown += os.read(ours, 1)
        os.write(ours, answer.encode() + b"\n")
        shown += os.read(ours, 1)
    with suppress(OSError):  # EIO: it has ended
        while chunk := os.read(ours, 1000):
            shown += chunk
    os.close(ours)
    return command.wait(), shown


def test_a_person_is_asked_twice_and_nothing_is_shown(tmp_path):
    code, shown = at_a_terminal(tmp_path / "password", WORD, WORD)
    assert code == 0, shown
    assert WORD.encode() not in shown
    assert Password.read(tmp_path / "password").fits(WORD)


def test_a_slip_of_the_finger_is_told(tmp_path):
    code, shown = at_a_terminal(tmp_path / "password", WORD, WORD + "x")
    assert code != 0
    assert b"not the same" in shown
    assert not (tmp_path / "password").exists()
