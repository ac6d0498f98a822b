"""A cell file on the disk changes nothing until it is reloaded, and a reload is whole or refused with the reason."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.cell.daemon import Daemon
from fakes.cell.taught import TaughtCell
from vgrd.errors import ControlError, DaemonUnreachable
from vgrd.registers import State

pytestmark = pytest.mark.system
COMES_WITHIN_S = 120.0
ATTEMPTS = 10


@pytest.fixture
def running(taught: TaughtCell) -> Iterator[tuple[TaughtCell, Daemon]]:
    with taught.daemon() as daemon:
        yield taught, daemon


def vgrd(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vgrd.cli", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=COMES_WITHIN_S, check=False
    )


def status(daemon: Daemon) -> dict[str, object]:
    told = vgrd("status", "--socket", str(daemon.control.path), "--json", "-")
    assert told.returncode == 0, told.stderr
    return dict(json.loads(told.stdout))


def serves(status: dict[str, object]) -> bool:
    return bool(status["serving"])


def kill_and_await_service(daemon: Daemon) -> None:
    former = daemon.pid_of("cell")
    daemon.kill("cell")
    daemon.wait_reborn("cell", former)
    daemon.wait_until(serves)


def longest_valid_s(taught: TaughtCell, give_up_s: float) -> float:
    """How long an answer stays valid, at most `give_up_s`."""
    with taught.program() as program:
        program.ask_until_good(1, COMES_WITHIN_S)
        start = time.monotonic()
        while time.monotonic() < start + give_up_s:
            if not int(program.view()["STATE"]) & State.VALID:
                break
            time.sleep(0.02)
        return time.monotonic() - start


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def set_serving(file: Path, line: str) -> None:
    edit(file, "[serving]\n", f"[serving]\n{line}\n")


def test_a_cell_that_dies_comes_back_as_it_was_whatever_its_file_says_now(
    running, stopwatch
) -> None:
    taught, daemon = running
    file = daemon.cell_file
    good = file.read_text(encoding="utf-8")
    file.write_text(good[: len(good) // 2] + "[[", encoding="utf-8")
    kill_and_await_service(daemon)
    told = status(daemon)
    assert "cannot be used as it is now" in str(told["cell_file_now"])
    assert told["cell_file"] == str(file)

    file.write_text(good, encoding="utf-8")
    set_serving(file, "max_age_s = 30.0")
    kill_and_await_service(daemon)
    assert longest_valid_s(taught, 10.0) < 5.0
    assert "serving.max_age_s" in str(status(daemon)["cell_file_now"])

    done = vgrd("reload", str(file), "--json", "-")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["changed"] == ["serving.max_age_s"]
    daemon.wait_until(serves)
    if not any(longest_valid_s(taught, 5.0) >= 5.0 for _ in range(ATTEMPTS)):
        stopwatch.give_up("no answer lived as long as it may")
    assert status(daemon)["cell_file_now"] == "in force"


def test_a_reload_that_cannot_be_is_refused_with_the_reason_and_changes_nothing(running) -> None:
    _, daemon = running
    file, pids = daemon.cell_file, daemon.pids()
    good = file.read_text(encoding="utf-8")
    for old, new, words in (
        ("[serving]\n", "[serving]\nmax_age = 3\n", "unknown key, did you mean 'max_age_s'"),
        ("port = ", "port = 1 # ", "serving.port changed: that needs a restart"),
        ('name = "pin"', 'name = "other"', "tool.name was pin, is other"),
    ):
        file.write_text(good, encoding="utf-8")
        edit(file, old, new)
        done = vgrd("reload", str(file))
        assert done.returncode != 0
        assert words in done.stderr.replace("\n", " "), done.stderr
        assert "Traceback" not in done.stderr
    assert daemon.pids() == pids
    daemon.wait_until(serves)

    operator_session = daemon.call("record.start", session="open")
    file.write_text(good, encoding="utf-8")
    set_serving(file, "max_age_s = 30.0")
    done = vgrd("reload", str(file))
    assert f"session {operator_session['session']} is being recorded" in done.stderr.replace(
        "\n", " "
    )
    daemon.call("record.stop")


def test_a_reload_restarts_what_it_changes_and_holds_the_port_with_nothing_valid(running) -> None:
    taught, daemon = running
    file, pids = daemon.cell_file, daemon.pids()
    with taught.program() as program:
        program.ask_until_good(1, COMES_WITHIN_S)
        edit(file, 'name = "pin"', 'name = "other"')
        done = vgrd("reload", str(file), "--without-calibration")
        assert done.returncode == 0, done.stderr
        values = program.view()  # on the very connection
        assert not int(values["STATE"]) & State.VALID
        mismatch = daemon.wait_until(
            lambda status: (
                bool(status["fault"]) and status["fault"]["status"] == "CALIBRATION_MISMATCH"
            )
        )
        assert mismatch >= 0
        reason = str(daemon.call("status")["fault"])
        assert "tool.name was pin, is other" in reason
    after = daemon.pids()
    assert after["gate"] == pids["gate"]
    assert after["cell"] != pids["cell"]
    assert (after["robot"], after["camera"]) == (pids["robot"], pids["camera"])


def test_a_reload_without_a_daemon_says_so(taught: TaughtCell) -> None:
    done = vgrd("reload", str(taught.fake.cell_file))
    assert done.returncode == 69
    assert "no daemon runs in" in done.stderr.replace("\n", " ")
    with pytest.raises((DaemonUnreachable, ControlError)):
        taught.daemon().control.call("status")
