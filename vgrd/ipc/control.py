"""Client of the daemon's control socket: one request, one reply, as JSON lines."""

import socket
import time
from contextlib import suppress
from pathlib import Path

from vgrd.errors import ControlError, DaemonUnreachable
from vgrd.ipc.messages import MAX_LINE_BYTES, decode_line, encode_line
from vgrd.permissions import way_in

_QUEUE_FULL_S = 0.02  # the cell's loop turns at least so often
_REPLY_S = 10.0  # chosen: the two pictures of a sample, 5 s each
_SHORTEST_WAIT_S = 1e-3  # a socket takes 0 for not to wait at all
_READ_BYTES = 65536  # at once; a longer reply comes in parts


class ControlClient:
    """Asks the daemon whose control socket is at `path`; a connection of its own per call."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)

    def call(self, op: str, *, timeout_s: float = _REPLY_S, **args: object) -> dict[str, object]:
        """Return the result of `op`.

        Raises ControlError when the daemon refuses or answers nonsense, DaemonUnreachable when
        nobody answers within `timeout_s`.
        """
        line = self._exchange(encode_line({"id": 1, "op": op, **args}), timeout_s)
        reply = decode_line(line)
        if reply.get("ok") is False and reply.get("id") in (1, None):  # None: not even read
            error = str(reply.get("error", "ControlError"))
            raise ControlError(str(reply.get("message", error)), error=error)
        if reply.get("id") != 1 or reply.get("ok") is not True:
            raise ControlError(f"{self.path}: the daemon's reply to '{op}' has no id or no ok")
        result = reply.get("result")
        if not isinstance(result, dict):
            raise ControlError(f"{self.path}: the daemon's reply to '{op}' holds no result")
        return result

    def _exchange(self, request: bytes, timeout_s: float) -> bytes:
        end_s = time.monotonic() + timeout_s
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
                link.settimeout(timeout_s)
                self._connect(link, end_s)
                with suppress(BrokenPipeError):  # refused before it was read: the reply says why
                    link.sendall(request)
                return _read_line(link, end_s)
        except PermissionError as error:
            raise DaemonUnreachable(
                f"{self.path}: {error.strerror}; {way_in(self.path)}"
            ) from error
        except OSError as error:
            raise DaemonUnreachable(
                f"{self.path}: no answer ({_reason(error)}); is `vgrd run` active?"
            ) from error

    def _connect(self, link: socket.socket, end_s: float) -> None:
        """Connect, also when many do so at once and the daemon's queue is full for the moment."""
        while True:
            try:
                link.connect(str(self.path))
            except BlockingIOError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(_QUEUE_FULL_S)
            else:
                return


def _read_line(link: socket.socket, end_s: float) -> bytes:
    received = bytearray()
    while not received.endswith(b"\n"):
        link.settimeout(max(_SHORTEST_WAIT_S, end_s - time.monotonic()))
        chunk = link.recv(_READ_BYTES)
        if not chunk:
            raise ConnectionResetError("closed before the reply was whole")
        received += chunk
        if len(received) > MAX_LINE_BYTES:
            raise ControlError(f"reply of more than {MAX_LINE_BYTES} bytes")
        if time.monotonic() > end_s:
            raise TimeoutError
    return bytes(received)


def _reason(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "timed out"
    return error.strerror or str(error)
