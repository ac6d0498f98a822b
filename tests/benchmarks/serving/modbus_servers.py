"""Servers that benchmarks load: `... modbus_servers ours|pymodbus`; prints its ports, ours that of the lines too.

Both hold a response block at 100-167. Ours does its whole work: the cell's image changes at 50 Hz.
pymodbus's registers stand still, which favours it.
"""

import asyncio
import gc
import sys
import tempfile
from pathlib import Path

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from vgrd.clock import SystemClock
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.lines import LINES
from vgrd.gate.pdu import MODBUS
from vgrd.gate.register_bank import RegisterBank
from vgrd.gate.server import ConnectionLimits, Server
from vgrd.ipc.ring import RingWriter
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REGISTER_RING,
    Answer,
    RegisterImage,
    State,
    Status,
)

HOST = "127.0.0.1"
PEERS = "127.0.0.0/28"  # sixteen addresses: a hundred clients are no one peer's; not those of strangers
PUBLISH_S = 0.02


def tell(*ports: int) -> None:
    """Say on which ports to connect."""
    sys.stdout.write(" ".join(map(str, ports)) + "\n")
    sys.stdout.flush()


async def serve_ours(folder: Path) -> None:
    """Serve a valid, ageing answer."""
    clock = SystemClock()
    ring = RingWriter.create(folder / REGISTER_RING, 4, PACKED_BYTES, REGISTER_KIND)
    start = clock.monotonic()
    answer = Answer(Status.OK, seq=1, captured_s=start, valid_until_s=start + 3600)
    feed = ImageFeed(folder, clock)
    bank = RegisterBank(feed, clock, deadline_s=0.25, forward=lambda _: True, abort=lambda: None)
    limits = ConnectionLimits(allow=(PEERS,), connections=128)
    server, lines = Server(MODBUS, bank, clock, limits), Server(LINES, bank, clock, limits)
    tell(await server.listen(HOST, 0), await lines.listen(HOST, 0))
    gc.collect()
    gc.freeze()  # as the gate does
    while True:
        now = clock.monotonic()
        beat = int((now - start) * 10)
        ring.publish(RegisterImage(answer, State.READY, beat, now).pack(), stamp_s=now)
        await asyncio.sleep(PUBLISH_S)


async def serve_pymodbus() -> None:
    """Serve constant registers."""
    registers = SimData(100, count=68, values=7, datatype=DataType.REGISTERS)
    server = ModbusTcpServer(context=SimDevice(1, simdata=registers), address=(HOST, 0))
    await server.serve_forever(background=True)
    tell(server.transport.sockets[0].getsockname()[1])
    await asyncio.Event().wait()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(serve_ours(Path(folder)) if sys.argv[1] == "ours" else serve_pymodbus())
