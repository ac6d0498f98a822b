"""The recorder and a disk that is slow or fails."""

import errno
import threading

import pytest

from fakes.testing import ManualClock
from vgrd.errors import StoreError
from vgrd.store.recovery import read_messages
from vgrd.store.segments import SegmentWriter
from vgrd.store.topics import Topic

PICTURE = bytes(1000)


class SlowDisk:
    """An fsync that waits until it is let go."""

    def __init__(self):
        self.free = threading.Event()
        self.calls = 0

    def sync(self, _descriptor):
        """Wait."""
        self.calls += 1
        assert self.free.wait(20.0)


def topics(directory):
    return [m.topic for path in sorted(directory.iterdir()) for m in read_messages(path)]


def test_a_slow_disk_costs_pictures_before_poses_and_never_holds_up_the_caller(tmp_path):
    clock, disk = ManualClock(), SlowDisk()
    writer = SegmentWriter(tmp_path, clock, backlog_bytes=20_000, sync=disk.sync)
    written = 0
    for i in range(50):
        clock.sleep(0.1)
        assert writer.write(Topic.FLANGE, i, b"{}")
        written += writer.write(Topic.IMAGE, i, PICTURE)
    assert disk.calls == 1
    assert 10 < written < 30
    assert (writer.dropped_images, writer.dropped_messages) == (50 - written, 0)
    clock.sleep(0.1)
    writer.tick()
    assert topics(tmp_path).count(Topic.FLANGE) == 50
    disk.free.set()
    while not writer.write(Topic.IMAGE, 51, PICTURE):
        clock.sleep(1.0)
    writer.close()
    assert topics(tmp_path).count(Topic.IMAGE) == written + 1


def test_what_waits_for_a_slow_disk_is_bounded(tmp_path):
    clock, disk = ManualClock(), SlowDisk()
    writer = SegmentWriter(tmp_path, clock, backlog_bytes=20_000, sync=disk.sync)
    for i in range(300):
        clock.sleep(0.1)
        writer.write(Topic.FLANGE, i, bytes(500))
    assert writer.dropped_messages > 200
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 50_000
    disk.free.set()
    writer.close()
    assert len(topics(tmp_path)) == 300 - writer.dropped_messages


def test_a_disk_that_fails_to_sync_stops_the_recording_for_good(tmp_path):
    clock = ManualClock()

    def sync(_descriptor):
        raise OSError(errno.EIO, "Input/output error")

    writer = SegmentWriter(tmp_path, clock, sync=sync)
    writer.write(Topic.FLANGE, 1, b"{}")
    writer.sync()
    with pytest.raises(StoreError, match=r"Input/output error; check the disk"):
        writer.close()
    with pytest.raises(StoreError, match="Input/output error"):
        writer.write(Topic.FLANGE, 2, b"{}")
    writer.close()
    assert topics(tmp_path) == [Topic.FLANGE]


def test_a_segment_ends_at_its_size(tmp_path):
    clock = ManualClock()
    writer = SegmentWriter(tmp_path, clock, max_bytes=5000)
    for i in range(10):
        writer.write(Topic.IMAGE, i, PICTURE)
    writer.close()
    assert len(list(tmp_path.iterdir())) == 3
    assert topics(tmp_path) == [Topic.IMAGE] * 10


def test_a_recorder_that_recorded_nothing_leaves_nothing(tmp_path):
    writer = SegmentWriter(tmp_path, ManualClock())
    writer.tick()
    writer.sync()
    writer.close()
    assert list(tmp_path.iterdir()) == []
