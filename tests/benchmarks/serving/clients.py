"""Servers in processes of their own, and the clients in C that load them; both are compiled where a compiler is."""

import contextlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from vgrd.orphans import dying_with_us

SOURCES = Path(__file__).parent / "load"
PER_PEER = 8  # connections of one address, see `ConnectionLimits`
PYTHON_SERVERS = "tests.benchmarks.serving.modbus_servers"


class Missing(Exception):
    """What a row needs is not on this machine; the words say what."""


class Load(NamedTuple):
    """What clients found: answers a second; median, 99th percentile and largest of an answer's time, us."""

    per_s: float
    median_us: float
    p99_us: float
    largest_us: float


@cache
def built(name: str, *libraries: str) -> str:
    """Path of the program made of a source in C. Raises Missing."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise Missing("no C compiler (cc)")
    folder = Path(tempfile.mkdtemp(prefix="vgrd-bench-"))
    argv = [compiler, "-O2", "-o", str(folder / name), str(SOURCES / f"{name}.c"), *libraries]
    result = subprocess.run(argv, capture_output=True, text=True, check=False)
    if result.returncode:
        raise Missing(f"{name}.c was not compiled: {result.stderr.strip().partition(chr(10))[0]}")
    return str(folder / name)


def load(port: int, clients: int, seconds: float, request: bytes, **more: int) -> Load:
    """Let so many clients ask, see load.c. more: period_us (0: at once), answer_bytes (0: a line)."""
    return loaded(loading(port, clients, seconds, request, **more))


def loading(
    port: int,
    clients: int,
    seconds: float,
    request: bytes,
    *,
    period_us: int = 0,
    answer_bytes: int = 0,
) -> subprocess.Popen[str]:
    """Start it; `loaded` waits for its end."""
    numbers = (port, clients, seconds, period_us, PER_PEER, answer_bytes)
    argv = [built("load"), *map(str, numbers), request.hex()]
    return subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True)


def loaded(process: subprocess.Popen[str]) -> Load:
    """What the clients found."""
    figures, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"the clients ended with exit code {process.returncode}")
    return Load(*map(float, figures.split()))


@contextlib.contextmanager
def server(name: str) -> Iterator[list[int]]:
    """Start "ours", "pymodbus" or "libmodbus"; yields its ports. Raises Missing."""
    argv = [sys.executable, "-m", PYTHON_SERVERS, name]
    if name == "libmodbus":
        argv = [built("libmodbus_server", "-lmodbus")]
    process = subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield [int(word) for word in process.stdout.readline().split()]
    finally:
        process.kill()
        process.communicate()
