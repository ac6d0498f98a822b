"""What tests and fakes start ends with them, however they end, and what is left all the same is found."""

import ast
import os
import subprocess
import sys
import time
import uuid
from pathlib import Path
from threading import Thread

import pytest

from fakes.cell.processes import MARK, is_alive, left_behind, marked, started_s
from fakes.testing import free_loopback
from vgrd.orphans import dying_with_us

ROOT = Path(__file__).parents[1]
GONE_WITHIN_S = 60.0
SLEEP = "import time; print('up', flush=True); time.sleep(987)"
STARTS_ANOTHER = f"""
import subprocess, sys, time
from vgrd.orphans import dying_with_us
other = subprocess.Popen(dying_with_us([sys.executable, "-c", {SLEEP!r}]), stdout=subprocess.PIPE)
other.stdout.readline()
print(other.pid, flush=True)
time.sleep(987)
"""
STARTS_A_FAKE = """
import sys, time
from fakes.cell.processes import descendants
from fakes.testing import FakeProcess
with FakeProcess("rtde", "--host", sys.argv[1]) as fake:
    import os
    (pid,) = set(descendants(os.getpid())) - {os.getpid()}
    print(pid, flush=True)
    time.sleep(987)
"""


@pytest.mark.parametrize("code", [STARTS_ANOTHER, STARTS_A_FAKE], ids=["a process", "a fake"])
def test_what_a_killed_process_had_started_is_gone_too(code: str) -> None:
    argv = [sys.executable, "-c", code, free_loopback(30004)]
    with subprocess.Popen(
        dying_with_us(argv), cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as starter:
        assert starter.stdout is not None
        other = int(starter.stdout.readline())
        assert is_alive(other)
        starter.kill()
    end_s = time.monotonic() + GONE_WITHIN_S
    while is_alive(other):
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_the_process_keeps_its_id_its_arguments_and_its_exit_code() -> None:
    code = "import os, sys; print(os.getpid(), sys.argv[1:]); sys.exit(7)"
    argv = [sys.executable, "-c", code, "a b", ""]
    with subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.read() == f"{process.pid} ['a b', '']\n"
    assert process.returncode == 7


def test_a_process_is_not_started_by_a_thread_whose_end_would_end_it() -> None:
    refused: list[str] = []

    def start() -> None:
        try:
            dying_with_us(["true"])
        except RuntimeError as error:
            refused.append(str(error))

    thread = Thread(target=start)
    thread.start()
    thread.join()
    assert refused == ["true would die with this thread: start it from the main thread"]


def test_a_process_that_a_test_leaves_behind_is_found_and_ended() -> None:
    mark = uuid.uuid4().hex
    before = time.monotonic()
    with subprocess.Popen(
        dying_with_us([sys.executable, "-c", SLEEP]),
        stdout=subprocess.PIPE,
        env=os.environ | {MARK: mark},
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert list(marked(mark)) == [process.pid]
        assert before - 0.02 < started_s(process.pid) < time.monotonic()
        assert "time.sleep(987)" in left_behind(mark, 0.2)[process.pid]
        process.wait(GONE_WITHIN_S)
    assert left_behind(mark, 0.0) == {}
    with pytest.raises(ProcessLookupError):
        started_s(process.pid)


def started_without_it(path: Path) -> list[str]:
    """Places in a file where a process is started that may outlive this one."""
    found = []
    for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(call, ast.Call):
            continue
        name = ast.unparse(call.func)
        words = ast.unparse(call)
        lasts = name.endswith(("Popen", "create_subprocess_exec"))
        pool = name.endswith("ProcessPoolExecutor")
        if (lasts and "dying_with_us(" not in words) or (
            pool and "initializer=die_with" not in words
        ):
            found.append(f"{path.relative_to(ROOT)}:{call.lineno}")
    return found


def test_no_test_fake_or_benchmark_starts_a_process_that_may_outlive_it() -> None:
    paths = [*ROOT.glob("tests/**/*.py"), *ROOT.glob("fakes/**/*.py")]
    assert [place for path in paths for place in started_without_it(path)] == []
