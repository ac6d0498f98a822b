"""A serial line between two programs of this machine: a pair of pseudo-terminals that carry bytes across."""

import contextlib
import os
import selectors
import threading
import tty
from typing import Self

BAUD = 115200  # a pseudo-terminal takes any and is as fast as it can
_CHUNK = 4096  # more than any message


class SerialLine:
    """From `with` to its end; `ends` are the paths of its two ends, as of two serial ports."""

    def __enter__(self) -> Self:
        self._descriptors: list[int] = []
        masters, ends = [], []
        for _ in range(2):
            master, end = os.openpty()
            tty.setraw(end)
            self._descriptors += [master, end]
            masters.append(master)
            ends.append(os.ttyname(end))
        self.ends = (ends[0], ends[1])
        self._stop, self._wake = os.pipe()
        self._thread = threading.Thread(
            target=self._carry, args=tuple(masters), name="serial line", daemon=True
        )
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._wake)  # the other end of the pipe becomes readable
        self._thread.join()
        for descriptor in (*self._descriptors, self._stop):
            os.close(descriptor)

    def _carry(self, one: int, other: int) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(one, selectors.EVENT_READ, other)
            selector.register(other, selectors.EVENT_READ, one)
            selector.register(self._stop, selectors.EVENT_READ, None)
            while True:
                for key, _ in selector.select():
                    if key.data is None:
                        return
                    with contextlib.suppress(OSError):  # a line of which nobody holds the end
                        os.write(key.data, os.read(key.fd, _CHUNK))
