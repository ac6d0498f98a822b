"""Robots' programs: Modbus frames in, Modbus frames out, over the gate's real connections without sockets.

A program writes requests, polls whole blocks or single registers, and hands what it read to `on_read`.
"""

import struct
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

from tests.invariant.simulation.simulated_time import SimulatedLoop
from vgrd.gate.gate import Gate
from vgrd.registers import REQUEST, RESPONSE

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_COIL, WRITE_MANY = 3, 4, 6, 5, 16
PEER = "127.0.0.1"
BLOCK: Final = RESPONSE.end - RESPONSE.start
_HEADER = struct.Struct(">HHHB")
_FRAME = struct.Struct(">HHHBBHH")


class Line:
    """What the gate takes for a socket: bytes that a robot sent, and what comes back."""

    def __init__(self) -> None:
        self.asked = self.answered = b""
        self.is_open = True

    def setblocking(self, flag: bool) -> None: ...

    def setsockopt(self, *option: object) -> None: ...

    def fileno(self) -> int:
        return 1 if self.is_open else -1

    def recv(self, count: int) -> bytes:
        if not self.asked:
            raise BlockingIOError
        received, self.asked = self.asked[:count], self.asked[count:]
        return received

    def send(self, data: bytes) -> int:
        self.answered += data
        return len(data)

    def close(self) -> None:
        self.is_open = False


class Link:
    """A robot's connection; made anew when the gate has closed it. None for an answer: there is none."""

    is_line = False  # of the line server

    def __init__(self, loop: SimulatedLoop) -> None:
        self.loop = loop
        self.line = Line()
        self.line.is_open = False
        self.gate: Gate | None = None
        self._transaction = 0

    def connect(self, gate: Gate | None) -> None:
        """To this gate, or to none: the line to the one before died with it."""
        self.gate = gate
        self.loop.remove_reader(self.line)
        self.line.is_open = False

    def send(self, data: bytes) -> bytes:
        """Send bytes, whatever they are; returns what comes back at once."""
        if self.gate is None or self.loop.is_stopped("gate"):
            return b""
        server = self.gate._lines if self.is_line else self.gate._server
        if not self.line.is_open:
            self.line = Line()
            self.on_new()
            server._admit(self.line, PEER)
        self.line.asked, self.line.answered = data, b""
        read = self.loop.lines.get(self.line)
        while read is not None and self.line.asked and self.line.is_open:
            read()
            if server._turns is not None:
                server._turns._turn()  # at this moment, so that the desk of the judge is that of the gate
        return self.line.answered

    def on_new(self) -> None:
        """A connection begins."""

    def read(self, address: int, count: int, function: int = READ_HOLDING) -> bytes | None:
        """Registers, big-endian."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        answer = self.send(_FRAME.pack(self._transaction, 0, 6, 1, function, address, count))
        if len(answer) != 9 + 2 * count or answer[:2] != self._transaction.to_bytes(2, "big"):
            return None
        return answer[9:]

    def write(self, address: int, words: list[int]) -> bool:
        """Write registers in one request."""
        body = struct.pack(
            f">BHHB{len(words)}H", WRITE_MANY, address, len(words), 2 * len(words), *words
        )
        answer = self.send(_HEADER.pack(1, 0, 1 + len(body), 1) + body)
        return len(answer) == 12 and answer[7] == WRITE_MANY

    def write_coil(self, address: int, on: bool) -> bool:
        answer = self.send(_FRAME.pack(1, 0, 6, 1, WRITE_COIL, address, 0xFF00 if on else 0))
        return len(answer) == 12 and answer[7] == WRITE_COIL


@dataclass(frozen=True, slots=True)
class Asked:
    """A request as a program wrote it, and when."""

    trig: int
    command: int
    point: int
    options: int = 0
    max_age_ms: int = 0
    max_u95_um: int = 0
    timeout_ms: int = 0
    orientation: tuple[int, int, int] = (0, 0, 0)
    at_s: float = 0.0

    def words(self) -> list[int]:
        """Registers 0-31."""
        values = dict.fromkeys((field.name for field in REQUEST.fields), 0)
        values |= {
            "TRIG": self.trig,
            "CMD": self.command,
            "POINT": self.point,
            "OPT": self.options,
            "MAXAGE": self.max_age_ms,
            "MAXU95": self.max_u95_um,
            "TMO": self.timeout_ms,
        }
        values |= dict(zip(("ORI_RX", "ORI_RY", "ORI_RZ"), self.orientation, strict=True))
        return list(struct.unpack(">32H", REQUEST.encode(values)))


def pieces(link: Link) -> Generator[int, None, bytes | None]:
    """Read the response register by register; yields the address of each one that was read.

    Returns the block, where SEQ was the same and even before and after, else None.
    """
    words: dict[int, bytes] = {}
    order = [RESPONSE.registers("EC32_SEQ")[0]]
    order += [at for at in range(RESPONSE.start, RESPONSE.end) if at not in order]
    for at in order:
        word = link.read(at, 1, READ_INPUT)
        if word is None:
            return None
        words[at] = word
        yield at
    again = link.read(order[0], 1, READ_INPUT)
    if again is None or again != words[order[0]] or again[1] & 1:
        return None
    return b"".join(words[at] for at in range(RESPONSE.start, RESPONSE.end))
