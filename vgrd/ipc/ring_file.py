"""The memory-mapped file of a ring: its geometry, the words that order its messages, its slots."""

import mmap
import os
import struct
import zlib
from pathlib import Path

from vgrd.errors import RingUnavailable
from vgrd.permissions import opener

MAGIC = b"VGRDRNG1"
FILE = struct.Struct("=8sQQQ16s")
HEADER_BYTES = 4096  # a page
CACHE_LINE_BYTES = 64  # of x86 and most ARM: words in lines of their own do not slow each other
_LINE_WORDS = CACHE_LINE_BYTES // 8  # a word has 8 bytes: what is loaded and stored at once
LAST, RETIRED = 3 * _LINE_WORDS, 4 * _LINE_WORDS  # behind FILE; line 2 held a generation once
SLOT_HEADER_BYTES = CACHE_LINE_BYTES
SLOT = struct.Struct("=QdQ")  # index, stamp_s, length; follows the sequence
CRC_OFFSET = 8 + SLOT.size  # behind the sequence, a word, and what follows it

Buffer = bytes | bytearray | memoryview


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


def open_kind(path: Path, kind: str) -> RingFile:
    """Open a ring to read it. Raises RingUnavailable if it is absent or of another kind."""
    mapping = RingFile(path, write=False)
    if mapping.kind != kind:
        mapping.close()
        raise RingUnavailable(f"{path}: holds '{mapping.kind}', not '{kind}'")
    return mapping


def stride_of(slot_bytes: int) -> int:
    """Bytes from slot to slot."""
    return -(-(SLOT_HEADER_BYTES + slot_bytes) // CACHE_LINE_BYTES) * CACHE_LINE_BYTES


def allocate(path: Path, slots: int, slot_bytes: int) -> None:
    """Reserve the whole file now: a full disk is an error here, not a SIGBUS later."""
    fd = opener(str(path), os.O_RDWR | os.O_CREAT | os.O_EXCL)
    try:
        os.posix_fallocate(fd, 0, HEADER_BYTES + slots * stride_of(slot_bytes))
    finally:
        os.close(fd)


def whole_header(ring: RingFile, start: int, index: int) -> tuple[float, int, int] | None:
    """(stamp_s, length, CRC of the header) of message `index`, None if its slot is not whole."""
    if ring.words[start // 8] != 2 * index:
        return None
    head = bytes(ring.bytes[start + 8 : start + CRC_OFFSET])
    stored = ring.words[(start + CRC_OFFSET) // 8]
    stored_index, stamp_s, length = SLOT.unpack(head)
    crc = zlib.crc32(head)
    if stored_index != index or length > ring.slot_bytes or (not ring.crc and crc != stored):
        return None
    return stamp_s, length, crc


def is_whole(ring: RingFile, start: int, index: int, crc: int, payload: Buffer) -> bool:
    """Whether `payload`, copied from a slot, is that of message `index`; crc: of its header."""
    stored = ring.words[(start + CRC_OFFSET) // 8]
    if ring.crc and zlib.crc32(payload, crc) != stored:
        return False
    return bool(ring.words[start // 8] == 2 * index)
