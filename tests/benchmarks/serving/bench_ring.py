"""A 12 MP picture through the ring against plain memory copies.

Through the ring: `publish` (one copy in) and `newest` (one copy out), with all their checks.
The floor: the same bytes copied into a buffer that is already in memory, four of them in turn as the
ring has four slots, and out of it into new bytes, as a reader gets them.
"""

import tempfile
import time
from pathlib import Path

from tests.benchmarks.harness import Row, ratio_of
from vgrd.ipc.ring import RingReader, RingWriter

PIXELS = 4024 * 3036
SLOTS = 4
ROUNDS = 40
BAR = 1.5


def rows() -> list[Row]:
    """ring_image_vs_memcpy: time through the ring / time of two memcpys."""
    shared = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        path = Path(folder) / "image.ring"
        with (
            RingWriter.create(path, SLOTS, PIXELS, "image", crc=False) as writer,
            RingReader.open(path, "image") as reader,
        ):
            return [compare(writer, reader)]


def compare(writer: RingWriter, reader: RingReader) -> Row:
    """Alternate ring and memcpy on the same picture."""
    picture = memoryview(bytes(range(256)) * (PIXELS // 256 + 1))[:PIXELS]
    slots = [memoryview(bytearray(PIXELS)) for _ in range(SLOTS)]

    def through_ring() -> float:
        begin = time.perf_counter()
        writer.publish(picture, stamp_s=0.0)
        assert reader.newest() is not None
        return time.perf_counter() - begin

    def through_memory() -> float:
        slots.append(slots.pop(0))
        begin = time.perf_counter()
        slots[0][:] = picture
        bytes(slots[0])
        return time.perf_counter() - begin

    for _ in range(SLOTS):
        through_ring(), through_memory()
    ratio, ring_s, memory_s = ratio_of(through_ring, through_memory, ROUNDS)
    message = reader.newest()
    assert message is not None
    assert message.payload == picture
    note = f"{1e3 * ring_s:.2f} ms against {1e3 * memory_s:.2f} ms"
    return Row.at_most("ring_image_vs_memcpy", ratio, "x", BAR, note)
