"""One benchmark module in a process of its own: whatever it does to itself costs its own rows only."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import IO

from tests.benchmarks.harness import Row, ending
from vgrd.orphans import dying_with_us

TAIL_BYTES = 4000  # of what a module wrote before it failed: a traceback with room to spare


def measure(module: str, folder: str, timeout_s: float) -> Iterator[Row]:
    """Rows of a module as they come; the last one tells of a crash, an exception or a silence.

    module: dotted name, found from the working folder or in `folder`. timeout_s: longest wait for a row.
    """
    reading, writing = os.pipe()
    with tempfile.TemporaryFile() as errors, os.fdopen(reading, "rb", buffering=0) as rows:
        process = _start([module, folder, str(writing)], writing, errors)
        os.close(writing)
        try:
            yield from _received(rows, timeout_s)
            code = process.wait(timeout_s)
        except (TimeoutError, subprocess.TimeoutExpired):
            yield Row.failed(module, f"silent for {timeout_s:g} s")
        else:
            if code:
                yield Row.failed(module, _reason(code, _tail(errors)))
        finally:
            _end(process)
            sys.stderr.write(_tail(errors))


def _start(arguments: list[str], writing: int, errors: IO[bytes]) -> subprocess.Popen[bytes]:
    argv = [sys.executable, "-X", "faulthandler", "-m", "tests.benchmarks.module"]
    return subprocess.Popen(
        dying_with_us([*argv, *arguments]),
        stdin=subprocess.DEVNULL,
        stderr=errors,
        pass_fds=[writing],
        start_new_session=True,  # so that its own children can be ended with it
    )


def _received(rows: IO[bytes], timeout_s: float) -> Iterator[Row]:
    """Rows until the module closes its end. TimeoutError when none comes for too long."""
    rest = b""
    while True:
        if not select.select([rows], [], [], timeout_s)[0]:
            raise TimeoutError
        block = rows.read(65536)
        if not block:
            return
        *lines, rest = (rest + block).split(b"\n")
        yield from (Row(**json.loads(line)) for line in lines)


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _tail(errors: IO[bytes]) -> str:
    size = errors.seek(0, os.SEEK_END)
    errors.seek(max(size - TAIL_BYTES, 0))
    return errors.read().decode("utf-8", errors="replace")


def _reason(code: int, written: str) -> str:
    last = written.strip().rpartition("\n")[2]
    return last if code > 0 and last else ending(code)
