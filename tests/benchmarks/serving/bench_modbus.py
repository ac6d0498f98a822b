"""Register reads a second, one client in a closed loop: our server against pymodbus's own."""

import contextlib
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

from fakes.controllers.raw_modbus import RawModbus
from tests.benchmarks.harness import Row, ratio_of
from vgrd.orphans import dying_with_us

ROUNDS = 15
ROUND_S = 0.2
BAR = 1.5
READ = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 100, 68)
ANSWER_BYTES = 9 + 2 * 68


@contextlib.contextmanager
def server(name: str) -> Iterator[RawModbus]:
    """Start one of the servers and connect to it."""
    argv = [sys.executable, "-m", "tests.benchmarks.serving.modbus_servers", name]
    process = subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        with RawModbus("127.0.0.1", int(process.stdout.readline())) as client:
            yield client
    finally:
        process.kill()
        process.communicate()


def reads_per_s(client: RawModbus) -> float:
    """Ask and wait, for `ROUND_S`."""
    send, receive = client.socket.sendall, client.socket.recv
    count, begin = 0, time.perf_counter()
    while time.perf_counter() - begin < ROUND_S:
        for _ in range(100):
            send(READ)
            assert len(receive(1024)) == ANSWER_BYTES
        count += 100
    return count / (time.perf_counter() - begin)


def rows() -> list[Row]:
    """modbus_read_vs_pymodbus: reads per second, ours / pymodbus's."""
    with server("ours") as ours, server("pymodbus") as peers:
        ratio, our_rate, peer_rate = ratio_of(
            lambda: reads_per_s(ours), lambda: reads_per_s(peers), ROUNDS
        )
    note = f"{our_rate:.0f}/s against {peer_rate:.0f}/s"
    return [Row.at_least("modbus_read_vs_pymodbus", ratio, "x", BAR, note)]
