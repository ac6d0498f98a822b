"""Reading MCAP segments whatever happened to them: every chunk whose CRC is right, nothing else.

No stored index and no length outside a verified chunk is followed, so that a flipped bit costs the
chunk that it is in and no other.
"""

import mmap
import os
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from vgrd.store.files import guarded, replacing, sync_directory
from vgrd.store.topics import Topic, open_writer

# MCAP: opcode, length, start, end, uncompressed size, CRC, empty compression name, records size.
_CHUNK = struct.Struct("<BQQQQIIQ")
_CHUNK_START = re.compile(rb"\x06.{4}\x00{4}.{28}\x00{4}", re.DOTALL)
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_MESSAGE_OPCODE = 0x05  # MCAP specification, opcodes
_TOPICS = frozenset(Topic)


class StoredMessage(NamedTuple):
    """One message of a segment; time_ns: Unix time."""

    topic: Topic
    time_ns: int
    data: bytes


def read_messages(path: Path, topics: frozenset[Topic] = _TOPICS) -> Iterator[StoredMessage]:
    """Every undamaged message of a segment, closed or not, as written. Raises StoreError."""
    with guarded("read", path), path.open("rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            for begin, end in _chunks(content):
                yield from _messages(content, begin, end, topics)


def recover(directory: Path) -> tuple[Path, ...]:
    """Rewrite each `.mcap.open` as an indexed `.mcap`; the original is kept as `.mcap.damaged`.

    Returns the segments recovered. May be killed and repeated at any point. No writer may be at
    work in `directory`. Raises StoreError.
    """
    return tuple(_recover_segment(path) for path in sorted(directory.glob("*.mcap.open")))


def _recover_segment(damaged: Path) -> Path:
    path = damaged.with_suffix("")
    with guarded("recover", damaged):
        with replacing(path) as stream:
            writer = open_writer(stream)
            for message in read_messages(damaged):
                writer.add_message(message.topic, message.time_ns, message.data, message.time_ns)
            writer.finish()  # type: ignore[no-untyped-call]
        damaged.replace(path.with_name(f"{path.name}.damaged"))
        sync_directory(path.parent)
    return path


def _chunks(content: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Begin and end of the records of each chunk whose sizes agree and whose CRC is right."""
    position = 0
    while match := _CHUNK_START.search(content, position):
        start = match.start()
        _, length, _, _, size, crc, _, stored = _CHUNK.unpack_from(content, start)
        begin = start + _CHUNK.size
        end = begin + stored
        agree = size == stored == length - (_CHUNK.size - _RECORD.size) and end <= len(content)
        if agree and _crc(content, begin, end) == crc:
            yield begin, end
            position = end
        else:
            position = start + 1


def _crc(content: mmap.mmap, begin: int, end: int) -> int:
    with memoryview(content) as whole, whole[begin:end] as part:
        return zlib.crc32(part)


def _messages(
    content: mmap.mmap, begin: int, end: int, topics: frozenset[Topic]
) -> Iterator[StoredMessage]:
    position = begin
    while position < end:
        opcode, length = _RECORD.unpack_from(content, position)
        position += _RECORD.size
        if opcode == _MESSAGE_OPCODE:
            channel, _, time_ns, _ = _MESSAGE.unpack_from(content, position)
            if channel in topics:
                data = content[position + _MESSAGE.size : position + length]
                yield StoredMessage(Topic(channel), time_ns, data)
        position += length
