"""How long a robot waits for its first answer on a new connection while strangers knock."""

import contextlib
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

from tests.benchmarks.harness import Row
from vgrd.orphans import dying_with_us

HOST, STRANGER = "127.0.0.1", "127.0.0.99"
READ = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 100, 68)
CONNECTS_PER_S = 760  # the storm under which 1,021 ms were seen
BURST = 300  # it comes in bursts: a queue of 64 drops whoever comes behind one, for a second
ROUNDS = 50
BAR_MS = 100.0


@contextlib.contextmanager
def our_server() -> Iterator[int]:
    """Start our server; yields its port."""
    argv = [sys.executable, "-m", "tests.benchmarks.serving.modbus_servers", "ours"]
    with subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield int(process.stdout.readline().split()[0])
        finally:
            process.kill()


def knock(port: int) -> list[socket.socket]:
    """Begin a burst of connections of a host that is not listed; does not wait for them."""
    links = []
    for _ in range(BURST):
        link = socket.socket()
        link.setblocking(False)
        link.bind((STRANGER, 0))
        link.connect_ex((HOST, port))
        links.append(link)
    return links


def first_answer_ms(port: int) -> float:
    """Connect, ask, read the answer, hang up."""
    begin = time.perf_counter()
    with socket.create_connection((HOST, port), timeout=10) as link:
        link.sendall(READ)
        assert link.recv(1024)
        return 1000 * (time.perf_counter() - begin)


def stormy_ms(port: int) -> list[float]:
    """First answers right behind each burst."""
    samples, begin = [], time.monotonic()
    for number in range(1, ROUNDS + 1):
        strangers = knock(port)
        samples.append(first_answer_ms(port))
        for link in strangers:
            link.close()
        time.sleep(max(0.0, begin + number * BURST / CONNECTS_PER_S - time.monotonic()))
    return samples


def percentile_99(samples: list[float]) -> float:
    """The 99th of 100."""
    return statistics.quantiles(samples, n=100, method="inclusive")[98]


def rows() -> list[Row]:
    """modbus_connect_in_storm: p99 of a new listed connection's first answer, ms."""
    with our_server() as port:
        calm = percentile_99([first_answer_ms(port) for _ in range(ROUNDS)])
        begin = time.monotonic()
        stormy = stormy_ms(port)
        rate = ROUNDS * BURST / (time.monotonic() - begin)
    note = f"{calm:.1f} ms without; {rate:.0f} connects/s from a host that is not listed"
    return [Row.at_most("modbus_connect_in_storm", percentile_99(stormy), "ms", BAR_MS, note)]
