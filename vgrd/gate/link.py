"""The gate's end of the socket pair to the cell: JSON lines out, JSON lines in, never waiting.

Only the newest message counts: a request replaces an older request, `abort` replaces a request. So the
link keeps one unsent message, and the rest of a line that was sent in part. It never keeps more,
however long the cell does not read and however often the robot asks.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Final

import structlog

from vgrd.errors import ControlError
from vgrd.ipc.messages import MAX_LINE_BYTES, decode_line, encode_line

_SEND_BUFFER_BYTES: Final = 4608  # Linux doubles it (socket(7)): some eight lines, few are stale
_READ_BYTES: Final = 65536  # at once; a longer line comes in parts

log = structlog.get_logger()


class CellLink:
    """One life of the cell; `on_message` gets what it says."""

    def __init__(
        self, gate_end: socket.socket, on_message: Callable[[dict[str, object]], None]
    ) -> None:
        gate_end.setblocking(False)
        gate_end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self._socket = gate_end
        self._on_message = on_message
        self._unread = b""
        self._sending = memoryview(b"")  # rest of the line that is half out
        self._newest = b""  # the line after it
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(gate_end, self._read)

    def send(self, **message: object) -> bool:
        """Send a message, in place of one that the cell has not taken yet; False when it is gone."""
        if self._socket.fileno() < 0:
            return False
        waits = bool(self._sending or self._newest)
        self._newest = encode_line(message)
        if not waits:
            self._write()
        return self._socket.fileno() >= 0

    def close(self) -> None:
        """Hang up; may be called more than once."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
            self._socket.close()

    def _write(self) -> None:
        """Send what the cell takes now; the loop calls again when it takes more."""
        try:
            while self._sending or self._newest:
                if not self._sending:
                    self._sending, self._newest = memoryview(self._newest), b""
                self._sending = self._sending[self._socket.send(self._sending) :]
        except BlockingIOError:
            self._loop.add_writer(self._socket, self._write)
        except OSError as error:
            log.warning("cell_unreachable", reason=error.strerror)
            self.close()
        else:
            self._loop.remove_writer(self._socket)

    def _read(self) -> None:
        try:
            received = self._socket.recv(_READ_BYTES)
        except BlockingIOError:
            return
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
