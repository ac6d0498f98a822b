"""A Modbus TCP client down to the bytes: for abuse, and fast enough to measure servers with."""

import socket
import struct
from collections.abc import Sequence
from typing import Self


class RawModbus:
    """One connection; `call` sends a PDU and returns the answer's PDU."""

    def __init__(self, host: str, port: int, timeout_s: float = 5.0) -> None:  # then it hangs
        self.socket = socket.create_connection((host, port), timeout_s)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._transaction = 0
        self._received = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, pdu: bytes, unit: int = 1) -> None:
        """Send one request without waiting for its answer."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        self.socket.sendall(struct.pack(">HHHB", self._transaction, 0, len(pdu) + 1, unit) + pdu)

    def receive(self) -> tuple[int, int, bytes]:
        """Transaction, unit and PDU of the next answer; ConnectionError when the server closed."""
        while len(self._received) < 7 or len(self._received) < self._length():
            chunk = self.socket.recv(65536)
            if not chunk:
                raise ConnectionError("closed by the server")
            self._received += chunk
        transaction, _, _, unit = struct.unpack_from(">HHHB", self._received)
        length = self._length()
        pdu, self._received = self._received[7:length], self._received[length:]
        return transaction, unit, pdu

    def call(self, pdu: bytes, unit: int = 1) -> bytes:
        """Return the answer to one request."""
        self.send(pdu, unit)
        return self.receive()[2]

    def read(self, address: int, count: int, function: int = 3) -> bytes:  # Read Holding Registers
        """Return registers; ValueError with the exception code when the server refuses."""
        answer = self.call(struct.pack(">BHH", function, address, count))
        if answer[0] != function:
            raise ValueError(answer[1])
        return answer[2:]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write registers in one request; ValueError with the exception code when refused."""
        data = struct.pack(f">{len(words)}H", *words)
        answer = self.call(struct.pack(">BHHB", 16, address, len(words), len(data)) + data)
        if answer[0] != 16:
            raise ValueError(answer[1])

    def _length(self) -> int:
        return 6 + int.from_bytes(self._received[4:6], "big")
