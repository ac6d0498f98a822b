"""Recording beside everything else: one thread writes, in order, so that no disk stalls the measuring."""

import asyncio
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import structlog

from vgrd.cell.measuring import Sight
from vgrd.clock import Clock
from vgrd.devices import FlangeReading
from vgrd.errors import ControlError, InternalError, StoreError
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Plan
from vgrd.store.images import encode_image
from vgrd.store.sessions import SessionWriter

BACKLOG = 200
NICENESS = 10
SAME_PLACE_MM = 0.1
SAME_PLACE_RAD = 2e-4

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
        self._pen = ThreadPoolExecutor(1, thread_name_prefix="recorder", initializer=_give_way)
        self._pending = 0
        self._counting = threading.Lock()
        self._last_image: tuple[Pose, Pose | None] | None = None

    async def start(self, session: str, plan: Plan, facts: CellFacts) -> None:
        """Open a new session; ControlError when one is open already."""
        if self.writer is not None:
            raise ControlError(
                f"session {self.writer.header.name} is being recorded: stop it first (vgrd record stop)"
            )
        self.trouble, self.dropped, self._last_image = "", 0, None
        self.writer = await self._in_thread(
            lambda: SessionWriter(self.state_dir, session, plan, facts, self.clock)
        )

    async def stop(self) -> Path:
        """Close the session; returns its folder."""
        writer = self.open_session()
        self.writer = None
        await self._in_thread(writer.close)
        return writer.path

    def open_session(self) -> SessionWriter:
        """The session being recorded; ControlError when there is none."""
        if self.writer is None:
            raise ControlError("no session is being recorded: vgrd record start --plan joint")
        return self.writer

    async def call(self, write: Callable[[SessionWriter], Result]) -> Result:
        """Run `write` with the session's writer; it is durable when this returns."""
        writer = self.open_session()
        return await self._in_thread(lambda: write(writer))

    def on_readings(self, readings: Sequence[FlangeReading]) -> None:
        """Record flange poses at the robot's rate."""
        writer = self.writer
        if writer is not None:
            self._queue(lambda: self._write_readings(writer, readings))

    def tick(self) -> None:
        """Keep what is written durable while nothing new comes; call every 50 ms or so."""
        if self.writer is not None:
            self._queue(self.writer.tick)

    def on_sight(self, sight: Sight) -> None:
        """Record the first picture of each rest: one that shows tags from a place not recorded yet."""
        writer, pose = self.writer, sight.base_from_wrist
        if writer is None or pose is None or not (sight.tag_a or sight.tag_b):
            return
        place = (pose, sight.tag_b.camera_from_tag if sight.tag_b else None)
        if self._last_image is not None and _same_place(self._last_image, place):
            return
        self._last_image = place
        self._queue(lambda: self._write_sight(writer, sight))

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
        self._pen.submit(write).add_done_callback(self._written)

    def _written(self, done: Future[object]) -> None:
        """Called in the thread; what is raised here is heard by nobody, so nothing is."""
        with self._counting:
            self._pending -= 1
        error = done.exception()
        if isinstance(error, StoreError):
            if not self.trouble:
                log.error("recording_fails", reason=str(error))
            self.trouble = str(error)
        elif error is not None:
            self.trouble = str(InternalError.of("recording", error))
            log.error("recording_fails", reason=self.trouble, exc_info=error)

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._pen, work)


def _give_way() -> None:
    """Compressing pictures must not delay an answer: Linux keeps niceness per thread."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


Place = tuple[Pose, Pose | None]


def _same_place(old: Place, new: Place) -> bool:
    """Neither the flange nor the object has moved between two pictures."""
    for before, after in zip(old, new, strict=True):
        if before is None or after is None:
            if before is not after:
                return False
            continue
        distance_mm, angle_rad = before.distance(after)
        if distance_mm > SAME_PLACE_MM or angle_rad > SAME_PLACE_RAD:
            return False
    return True
