"""The live wizard in a real terminal: one key does the step, no key does anything without a link."""

import os
import pty
import subprocess
import sys
import termios
import threading
import time

import pytest

from tests.page.browser import PATIENCE_S, until
from tests.page.daemon import PaperDaemon
from vgrd.orphans import dying_with_us

pytestmark = pytest.mark.system


class Terminal:
    """`vgrd teach` in a terminal of its own; `screen` is all that it has drawn."""

    def __init__(self, runtime_dir) -> None:
        self.ours, self.its = pty.openpty()
        self.before = termios.tcgetattr(self.its)
        self.screen = b""
        argv = [sys.executable, "-m", "vgrd.cli", "teach", "--socket"]
        env = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "40"}
        self.process = subprocess.Popen(
            dying_with_us([*argv, str(runtime_dir / "control.sock")]),
            stdin=self.its,
            stdout=self.its,
            stderr=self.its,
            env=env,
        )
        self._reading = threading.Thread(target=self._read)
        self._reading.start()

    def _read(self) -> None:
        while chunk := os.read(self.ours, 65536):
            self.screen += chunk
            if self.process.poll() is not None and b"END" in chunk:
                return

    def press(self, key: str) -> None:
        os.write(self.ours, key.encode())

    def shows(self, words: str) -> bool:
        """Whether the newest drawing holds these words."""
        return words.encode() in self.screen[-12000:]

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.write(self.its, b"END")
        self._reading.join()
        os.close(self.its)
        os.close(self.ours)


@pytest.fixture
def daemon(tmp_path):
    with PaperDaemon(tmp_path) as daemon:
        yield daemon


@pytest.fixture
def terminal(daemon, tmp_path):
    terminal = Terminal(tmp_path)
    yield terminal
    terminal.close()


def test_a_key_does_the_step_and_q_leaves_the_terminal_as_it_was(daemon, terminal):
    until(lambda: terminal.shows("put the tip on P2"))
    terminal.press(" ")
    until(lambda: daemon.given)
    assert daemon.given == [("touch", {"target": "P2", "version": "v1"})]
    until(lambda: terminal.shows("done: touch"))
    terminal.press("u")
    until(lambda: len(daemon.given) == 2)
    assert daemon.given[1] == ("undo", {"version": "v1"})
    terminal.press("q")
    assert terminal.process.wait(PATIENCE_S) == 0
    assert termios.tcgetattr(terminal.its)[3] == terminal.before[3]  # echo and lines are back


def test_no_key_is_obeyed_without_a_link(daemon, terminal):
    until(lambda: terminal.shows("put the tip on P2"))
    daemon.freeze()
    until(lambda: terminal.shows("NO LINK"))
    terminal.press(" ")
    time.sleep(1.0)  # longer than the key takes to be read
    daemon.thaw()
    terminal.screen = b""
    until(lambda: terminal.shows("put the tip on P2"))
    assert daemon.given == []
    terminal.press("q")
    assert terminal.process.wait(PATIENCE_S) == 0
