"""A server in a thread of its own, and sockets that talk to it."""

import asyncio
import contextlib
import random
import socket
import threading
from collections import Counter
from collections.abc import Callable, Sequence

from fakes.controllers.raw_lines import RawLines
from fakes.controllers.raw_modbus import RawModbus
from vgrd.clock import SystemClock
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.pdu import MODBUS
from vgrd.gate.register_bank import RegisterBank
from vgrd.gate.server import ConnectionLimits, Server

Client = RawModbus | RawLines
LIMITS = ConnectionLimits(
    allow=("127.0.0.0/30",), connections_per_peer=4, idle_s=0.6, partial_s=0.2, silent_s=0.2
)


class ServerThread:
    """The server with a desk behind it, in an event loop of its own."""

    def __init__(self, runtime_dir, limits=LIMITS, language=MODBUS):
        clock = SystemClock()
        feed = ImageFeed(runtime_dir, clock)
        self.bank = RegisterBank(
            feed, clock, deadline_s=0.25, forward=lambda _: True, abort=lambda: None
        )
        self.server = Server(language, self.bank, clock, limits)
        self.loop = asyncio.new_event_loop()
        self.port = self.loop.run_until_complete(self.server.listen("127.0.0.1", 0))
        self.sweep()
        self.thread = threading.Thread(target=self.loop.run_forever)

    def sweep(self):
        """As the gate does."""
        self.server.sweep()
        self.loop.call_later(0.05, self.sweep)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.loop.call_soon_threadsafe(self.server.close)
        self.loop.call_soon_threadsafe(self.loop.call_later, 0.02, self.loop.stop)
        self.thread.join()
        self.loop.close()

    def client(self, **more) -> RawModbus:
        """Connect."""
        return RawModbus("127.0.0.1", self.port, **more)


class TurnedServers:
    """Servers in one loop that a test turns by hand; `ports` in their order."""

    def __init__(self, *servers: Server):
        self.loop = asyncio.new_event_loop()
        self._servers = servers
        self.ports = [
            self.loop.run_until_complete(server.listen("127.0.0.1", 0)) for server in servers
        ]

    def turn(self) -> None:
        """Let the loop look at its sockets once."""
        self.loop.call_soon(self.loop.stop)
        self.loop.run_forever()

    def rise(self, counters: Counter[str], key: str) -> int:
        """Turn once; by how much a counter rose."""
        before = counters[key]
        self.turn()
        return counters[key] - before

    def do(self, work: Callable[[], object]) -> None:
        """Work that wants a running loop."""

        async def within() -> None:
            work()

        self.loop.run_until_complete(within())

    def close(self) -> None:
        for server in self._servers:
            self.do(server.close)
        self.loop.close()


def pester(connect: Callable[[], Client], valid: Sequence[bytes]) -> None:
    """Send requests with wrong bytes in them, and bytes that are none; who is thrown out connects anew."""
    numbers = random.Random(5)
    client = connect()
    for _ in range(1500):
        sent = bytearray(b"".join(numbers.choices(valid, k=numbers.randrange(1, 4))))
        for _ in range(numbers.randrange(4)):
            sent[numbers.randrange(len(sent))] = numbers.randrange(256)
        if numbers.random() < 0.1:
            sent = bytearray(numbers.randbytes(numbers.randrange(1, 400)))
        try:
            client.socket.sendall(sent)
            client.socket.settimeout(0.002)
            if client.socket.recv(65536) == b"":
                raise ConnectionResetError
        except TimeoutError:
            continue
        except ConnectionError:
            client.socket.close()
            client = connect()
    client.socket.close()


def is_closed(client: RawModbus, within_s: float = 3.0) -> bool:
    """Whether the server closes the connection without another word."""
    client.socket.settimeout(within_s)
    try:
        return client.socket.recv(100) == b""
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False


def connect_from(host: str, port: int) -> socket.socket:
    """Connect from another address of this machine."""
    link = socket.socket()
    link.settimeout(5)
    link.bind((host, 0))
    with contextlib.suppress(ConnectionResetError):
        link.connect(("127.0.0.1", port))
    return link
