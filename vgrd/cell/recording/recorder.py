"""Recording beside everything else: one thread writes, in order, so that no disk stalls the measuring."""

import asyncio
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import structlog

from vgrd.calibration.harvest import Harvested
from vgrd.cell.measuring import Sight
from vgrd.cell.recording.passing import PassingSights
from vgrd.clock import Clock
from vgrd.devices import FlangeReading
from vgrd.devices.thinning import PoseThinning
from vgrd.errors import ControlError, InternalError, StoreError
from vgrd.geometry import Array, Pose
from vgrd.model import CellFacts, Plan
from vgrd.niceness import give_way
from vgrd.store.images import encode_image
from vgrd.store.sessions import SampleKind, SessionWriter

BACKLOG = 200  # writes, of which 50 to 175 come a second; chosen: a disk may stall for a second
SAME_PLACE_MM = 0.1  # chosen: twice the limit of rest (0.05 mm)
SAME_PLACE_RAD = 2e-4  # chosen: the limit of rest
SAME_PLACE_PX = 0.5  # of a corner: the noise of a good tag is a tenth of it, a step in light less
PLACES = 8  # of one rest: a tag that is seen and not seen by turns is recorded once each
SAMPLE_S = 3.0  # a sample is stored at most this long after its picture
LONG_S = 12 * 3600.0  # longer than a shift: the session was forgotten

log = structlog.get_logger()
Result = TypeVar("Result")


class Recorder:
    """The open session, if any; `call` runs a write in the writer's thread and waits for it."""

    def __init__(self, state_dir: Path, clock: Clock) -> None:
        self.state_dir = state_dir
        self.clock = clock
        self.writer: SessionWriter | None = None
        self.trouble = ""
        self.dropped = 0
        self.paused = ""
        self.opened_s = 0.0
        self._thinning = PoseThinning()
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="recorder", initializer=give_way)
        self._pending = 0
        self._counting = threading.Lock()
        self._places: list[RestPlace] = []
        self._passing = PassingSights()

    async def start(self, session: str, plan: Plan, facts: CellFacts) -> None:
        """Open a new session; ControlError when one is open already."""
        if self.writer is not None:
            raise ControlError(
                f"session {self.writer.header.name} is being recorded: stop it first (vgrd record stop)"
            )
        self.trouble, self.dropped, self._places = "", 0, []
        self._passing = PassingSights()
        self._thinning, self.opened_s = PoseThinning(), self.clock.monotonic()
        self.writer = await self._in_thread(
            lambda: SessionWriter(self.state_dir, session, plan, facts, self.clock)
        )

    async def stop(self) -> Path:
        """Close the session; returns its folder."""
        writer = self.open_session()
        self.writer = None
        last = self._thinning.rest()
        await self._in_thread(lambda: self._finish(writer, last))
        return writer.path

    def open_session(self) -> SessionWriter:
        """The session being recorded; ControlError when there is none."""
        if self.writer is None:
            raise ControlError("no session is being recorded: vgrd record start --plan joint")
        return self.writer

    async def call(self, write: Callable[[SessionWriter], Result]) -> Result:
        """Run `write` with the session's writer; it is durable when this returns."""
        writer, now_s = self.open_session(), self.clock.monotonic()
        self._thinning.want(now_s - SAMPLE_S, now_s)
        self._places = []  # the picture after a sample is kept: a hand may have been in the first
        return await self._in_thread(lambda: write(writer))

    def harvest(self, sample: Harvested) -> None:
        """Write a sample that nobody waits for, and take back those that it makes superfluous."""
        writer = self.writer
        if writer is None or self.paused:
            return
        kind, seen = SampleKind(sample.kind.value), sample.observation
        self._thinning.want(seen.stamp_s, seen.stamp_s)

        def write() -> None:
            writer.sample(kind, seen, harvested=True)
            writer.give_back(sample.given_back)

        self._queue(write)

    def on_readings(self, readings: Sequence[FlangeReading]) -> None:
        """Record flange poses: at the robot's rate while it moves and around pictures, else few."""
        writer = self.writer
        if writer is None or self.paused:
            return
        due = self._thinning.add(readings)
        if due:
            self._queue(lambda: self._write_readings(writer, due))

    def warning(self) -> str:
        """What the operator should know of an open session; empty when there is nothing."""
        open_s = self.clock.monotonic() - self.opened_s
        if reason := self.trouble or self.paused:
            return f"poses and pictures are not recorded, samples are: {reason}"
        if self.writer is None or open_s < LONG_S:
            return ""
        return f"open for {open_s / 3600:.0f} hours: end it with vgrd record stop"

    def tick(self) -> None:
        """Keep what is written durable while nothing new comes; call every 50 ms or so."""
        if self.writer is not None:
            self._queue(self.writer.tick)

    def on_sight(self, sight: Sight) -> None:
        """Record the first picture of each rest: one that shows tags from a place not recorded yet.

        Of an arm that moves the tags are recorded, and of a picture without tags a few as they are.
        """
        writer, pose = self.writer, sight.base_from_wrist
        if writer is None or self.paused:
            return
        if pose is None or not (sight.tag_a or sight.tag_b):
            self._record_passing(writer, sight)
            return
        place = RestPlace(pose, sight.tag_b.corners_px if sight.tag_b else None)
        if any(place.is_same(other) for other in self._places):
            return
        if self._places and not place.is_same_rest(self._places[-1]):
            self._places = []
        self._places = [*self._places[-PLACES + 1 :], place]
        self._thinning.want(sight.stamp_s, sight.stamp_s)
        self._queue(lambda: self._write_sight(writer, sight))

    def _record_passing(self, writer: SessionWriter, sight: Sight) -> None:
        """Record a picture that no sample can be of, few of them and as small as will do."""
        kept = self._passing.kept(sight)
        if kept is None:
            return
        self._queue(lambda: writer.moving(kept))
        if kept.tag_a is None and kept.tag_b is None:
            self._queue(lambda: writer.image(encode_image(sight.image)))

    def _finish(self, writer: SessionWriter, last: Sequence[FlangeReading]) -> None:
        try:
            self._write_readings(writer, last)
        except StoreError as err:
            # The recording had failed before, or fails now: the samples are safe all the same.
            self.trouble = self.trouble or str(err)
        finally:
            writer.close()

    @staticmethod
    def _write_readings(writer: SessionWriter, readings: Sequence[FlangeReading]) -> None:
        for reading in readings:
            writer.flange(reading)

    @staticmethod
    def _write_sight(writer: SessionWriter, sight: Sight) -> None:
        writer.observation(sight.observation())
        writer.image(encode_image(sight.image))

    def _queue(self, write: Callable[[], object]) -> None:
        """Hand a write to the thread without waiting; a full backlog drops it and counts."""
        if self._pending >= BACKLOG:
            self.dropped += 1
            return
        with self._counting:
            self._pending += 1
        self._executor.submit(write).add_done_callback(self._written)

    def _written(self, write: Future[object]) -> None:
        """Called in the thread; what is raised here is heard by nobody, so nothing is."""
        with self._counting:
            self._pending -= 1
        error = write.exception()
        if isinstance(error, StoreError):
            if not self.trouble:
                log.error("recording_fails", reason=str(error))
            self.trouble = str(error)
        elif error is not None:
            self.trouble = str(InternalError.of("recording", error))
            log.error("recording_fails", reason=self.trouble, exc_info=error)

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)


@dataclass(frozen=True, slots=True, eq=False)
class RestPlace:
    """Where things stood in a picture: the flange, and tag B's corners (4, 2) where it was seen."""

    base_from_wrist: Pose
    corners_px: Array | None

    def is_same_rest(self, other: "RestPlace") -> bool:
        """Whether the flange has not moved."""
        distance_mm, angle_rad = self.base_from_wrist.distance(other.base_from_wrist)
        return distance_mm <= SAME_PLACE_MM and angle_rad <= SAME_PLACE_RAD

    def is_same(self, other: "RestPlace") -> bool:
        """Whether neither the flange nor the object has moved; in pixels, whose noise is known."""
        if self.corners_px is None or other.corners_px is None:
            return self.corners_px is other.corners_px and self.is_same_rest(other)
        shift_px = float(np.abs(self.corners_px - other.corners_px).max())
        return shift_px <= SAME_PLACE_PX and self.is_same_rest(other)
