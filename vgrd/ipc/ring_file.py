"""The memory-mapped file of a ring: its geometry, and the words that order its messages."""

import mmap
import os
import struct
from pathlib import Path

from vgrd.errors import RingUnavailable
from vgrd.permissions import opener

MAGIC = b"VGRDRNG1"
FILE = struct.Struct("=8sQQQ16s")
HEADER_BYTES = 4096
LAST, RETIRED = 192 // 8, 256 // 8  # words, a cache line each
SLOT_HEADER_BYTES = 64


class RingFile:
    """The mapped file with its geometry."""

    def __init__(self, path: Path, *, write: bool) -> None:
        self.path = path
        flags = os.O_RDWR if write else os.O_RDONLY
        try:
            fd = os.open(path, flags | os.O_CLOEXEC)
        except OSError as error:
            raise RingUnavailable(f"{path}: cannot open the ring: {error.strerror}") from error
        try:
            status = os.fstat(fd)
            size, self._file = status.st_size, (status.st_dev, status.st_ino)
            if size < HEADER_BYTES:
                raise RingUnavailable(f"{path}: {size} bytes are too few for a ring")
            access = mmap.ACCESS_WRITE if write else mmap.ACCESS_READ
            self._mmap = mmap.mmap(fd, size, access=access)
        finally:
            os.close(fd)
        magic, self.slots, self.slot_bytes, self.crc, kind = FILE.unpack_from(self._mmap, 0)
        self.kind = kind.rstrip(b"\0").decode("ascii", "replace")
        self.stride = stride_of(self.slot_bytes)
        if magic != MAGIC or size != HEADER_BYTES + self.slots * self.stride:
            self._mmap.close()
            raise RingUnavailable(f"{path}: not a ring of this version")
        self.bytes = memoryview(self._mmap)
        self.words = self.bytes.cast("Q")

    def slot_at(self, index: int) -> int:
        """Offset of the slot of message `index`."""
        return int(HEADER_BYTES + (index % self.slots) * self.stride)

    def is_at_its_path(self) -> bool:
        """Whether the path still leads to the mapped file, or to none."""
        try:
            status = self.path.stat()
        except OSError:
            return True
        return (status.st_dev, status.st_ino) == self._file

    def close(self) -> None:
        """Unmap; the file stays."""
        self.words.release()
        self.bytes.release()
        self._mmap.close()


def stride_of(slot_bytes: int) -> int:
    """Bytes from slot to slot."""
    return -(-(SLOT_HEADER_BYTES + slot_bytes) // 64) * 64


def allocate(path: Path, slots: int, slot_bytes: int) -> None:
    """Reserve the whole file now: a full disk is an error here, not a SIGBUS later."""
    fd = opener(str(path), os.O_RDWR | os.O_CREAT | os.O_EXCL)
    try:
        os.posix_fallocate(fd, 0, HEADER_BYTES + slots * stride_of(slot_bytes))
    finally:
        os.close(fd)
