import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fakes.testing import ManualClock
from vgrd.clock import SystemClock
from vgrd.errors import IpcError, RingUnavailable
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.ipc.ring_file import RingFile
from vgrd.orphans import dying_with_us

KIND = "test"
# Publishes forever; every 8-byte word of message i holds i, so a mixed payload shows itself.
RACER = """
import struct, sys, time
from vgrd.ipc.ring import RingWriter
path, slots, words, crc = sys.argv[1], *map(int, sys.argv[2:5])
writer = RingWriter.create(path, slots, 8 * words, "test", crc=bool(crc))
print("up", flush=True)
while True:
    i = writer.index + 1
    writer.publish(struct.pack("=Q", i) * words, stamp_s=float(i))
"""


def start_racer(path: Path, slots: int, words: int, *, crc: bool) -> subprocess.Popen[str]:
    argv = [sys.executable, "-c", RACER, str(path), str(slots), str(words), str(int(crc))]
    process = subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    return process


def stop(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def is_one_message(payload: bytes, index: int) -> bool:
    return payload == struct.pack("=Q", index) * (len(payload) // 8)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "test.ring"


def test_a_message_arrives_with_its_index_and_stamp(path):
    with RingWriter.create(path, 4, 64, KIND) as writer, RingReader.open(path, KIND) as reader:
        assert reader.newest() is None
        assert writer.publish(b"one ", b"two", stamp_s=1.5) == 1
        message = reader.newest()
        assert message is not None
        assert (message.index, message.stamp_s, message.payload) == (1, 1.5, b"one two")
        assert reader.index == writer.index == 1


def test_since_gives_what_is_still_there_oldest_first(path):
    with RingWriter.create(path, 4, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        assert reader.since(0) == []
        for i in range(1, 11):
            writer.publish(bytes([i]), stamp_s=0.0)
        assert [m.payload[0] for m in reader.since(0)] == [8, 9, 10]
        assert [m.payload[0] for m in reader.since(9)] == [10]
        assert reader.since(10) == []
        assert [m.index for m in reader.since(99)] == [8, 9, 10]


def test_pixels_come_in_one_piece_with_their_header(path):
    pixels = os.urandom(100_000)
    with (
        RingWriter.create(path, 3, 100_016, KIND, crc=False) as writer,
        RingReader.open(path, KIND) as reader,
    ):
        assert reader.newest() is None
        writer.publish(b"0123456789abcdef", memoryview(pixels), stamp_s=2.0)
        message = reader.newest()
        assert message is not None
        assert message.payload == b"0123456789abcdef" + pixels


def test_wait_newer_returns_at_the_deadline_and_on_a_message(path):
    clock = SystemClock()
    with RingWriter.create(path, 4, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        assert reader.wait_newer(0, 0.01, clock) is None
        writer.publish(b"x", stamp_s=0.0)
        message = reader.wait_newer(0, 1.0, clock)
        assert message is not None
        assert message.index == 1


def test_a_payload_longer_than_a_slot_is_refused_and_harms_nothing(path):
    with RingWriter.create(path, 4, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        writer.publish(b"good", stamp_s=0.0)
        with pytest.raises(IpcError, match="9 bytes, the slots hold 8"):
            writer.publish(bytes(9), stamp_s=0.0)
        message = reader.newest()
        assert message is not None
        assert message.payload == b"good"


def test_a_missing_file_another_kind_and_garbage_are_unavailable(path, tmp_path):
    with pytest.raises(RingUnavailable, match="No such file"):
        RingReader.open(path, KIND)
    RingWriter.create(path, 2, 8, "pixels").close()
    with pytest.raises(RingUnavailable, match="holds 'pixels', not 'test'"):
        RingReader.open(path, KIND)
    (tmp_path / "garbage").write_bytes(os.urandom(9000))
    with pytest.raises(RingUnavailable, match="not a ring"):
        RingReader.open(tmp_path / "garbage", KIND)


def test_a_flipped_bit_in_a_small_payload_is_never_handed_out(path):
    with RingWriter.create(path, 2, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        writer.publish(b"12345678", stamp_s=0.0)
        data = bytearray(path.read_bytes())
        at = data.index(b"12345678")
        with path.open("r+b") as file:
            file.seek(at)
            file.write(b"02345678")
        with pytest.raises(IpcError, match="no whole message"):
            reader.newest()


def test_a_restarted_writer_is_noticed_and_the_index_counts_on(path):
    with RingWriter.create(path, 4, 8, KIND) as writer:
        writer.publish(b"old", stamp_s=0.0)
    with RingReader.open(path, KIND) as reader, RingWriter.create(path, 8, 16, KIND) as writer:
        assert reader.newest() is None
        assert writer.publish(b"new", stamp_s=0.0) == 2
        assert [m.payload for m in reader.since(1)] == [b"new"]


@pytest.mark.parametrize("look", ["newest", "since", "index", "wait"])
def test_a_ring_whose_file_was_deleted_before_its_writer_came_back_is_followed(path, look):
    sundial = ManualClock()
    with RingWriter.create(path, 4, 8, KIND) as writer:
        writer.publish(b"old", stamp_s=0.0)
    with RingReader.open(path, KIND, sundial) as reader:
        assert reader.newest().payload == b"old"
        path.unlink()
        for _ in range(3):
            sundial.now_s += 0.06
            assert reader.newest().payload == b"old"
        with RingWriter.create(path, 4, 8, KIND) as writer:
            writer.publish(b"new", stamp_s=0.0)
            writer.publish(b"newer", stamp_s=0.0)
            sundial.now_s += 0.06
            seen = {
                "newest": lambda: reader.newest().payload == b"newer",
                "since": lambda: [m.payload for m in reader.since(9)] == [b"new", b"newer"],
                "index": lambda: reader.index == 2,
                "wait": lambda: reader.wait_newer(1, 0.0, SystemClock()).payload == b"newer",
            }
            assert seen[look]()


def test_a_reader_looks_for_its_file_only_when_nothing_new_comes_and_not_often(path, monkeypatch):
    looks, sundial = [], ManualClock()
    monkeypatch.setattr(RingFile, "is_at_its_path", lambda self: looks.append(self) or True)
    with (
        RingWriter.create(path, 4, 8, KIND) as writer,
        RingReader.open(path, KIND, sundial) as reader,
    ):
        for _ in range(1000):
            writer.publish(b"x", stamp_s=0.0)
            assert reader.index == writer.index
            sundial.now_s += 1.0
        assert looks == []
        for _ in range(1000):
            assert reader.newest() is not None
            sundial.now_s += 0.001
        assert 19 <= len(looks) <= 21


def test_a_file_that_is_no_ring_at_the_path_leaves_the_reader_its_old_one(path):
    sundial = ManualClock()
    with (
        RingWriter.create(path, 4, 8, KIND) as writer,
        RingReader.open(path, KIND, sundial) as reader,
    ):
        writer.publish(b"old", stamp_s=0.0)
        path.unlink()
        for rubbish in (b"", os.urandom(9000)):
            path.write_bytes(rubbish)
            sundial.now_s += 1.0
            assert reader.newest().payload == b"old"
        writer.publish(b"still", stamp_s=0.0)
        sundial.now_s += 1.0
        assert reader.newest().payload == b"still"
        path.unlink()
        with RingWriter.create(path, 4, 8, KIND) as writer:
            writer.publish(b"new", stamp_s=0.0)
            sundial.now_s += 1.0
            assert reader.newest().payload == b"new"


def test_a_ring_that_is_retired_and_then_gone_can_still_be_read(path):
    with RingWriter.create(path, 4, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        writer.publish(b"old", stamp_s=0.0)
        RingWriter.create(path, 4, 8, KIND).close()
        path.unlink()
        assert reader.newest().payload == b"old"
        with RingWriter.create(path, 4, 8, KIND) as writer:
            writer.publish(b"new", stamp_s=0.0)
            assert reader.newest().payload == b"new"


@pytest.mark.parametrize(
    ("reads", "words", "crc"),
    [(1_000_000, 20, True), (100_000, 20, False), (2_000, 100_000, False)],
    ids=["a million small", "small by sequence alone", "image size"],
)
def test_no_read_is_torn_under_a_racing_writer(path, reads, words, crc):
    racer = start_racer(path, 4, words, crc=crc)
    try:
        with RingReader.open(path, KIND) as reader:
            assert reader.wait_newer(0, 10.0, SystemClock())
            torn = 0
            first = last = reader.index
            for _ in range(reads):
                message = reader.newest()
                assert message is not None
                torn += not is_one_message(message.payload, message.index)
                torn += message.index < last
                last = message.index
            assert torn == 0
            assert last > first
    finally:
        stop(racer)


def test_a_writer_killed_at_any_moment_leaves_the_previous_message_newest(path):
    for _ in range(10):
        racer = start_racer(path, 2, 50_000, crc=True)
        try:
            with RingReader.open(path, KIND) as reader:
                # Nothing is read: with two slots a busy machine lets the writer overtake each try.
                first, end_s = reader.index, time.monotonic() + 10.0
                while reader.index == first and time.monotonic() < end_s:
                    time.sleep(0.001)
                racer.send_signal(signal.SIGKILL)
                racer.wait()
                message = reader.newest()
                assert message is not None
                assert is_one_message(message.payload, message.index)
        finally:
            stop(racer)


def test_a_write_cut_half_way_is_not_seen(path):
    with RingWriter.create(path, 2, 8, KIND) as writer, RingReader.open(path, KIND) as reader:
        writer.publish(b"first", stamp_s=0.0)
        view = writer._map
        view.words[view.slot_at(2) // 8] = 3
        message = reader.newest()
        assert message is not None
        assert message.payload == b"first"
        assert len(reader.since(0)) == 1


def test_reading_costs_microseconds(path):
    with RingWriter.create(path, 8, 512, KIND) as writer, RingReader.open(path, KIND) as reader:
        writer.publish(bytes(300), stamp_s=0.0)
        start = time.perf_counter()
        for _ in range(10_000):
            reader.newest()
        assert (time.perf_counter() - start) / 10_000 < 100e-6
