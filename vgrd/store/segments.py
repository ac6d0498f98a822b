"""MCAP segments: one file per minute that loses next to nothing on a kill or a full disk.

Chunks are not compressed and end after 80 ms, so that the page cache holds all but the last poses;
fsync runs in a thread of its own and never holds up the caller. A segment is `NNN.mcap.open` while
it grows.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from vgrd.clock import Clock
from vgrd.errors import StoreError
from vgrd.permissions import opener
from vgrd.store.files import failure, sync_directory
from vgrd.store.topics import Topic, open_writer

FLUSH_S = 0.08  # with the 20 ms of a tick, a kill costs at most 100 ms of poses
SYNC_S = 1.0  # a power cut costs at most so much; a kill costs nothing that was flushed
MIB = 1 << 20  # bytes
BACKLOG_PER_SYNC = 4  # an fsync begins at a quarter of the backlog: before pictures are dropped


class _Segment:
    """One growing file."""

    def __init__(
        self, directory: Path, number: int, now_s: float, sync: Callable[[int], None]
    ) -> None:
        self.path = directory / f"{number:03d}.mcap"
        self.open_path = directory / f"{number:03d}.mcap.open"
        self.opened_s = now_s
        self._sync = sync
        self.stream = open(self.open_path, "xb", opener=opener)  # noqa: SIM115
        self.writer = open_writer(self.stream)

    def size(self) -> int:
        return self.stream.tell()

    def sync(self) -> None:
        self._sync(self.stream.fileno())

    def seal(self) -> None:
        """Everything written: make it durable and give it its final name."""
        with self.stream:
            self.sync()
        self.open_path.replace(self.path)
        sync_directory(self.path.parent)

    def abandon(self) -> None:
        """Release the file as it is, to be recovered later; its last flush may fail once more."""
        with suppress(OSError):
            self.stream.close()


class _SyncJob(NamedTuple):
    future: "Future[None]"
    written_bytes: int  # on the disk once the job is done


class SegmentWriter:
    """Writes messages into segments of at most `seconds` or `max_bytes`; one thread at a time.

    A disk that is `backlog_bytes` behind gets no more pictures, at twice that nothing more.
    Once a write or a sync has failed, that StoreError is raised from then on and the open segment
    is left to `recover`.
    dropped_images, dropped_messages: what was left out since the disk could not follow.
    """

    def __init__(
        self,
        directory: Path,
        clock: Clock,
        seconds: float = 60.0,  # chosen: a kill leaves a minute at most to be recovered
        max_bytes: int = 256 * MIB,  # chosen: some 50 pictures of 12 megapixels (5 MB each)
        backlog_bytes: int = 64 * MIB,  # chosen: a dozen such pictures
        sync: Callable[[int], None] = os.fsync,
    ) -> None:
        self.dropped_images = 0
        self.dropped_messages = 0
        self._directory, self._clock = directory, clock
        self._seconds, self._max_bytes = seconds, max_bytes
        self._backlog_bytes, self._sync = backlog_bytes, sync
        self._segment: _Segment | None = None
        self._segments = 0
        self._sealed_bytes = self._synced_bytes = 0
        self._pending_since_s: float | None = None
        self._synced_at_s = clock.monotonic()
        self._jobs: deque[_SyncJob] = deque()
        self._executor = ThreadPoolExecutor(1, "vgrd-fsync")
        self._failure = ""

    def write(self, topic: Topic, time_ns: int, data: bytes) -> bool:
        """Add a message of Unix time `time_ns`; False when left out since the disk is far behind.

        A picture gets a chunk of its own and is left out before anything else.
        """
        self.tick()
        with self._keeping_failure():
            if self._is_behind(topic):
                return False
            if topic is Topic.IMAGE:
                self._flush()
            if self._pending_since_s is None:
                self._pending_since_s = self._clock.monotonic()
            self._current().writer.add_message(topic, time_ns, data, time_ns)
            if topic is Topic.IMAGE:
                self._flush()
        return True

    def tick(self) -> None:
        """Flush, sync and begin a new segment when it is time; `write` does it too."""
        with self._keeping_failure():
            self._settle()
            now_s = self._clock.monotonic()
            if self._pending_since_s is not None and now_s - self._pending_since_s >= FLUSH_S:
                self._flush()
            early = self._unsynced_bytes() > self._backlog_bytes // BACKLOG_PER_SYNC
            if early or now_s - self._synced_at_s >= SYNC_S:
                self._start_sync()
            segment = self._segment
            if segment is not None and (
                now_s - segment.opened_s >= self._seconds or segment.size() >= self._max_bytes
            ):
                self._finish(segment)

    def sync(self) -> None:
        """Flush now and start an fsync in the background."""
        with self._keeping_failure():
            self._flush()
            self._start_sync()

    def close(self) -> None:
        """Finish the last segment and wait for the disk; raises StoreError if that fails."""
        try:
            if not self._failure:
                with self._keeping_failure():
                    if self._segment is not None:
                        self._finish(self._segment)
                    self._executor.shutdown(wait=True)
                    self._settle()
        finally:
            self._executor.shutdown(wait=True)
            self._failure = self._failure or f"cannot record into {self._directory}: it is closed"

    @contextmanager
    def _keeping_failure(self) -> Iterator[None]:
        if self._failure:
            raise StoreError(self._failure)
        try:
            yield
        except OSError as error:
            refusal = failure("record into", self._directory, error)
            self._failure = str(refusal)
            self._executor.shutdown(wait=True)
            if self._segment is not None:
                self._segment.abandon()
            raise refusal from error

    def _current(self) -> _Segment:
        if self._segment is None:
            self._segment = _Segment(
                self._directory, self._segments, self._clock.monotonic(), self._sync
            )
            self._segments += 1
        return self._segment

    def _written_bytes(self) -> int:
        return self._sealed_bytes + (self._segment.size() if self._segment is not None else 0)

    def _unsynced_bytes(self) -> int:
        return self._written_bytes() - self._synced_bytes

    def _is_behind(self, topic: Topic) -> bool:
        behind = self._unsynced_bytes() > self._backlog_bytes * (1 if topic is Topic.IMAGE else 2)
        if behind and topic is Topic.IMAGE:
            self.dropped_images += 1
        elif behind:
            self.dropped_messages += 1
        return behind

    def _flush(self) -> None:
        if self._segment is not None and self._pending_since_s is not None:
            self._segment.writer.flush()  # type: ignore[no-untyped-call]
            self._pending_since_s = None

    def _start_sync(self) -> None:
        written = self._written_bytes()
        if self._segment is None or self._jobs or written == self._synced_bytes:
            return
        self._synced_at_s = self._clock.monotonic()
        self._jobs.append(_SyncJob(self._executor.submit(self._segment.sync), written))

    def _finish(self, segment: _Segment) -> None:
        segment.writer.finish()  # type: ignore[no-untyped-call]
        segment.stream.flush()
        self._pending_since_s = None
        self._sealed_bytes += segment.size()
        self._segment = None
        self._jobs.append(_SyncJob(self._executor.submit(segment.seal), self._sealed_bytes))

    def _settle(self) -> None:
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.popleft()
            job.future.result()
            self._synced_bytes = job.written_bytes
