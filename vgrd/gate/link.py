"""The gate's end of the socket pair to the cell: JSON lines out, JSON lines in, never waiting."""

import asyncio
import socket
from collections.abc import Callable

import structlog

from vgrd.errors import ControlError
from vgrd.ipc.messages import MAX_LINE_BYTES, decode_line, encode_line

log = structlog.get_logger()


class CellLink:
    """One life of the cell; `on_message` gets what it says."""

    def __init__(
        self, ours: socket.socket, on_message: Callable[[dict[str, object]], None]
    ) -> None:
        ours.setblocking(False)
        self._socket = ours
        self._on_message = on_message
        self._unread = b""
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(ours, self._read)

    def send(self, **message: object) -> bool:
        """Send a message; False when the cell is gone or has stopped reading, which ends the link."""
        if self._socket.fileno() < 0:
            return False
        line = encode_line(message)
        try:
            if self._socket.send(line) == len(line):
                return True
        except OSError as error:
            log.warning("cell_unreachable", reason=error.strerror)
        self.close()
        return False

    def close(self) -> None:
        """Hang up; may be called more than once."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket)
            self._socket.close()

    def _read(self) -> None:
        try:
            received = self._socket.recv(65536)
        except OSError:
            received = b""
        *lines, self._unread = (self._unread + received).split(b"\n")
        if not received or len(self._unread) > MAX_LINE_BYTES:
            self.close()
        for line in lines:
            try:
                self._on_message(decode_line(line))
            except ControlError as error:
                log.warning("cell_message_dropped", reason=str(error))
