"""A client of the line server down to the bytes: a controller without Modbus, well or badly behaved."""

import socket
from typing import Self


class RawLines:
    """One connection."""

    def __init__(self, host: str, port: int, timeout_s: float = 5.0) -> None:  # then it hangs
        self.socket = socket.create_connection((host, port), timeout_s)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def call(self, request: bytes, end: bytes = b"\n") -> str:
        """Send, and read to the end of an answer; ConnectionError when the server closed."""
        self.socket.sendall(request)
        received = b""
        while not received.endswith(end):
            chunk = self.socket.recv(4096)
            if not chunk:
                raise ConnectionError("closed by the server")
            received += chunk
        return received.decode("ascii")

    def ask(self, point: int, trig: int, options: int = 0) -> list[str]:
        """Ask for a point, or for the answer again: the fields."""
        return self.call(f"EC,{point},{trig},,,{options}\n".encode()).strip().split(",")
