"""Logging never blocks, never floods, and never loses the first of a kind."""

import contextlib
import json
import os
import socket
import string
import subprocess
import sys

import pytest
import structlog

from fakes.testing import ManualClock
from vgrd.logs import LINES, RateLimit
from vgrd.orphans import dying_with_us

# Writes in every way that a process has, each time other words, so that nothing is summed up.
WRITER = """
import ctypes, faulthandler, itertools, logging, string, sys, traceback, warnings
import structlog
from vgrd import logs
logs.configure("writer")
log, libc = structlog.get_logger(), ctypes.CDLL(None)
for words in itertools.islice(itertools.permutations(string.ascii_letters, 5), 500):
    log.warning("refused", words="".join(words), padding="x" * 300)
    sys.stderr.write("a line\\n")
    libc.perror(b"from C")
    logging.getLogger("library").error("".join(words))
try:
    1 / 0
except ZeroDivisionError:
    traceback.print_exc()
    log.exception("failed")
warnings.warn("beware")
faulthandler.dump_traceback(2)
with open("/dev/null") as file:
    print("done", file.fileno() > 2, flush=True)
raise RuntimeError("the end")
"""


def fill(fd: int) -> None:
    os.set_blocking(fd, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(fd, b"x" * 1024)
    os.set_blocking(fd, True)


@contextlib.contextmanager
def full_pipe():
    reading, writing = os.pipe()
    fill(writing)
    yield {"stderr": writing}
    os.close(reading)
    os.close(writing)


@contextlib.contextmanager
def pipe_without_reader():
    reading, writing = os.pipe()
    os.close(reading)
    yield {"stderr": writing}
    os.close(writing)


@contextlib.contextmanager
def full_disk():
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        yield {"stderr": full.fileno()}


@contextlib.contextmanager
def journal_that_is_stuck():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        fill(theirs.fileno())
        status = os.fstat(theirs.fileno())
        stream = f"{status.st_dev}:{status.st_ino}"
        yield {"stderr": theirs, "env": {**os.environ, "JOURNAL_STREAM": stream}}


@contextlib.contextmanager
def closed():
    yield {"preexec_fn": lambda: [os.close(fd) for fd in (0, 2)]}


@pytest.mark.parametrize(
    "standard_error", [full_pipe, pipe_without_reader, full_disk, journal_that_is_stuck, closed]
)
def test_no_process_waits_for_its_standard_error(standard_error):
    with standard_error() as how:
        done = subprocess.run(
            [sys.executable, "-c", WRITER], stdout=subprocess.PIPE, timeout=60, check=False, **how
        )
    assert done.stdout == b"done True\n"
    assert done.returncode == 1


def test_what_is_written_arrives_and_others_may_go_on_waiting_for_the_pipe():
    reading, writing = os.pipe()
    code = "from vgrd import logs; import structlog; logs.configure('x'); structlog.get_logger().info('hello', n=1)"
    subprocess.run([sys.executable, "-c", code], stderr=writing, timeout=60, check=True)
    assert os.get_blocking(writing)
    line = json.loads(os.read(reading, 4096))
    assert (line["event"], line["n"], line["process"], line["level"]) == ("hello", 1, "x", "info")
    os.close(reading)
    os.close(writing)


def test_lines_that_did_not_fit_are_counted_and_the_next_begins_a_line():
    reading, writing = os.pipe()
    code = """
import sys
from vgrd import logs
logs.configure("x")
for _ in range(3):
    sys.stderr.write("y" * 100_000 + "\\n")
print("full", flush=True)
input()
sys.stderr.write("after\\n")
"""
    with subprocess.Popen(
        dying_with_us([sys.executable, "-c", code]),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=writing,
        text=True,
    ) as process:
        os.close(writing)
        assert process.stdout.readline() == "full\n"
        torn = os.read(reading, 1 << 20)
        assert set(torn) == {ord("y")}
        process.stdin.write("\n")
        process.stdin.flush()
        with os.fdopen(reading) as rest:
            lines = rest.read().splitlines()
    assert lines == ["", "(3 lines dropped: standard error was full)", "after"]


class Log:
    """A rate limit, its clock, and what came out."""

    def __init__(self):
        self.clock = ManualClock()
        self.lines: list[dict] = []
        self.limit = RateLimit(
            lambda text: self.lines.append(json.loads(text)),
            [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()],
            now=self.clock.monotonic,
        )

    def say(self, event: str, **more) -> None:
        with contextlib.suppress(structlog.DropEvent):
            line = {"event": event, "level": "warning", **more}
            self.lines.append(json.loads(self.limit(None, "warning", line)))


@pytest.fixture
def log():
    return Log()


def test_a_line_that_repeats_is_told_a_few_times_and_summed_up(log):
    for number in range(600):
        log.say("answer", status="NOT_CALIBRATED", point=number)
    assert [line["point"] for line in log.lines] == list(range(LINES))
    log.clock.now_s += 1.0
    log.limit.sum_up()
    assert log.lines[LINES:] == [
        {
            "event": "answer",
            "level": "warning",
            "status": "NOT_CALIBRATED",
            "point": 599,
            "more": 600 - LINES,
        }
    ]
    log.limit.sum_up()
    assert len(log.lines) == LINES + 1


def test_a_flood_without_end_costs_a_few_lines_a_second(log):
    for _ in range(10_000):
        log.say("answer", status="NOT_CALIBRATED")
        log.clock.now_s += 0.001
    log.limit.sum_up(everything=True)
    assert len(log.lines) <= 11 * (LINES + 1)
    told = sum(line.get("more", 1) for line in log.lines)
    assert told == 10_000


def test_an_error_that_is_new_comes_through_any_flood(log):
    for letters in string.ascii_letters:
        for _ in range(50):
            log.say("answer", status="NOT_CALIBRATED")
        log.say("answer", status=f"NEW_{letters}")
        assert log.lines[-1]["status"] == f"NEW_{letters}"


def test_another_exception_is_another_kind(log):
    for error in (ValueError("a"), KeyError("b"), ValueError("c")):
        for _ in range(50):
            try:
                raise error
            except (ValueError, KeyError):
                log.say("failed", exc_info=True)
    assert len(log.lines) == 2 * LINES
    assert "KeyError" in log.lines[LINES]["exception"]


def test_numbers_and_addresses_make_no_kind_of_their_own(log):
    for number in range(100):
        log.say("pose", reason=f"frame {number} at {hex(id(log) + 4096 * number)}")
    assert len(log.lines) == LINES


def test_kinds_without_end_are_forgotten_in_turn_and_their_sums_are_told(log):
    for _ in range(50):
        log.say("first")
    for a in string.ascii_letters:
        for b in string.ascii_letters:
            log.say("other", words=a + b)
    assert len(log.limit._kinds) <= 512
    log.clock.now_s += 1.0
    log.say("any")
    assert {"event": "first", "level": "warning", "more": 50 - LINES} in log.lines


def test_a_process_that_falls_silent_still_tells_the_sum():
    code = """
import sys, structlog, time
from vgrd import logs
logs.configure("x")
for _ in range(100):
    structlog.get_logger().warning("again")
time.sleep(60 if sys.argv[1] == "stays" else 0)
"""
    for how in ("stays", "ends"):
        process = subprocess.Popen(
            dying_with_us([sys.executable, "-c", code, how]), stderr=subprocess.PIPE, text=True
        )
        lines = [json.loads(process.stderr.readline()) for _ in range(LINES + 1)]
        process.kill()
        process.communicate()
        assert lines[-1]["more"] == 100 - LINES
