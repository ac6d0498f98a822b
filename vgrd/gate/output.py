"""Standard error that never blocks: a full pipe or a stuck journal must not stop the registers."""

import io
import os
import socket
import stat


class UnblockedStream(io.TextIOBase):
    """Writes lines to a descriptor if it takes them now, else drops and counts them.

    The descriptor is opened anew, since O_NONBLOCK on the inherited one would hit all its users.
    """

    def __init__(self, fd: int) -> None:
        self.dropped = 0
        self._terminal = os.isatty(fd)
        self._socket: socket.socket | None = None
        self._fd = -1
        if stat.S_ISSOCK(os.fstat(fd).st_mode):
            self._socket = socket.socket(fileno=os.dup(fd))
        else:
            self._fd = _reopened(fd)

    def isatty(self) -> bool:
        """Whether a person reads."""
        return self._terminal

    def writable(self) -> bool:
        """Yes."""
        return True

    def write(self, text: str) -> int:
        """Write or drop `text`; the next line that gets through tells how many were dropped."""
        if self.dropped:
            text = f"({self.dropped} lines dropped: standard error was full)\n{text}"
        try:
            self._send(text.encode())
        except OSError:
            self.dropped += 1
        else:
            self.dropped = 0
        return len(text)

    def _send(self, data: bytes) -> None:
        if self._socket:
            self._socket.send(data, socket.MSG_DONTWAIT)
        else:
            os.write(self._fd, data)


def _reopened(fd: int) -> int:
    """Open the same file again, not blocking; only a copy where that is not allowed."""
    try:
        flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_CLOEXEC
        return os.open(f"/proc/self/fd/{fd}", flags)
    except OSError:
        return os.dup(fd)
