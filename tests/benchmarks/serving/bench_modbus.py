"""Reads of the whole response block a second, by 1, 8 and 32 clients: ours against pymodbus's server and libmodbus.

All servers run at once and are loaded in turn by the same clients in C, so that what else the machine does meets them
alike. The others' registers stand still; ours change as in a cell.
"""

import struct
from collections.abc import Iterable, Iterator

from tests.benchmarks.harness import Row, ratio_of
from tests.benchmarks.serving.clients import Missing, built, load, server

ROUNDS = 15
ROUND_S = 0.3
WORDS = 68  # the whole block; one more is outside
READ = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 100, WORDS)
ANSWER_BYTES = 9 + 2 * WORDS
BARS = {  # of libmodbus, written in C, a part is enough: a cell needs less than 1,000 reads a second
    "pymodbus": {1: 2.0, 8: 4.0, 32: 4.0},
    "libmodbus": {1: 0.3, 8: 0.6, 32: 0.6},
}


def rows() -> Iterator[Row]:
    """modbus_read_vs_PEER_CLIENTS: reads per second, ours / the peer's."""
    for peer, bars in BARS.items():
        try:
            built("load")
            with server("ours") as ours, server(peer) as theirs:
                yield from _compared(peer, ours[0], theirs[0], bars.items())
        except Missing as missing:
            for clients in bars:
                yield Row.skipped(f"modbus_read_vs_{peer}_{clients}", str(missing))


def _compared(
    peer: str, our_port: int, their_port: int, bars: Iterable[tuple[int, float]]
) -> Iterator[Row]:
    for clients, bar in bars:

        def reads_per_s(port: int, clients: int = clients) -> float:
            return load(port, clients, ROUND_S, READ, answer_bytes=ANSWER_BYTES).per_s

        ratio, ours, theirs = ratio_of(
            lambda: reads_per_s(our_port), lambda: reads_per_s(their_port), ROUNDS
        )
        note = f"{ours:.0f}/s against {theirs:.0f}/s"
        yield Row.at_least(f"modbus_read_vs_{peer}_{clients}", ratio, "x", bar, note)
