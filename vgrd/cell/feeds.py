"""What the device processes publish, as the cell sees it: newest readings, their age, their health."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path

from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading, Region, wire
from vgrd.errors import BadReading, RingUnavailable
from vgrd.ipc.health import health_path
from vgrd.ipc.messages import GATE_KIND, GATE_RING, HEALTH_KIND, GateReport, Health
from vgrd.ipc.ring import Message, RingReader, RingWriter

TRIGGER_SLOTS = 4  # only the newest wish counts; a ring needs two
HISTORY_S = 3.0  # two readings of the slowest robot before a picture, and its evaluation after


class RingFeed:
    """New messages of one ring, however often its writer is restarted."""

    def __init__(self, path: Path, kind: str, clock: Clock) -> None:
        self.path = path
        self.kind = kind
        self.clock = clock
        self.reader: RingReader | None = None
        self.last = 0

    def poll(self) -> Sequence[Message]:
        """Messages published since the last call, oldest first."""
        reader = self._open()
        if reader is None:
            return ()
        messages = reader.since(self.last)
        if messages:
            self.last = messages[-1].index
        return messages

    def newest(self) -> Message | None:
        """The newest message if it came since the last call."""
        reader = self._open()
        if reader is None or reader.index == self.last:
            return None
        message = reader.newest()
        if message is not None:
            self.last = message.index
        return message

    def _open(self) -> RingReader | None:
        if self.reader is None:
            try:
                self.reader = RingReader.open(self.path, self.kind, self.clock)
            except RingUnavailable:
                return None
        return self.reader


class RobotFeed:
    """Flange readings of the last seconds."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self.clock = clock
        self.feed = RingFeed(runtime_dir / wire.FLANGE_RING, wire.FLANGE_KIND, clock)
        self.readings: deque[FlangeReading] = deque()
        self.bad = 0

    def poll(self) -> list[FlangeReading]:
        """New readings, oldest first; also kept in `readings` for `HISTORY_S`."""
        fresh = []
        for message in self.feed.poll():
            try:
                fresh.append(wire.unpack_flange(message.payload))
            except BadReading:
                self.bad += 1
        self.readings.extend(fresh)
        while self.readings and self.readings[0].stamp_s < self.clock.monotonic() - HISTORY_S:
            self.readings.popleft()
        return fresh

    def newest(self, within_s: float) -> FlangeReading | None:
        """The newest reading, None when it is older than `within_s`."""
        if not self.readings or self.clock.monotonic() - self.readings[-1].stamp_s > within_s:
            return None
        return self.readings[-1]


class CameraFeed:
    """Asks for pictures and receives them."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self.clock = clock
        self.feed = RingFeed(runtime_dir / wire.IMAGE_RING, wire.IMAGE_KIND, clock)
        self.triggers = RingWriter.create(
            runtime_dir / wire.TRIGGER_RING,
            slots=TRIGGER_SLOTS,
            slot_bytes=wire.TRIGGER_BYTES,
            kind=wire.TRIGGER_KIND,
        )
        self.asked_s: float | None = None
        self._since_s = clock.monotonic()

    def trigger(self, region: Region | None) -> None:
        """Ask for a picture, whole or a region of it."""
        self.asked_s = self.clock.monotonic()
        self.triggers.publish(wire.pack_trigger(region), stamp_s=self.asked_s)

    def newest(self) -> CameraImage | None:
        """The newest picture since the last call, or None; answers the trigger."""
        message = self.feed.newest()
        if message is None or message.stamp_s < self._since_s:
            return None  # one that was taken for an earlier life of this process tells nothing
        self.asked_s = None
        return wire.unpack_image(message.payload)

    def forget(self) -> None:
        """Wait no longer for what was asked for."""
        self.asked_s = None

    def waiting_s(self) -> float:
        """Seconds since the trigger that has not been answered yet, 0 when there is none."""
        return 0.0 if self.asked_s is None else self.clock.monotonic() - self.asked_s


class HealthFeed:
    """What another process said last about its health."""

    def __init__(self, runtime_dir: Path, process: str, clock: Clock) -> None:
        self.clock = clock
        self.feed = RingFeed(health_path(runtime_dir, process), HEALTH_KIND, clock)
        self.last: Health | None = None
        self.stamp_s = 0.0

    @property
    def age_s(self) -> float:
        """Seconds since that message."""
        return self.clock.monotonic() - self.stamp_s

    def poll(self) -> Health | None:
        """The newest health message so far, None before the first."""
        for message in self.feed.poll():
            self.last = Health.unpack(message.payload)
            self.stamp_s = message.stamp_s
        return self.last


class GateFeed:
    """The gate's table of processes and its counters."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self.feed = RingFeed(runtime_dir / GATE_RING, GATE_KIND, clock)
        self.last: GateReport | None = None
        self.stamp_s = 0.0

    def poll(self) -> GateReport | None:
        """The newest report so far, None before the first; `stamp_s` tells when it was written."""
        message = self.feed.newest()
        if message is not None:
            self.last, self.stamp_s = GateReport.unpack(message.payload), message.stamp_s
        return self.last
