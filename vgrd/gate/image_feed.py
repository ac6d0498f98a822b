"""What the cell publishes, as the gate sees it."""

import math
from dataclasses import replace
from pathlib import Path

from vgrd.clock import Clock
from vgrd.errors import IpcError
from vgrd.ipc.ring import RingReader
from vgrd.registers import REGISTER_KIND, REGISTER_RING, RegisterImage

_REOPEN_S = 0.05  # a few of the cell's 20 ms images, and far below the deadline (0.25 s)


class ImageFeed:
    """The cell's newest register image; keeps the last one when the cell is gone."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self.image: RegisterImage | None = None
        self._path = runtime_dir / REGISTER_RING
        self._clock = clock
        self._reader: RingReader | None = None
        self._index = 0
        self._retry_s = -math.inf

    def poll(self) -> bool:
        """Take a newer image, if there is one."""
        try:
            reader = self._reader or self._opened()
            return reader is not None and reader.index != self._index and self._take(reader)
        except IpcError:
            self._reader = None
            return False

    def lose(self) -> None:
        """Treat the image as too old from now on, also its last one: its writer is dead."""
        self.poll()
        if self.image:
            self.image = replace(self.image, published_s=-math.inf)

    def _opened(self) -> RingReader | None:
        now = self._clock.monotonic()
        if now < self._retry_s:
            return None
        self._retry_s = now + _REOPEN_S
        self._reader = RingReader.open(self._path, REGISTER_KIND, self._clock)
        return self._reader

    def _take(self, reader: RingReader) -> bool:
        message = reader.newest()
        if message is None:
            return False
        self._index = message.index
        self.image = RegisterImage.unpack(message.payload)
        return True
