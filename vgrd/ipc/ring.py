"""One writer, many readers, n slots in a memory-mapped file: how data travel between processes.

Layout, native byte order (a ring never leaves its machine)::

    header (one page)   magic, slots, slot_bytes, kind, crc | last index, retired
    slot (64-aligned)   sequence, index, stamp_s, length, crc | payload

Message i (1, 2, ...) goes to slot i % slots. Its sequence is 2 i - 1 while it is written and 2 i
when it is whole; the header's last index follows. A reader copies the payload between two looks at
the sequence: it never blocks the writer, and a writer killed half-way leaves the previous message
newest.

Sequence, last index and retired are loaded and stored through `memoryview.cast("Q")`, one aligned
8-byte access each (`struct` with "<Q" goes byte by byte). x86 keeps stores in order and loads in
order (TSO), which is what a sequence lock needs. ARM may reorder both, and Python has no fence:
there small payloads stay safe through their CRC-32 (over index, stamp, length and payload). For
pixels (crc=False) the CRC covers the slot's header only; what protects them is that the writer
comes back to a slot `slots - 1` messages later: milliseconds against a store buffer's nanoseconds.

A restarted writer makes a new file, renames it over the old one and marks the old one retired:
readers move over at their next look. The index counts on, so `since(index)` holds across it.
Somebody who deletes the file leaves nothing to mark, and the index begins anew: a reader whose ring
brings nothing new looks, at most each 50 ms, whether another file has taken the path.
The files are private to the user (0600): whoever truncates one kills the processes that map it.
"""

import os
import secrets
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from vgrd.clock import Clock, SystemClock
from vgrd.errors import IpcError, RingUnavailable
from vgrd.ipc.ring_file import (
    CRC_OFFSET,
    FILE,
    LAST,
    MAGIC,
    RETIRED,
    SLOT,
    SLOT_HEADER_BYTES,
    Buffer,
    RingFile,
    allocate,
    is_whole,
    open_kind,
    whole_header,
)

_ATTEMPTS = 100  # chosen: a reader meets a slot half written once in a while, not a hundred times
_POLL_S = 0.001  # chosen: far below the shortest period of a writer (2 ms)
_KIND_BYTES = 16  # of the kind in the header, see `ring_file.FILE`
_LOOK_S = 0.05  # far below every deadline; a look costs 2 us
_CLOCK = SystemClock()


@dataclass(frozen=True, slots=True)
class Message:
    """One published payload, copied out: `index` counts from 1, `stamp_s` is the writer's."""

    index: int
    stamp_s: float
    payload: bytes


class RingWriter:
    """The one writer of a ring."""

    def __init__(self, mapping: RingFile) -> None:
        self._map = mapping
        self._index: int = mapping.words[LAST]

    @classmethod
    def create(
        cls, path: Path | str, slots: int, slot_bytes: int, kind: str, *, crc: bool = True
    ) -> Self:
        """Make the ring's file, in place of an earlier one whose readers will move over.

        `kind` (at most 16 ASCII characters) must be asked for by readers. `crc=False` for pixels.
        Raises IpcError when the file cannot be made.
        """
        if slots < 2 or slot_bytes < 1 or len(kind.encode("ascii")) > _KIND_BYTES:
            raise IpcError(
                f"{path}: a ring needs 2 slots of 1 byte and a kind of {_KIND_BYTES} characters"
            )
        path = Path(path)
        fresh = path.with_name(f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}")
        old = _open_or_none(path)
        try:
            allocate(fresh, slots, slot_bytes)
            head = FILE.pack(MAGIC, slots, slot_bytes, int(crc), kind.encode("ascii"))
            with fresh.open("r+b") as file:
                file.write(head)
            mapping = RingFile(fresh, write=True)
            mapping.words[LAST] = old.words[LAST] if old else 0
            fresh.replace(path)
        except OSError as error:
            fresh.unlink(missing_ok=True)
            raise IpcError(f"{path}: cannot make the ring: {error.strerror}") from error
        mapping.path = path
        if old:
            old.words[RETIRED] = 1
            old.close()
        return cls(mapping)

    @property
    def index(self) -> int:
        """Index of the last message published."""
        return self._index

    def publish(self, *buffers: Buffer, stamp_s: float) -> int:
        """Write one message, `buffers` end to end, and return its index.

        Raises IpcError when it does not fit a slot.
        """
        views = [memoryview(b).cast("B") for b in buffers]
        length = sum(v.nbytes for v in views)
        ring = self._map
        if length > ring.slot_bytes:
            raise IpcError(
                f"{ring.path}: message of {length} bytes, the slots hold {ring.slot_bytes}"
            )
        index = self._index + 1
        start = ring.slot_at(index)
        ring.words[start // 8] = 2 * index - 1
        head = SLOT.pack(index, stamp_s, length)
        crc = zlib.crc32(head)
        offset = start + SLOT_HEADER_BYTES
        for view in views:
            ring.bytes[offset : offset + view.nbytes] = view
            offset += view.nbytes
            crc = zlib.crc32(view, crc) if ring.crc else crc
        ring.bytes[start + 8 : start + CRC_OFFSET] = head
        ring.words[(start + CRC_OFFSET) // 8] = crc
        ring.words[start // 8] = 2 * index
        ring.words[LAST] = index
        self._index = index
        return index

    def close(self) -> None:
        """Release the mapping; the file stays, readers keep the last messages."""
        self._map.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _open_or_none(path: Path) -> RingFile | None:
    try:
        return RingFile(path, write=True)
    except RingUnavailable:
        return None


class RingReader:
    """A reader of a ring; follows the writer across its restarts."""

    def __init__(self, mapping: RingFile, clock: Clock = _CLOCK) -> None:
        self._map = mapping
        self._clock = clock
        self._last = -1  # index at the last look
        self._look_s = 0.0

    @classmethod
    def open(cls, path: Path | str, kind: str, clock: Clock = _CLOCK) -> Self:
        """Open the ring at `path`. Raises RingUnavailable if it is absent or of another kind."""
        return cls(open_kind(Path(path), kind), clock)

    @property
    def index(self) -> int:
        """Index of the last message published, 0 before the first."""
        return int(self._current().words[LAST])

    def newest(self) -> Message | None:
        """Return the last message, None before this writer's first.

        Raises IpcError when no copy is whole (a damaged file).
        """
        for _ in range(_ATTEMPTS):
            ring = self._current()
            index = ring.words[LAST]
            if ring.words[ring.slot_at(index) // 8] == 0:
                return None
            message = self._copy(ring, index)
            if message:
                return message
        raise IpcError(f"{self._map.path}: no whole message in {_ATTEMPTS} attempts")

    def since(self, index: int) -> list[Message]:
        """Return the messages after `index` that are still there, oldest first.

        An `index` beyond the last one published belongs to an earlier ring: all messages are new.
        """
        ring = self._current()
        last = int(ring.words[LAST])
        first = max(index + 1 if index <= last else 1, last - ring.slots + 2)
        copies = [self._copy(ring, i) for i in range(max(first, 1), last + 1)]
        return [message for message in copies if message]

    def wait_newer(self, index: int, timeout_s: float, clock: Clock) -> Message | None:
        """Return the last message once it is not `index`, None after `timeout_s`; polls."""
        end_s = clock.monotonic() + timeout_s
        while True:
            if self.index != index:
                message = self.newest()
                if message and message.index != index:
                    return message
            if clock.monotonic() >= end_s:
                return None
            clock.sleep(_POLL_S)

    def close(self) -> None:
        """Release the mapping."""
        self._map.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _current(self) -> RingFile:
        """The ring's present file. Two clock-free loads while messages come."""
        words = self._map.words
        last = words[LAST]
        if words[RETIRED]:
            self._follow()
        elif last != self._last:
            self._last = last
        elif (now := self._clock.monotonic()) >= self._look_s:
            self._look_s = now + _LOOK_S
            if not self._map.is_at_its_path():
                self._follow()
        return self._map

    def _follow(self) -> None:
        """Go over to the file that has the path now; the old one stays while there is none."""
        try:
            fresh = open_kind(self._map.path, self._map.kind)
        except RingUnavailable:
            return
        self._map.close()
        self._map = fresh
        self._last = -1

    def _copy(self, ring: RingFile, index: int) -> Message | None:
        start = ring.slot_at(index)
        head = whole_header(ring, start, index)
        if head is None:
            return None
        stamp_s, length, crc = head
        offset = start + SLOT_HEADER_BYTES
        payload = bytes(ring.bytes[offset : offset + length])
        if not is_whole(ring, start, index, crc, payload):
            return None
        return Message(index, stamp_s, payload)
