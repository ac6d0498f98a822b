"""The line server's answers, and the registers beside a hundred of its clients.

A hundred clients poll whether their answer stands, each 20 times a second; eight robots read the registers, each 125
times a second.
"""

import statistics
import struct
from collections.abc import Iterator

from tests.benchmarks.harness import Row
from tests.benchmarks.serving.clients import Load, Missing, load, loaded, loading, server

LINE = b"EC,1,7\n"
READ = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 100, 68)
ANSWER_BYTES = 9 + 2 * 68
LINE_CLIENTS, LINE_PERIOD_US = 100, 50_000  # a validity that is asked each 50 ms
ROBOTS, ROBOT_PERIOD_US = 8, 8_000  # UR's fastest signals
ROUNDS = 9
ROUND_S = 2.0  # 2,000 reads: twenty are beyond the 99th percentile
ANSWER_BAR_MS, BESIDE_BAR = 5.0, 1.2


def rows() -> Iterator[Row]:
    """line_answer_ms_p99; registers_beside_100_line_clients: p99 of a read with them / without."""
    try:
        with server("ours") as (port, line_port):
            pairs = [_round(port, line_port) for _ in range(ROUNDS)]
    except Missing as missing:
        yield Row.skipped("line_answer_ms_p99", str(missing))
        yield Row.skipped("registers_beside_100_line_clients", str(missing))
        return
    lines = [lines for _, _, lines in pairs]
    p99 = statistics.median(line.p99_us for line in lines) / 1000
    note = (
        f"median {statistics.median(line.median_us for line in lines):.0f} us, "
        f"{statistics.median(line.per_s for line in lines):.0f} answers/s"
    )
    yield Row.at_most("line_answer_ms_p99", p99, "ms", ANSWER_BAR_MS, note)
    ratio = statistics.median(beside.p99_us / alone.p99_us for alone, beside, _ in pairs)
    note = " against ".join(
        f"{statistics.median(found[which].p99_us for found in pairs):.0f} us" for which in (1, 0)
    )
    yield Row.at_most("registers_beside_100_line_clients", ratio, "x", BESIDE_BAR, note)


def _round(port: int, line_port: int) -> tuple[Load, Load, Load]:
    """Reads alone, reads beside the lines, and these lines."""
    more = {"period_us": ROBOT_PERIOD_US, "answer_bytes": ANSWER_BYTES}
    alone = load(port, ROBOTS, ROUND_S, READ, **more)
    lines = loading(line_port, LINE_CLIENTS, ROUND_S, LINE, period_us=LINE_PERIOD_US)
    beside = load(port, ROBOTS, ROUND_S, READ, **more)
    return alone, beside, loaded(lines)
