"""Room for recordings: old sessions give way, and a disk that runs full pauses the recording."""

import asyncio
import shutil
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import structlog

from vgrd.cell.recording.recorder import Recorder
from vgrd.errors import StoreError
from vgrd.niceness import give_way
from vgrd.permissions import make_folder
from vgrd.store.files import guarded
from vgrd.store.retention import Room, make_room

SWEEP_S = 10.0  # pictures fill 100 MB in this time at most, a tenth of what is kept free
GB = 1e9  # bytes, as disks are sold
TOLD = 20  # names of sessions that gave way, the last ones: a reply of the status has its bounds
RESUME = 1.1  # of what must be free, so that the recording does not pause and go on by turns

log = structlog.get_logger()


class Housekeeping:
    """Looks after the disk in a thread of its own; serving never waits for it."""

    def __init__(
        self, state_dir: Path, recorder: Recorder, quota_gb: float, keep_free_gb: float
    ) -> None:
        self.state_dir = state_dir
        self.recorder = recorder
        self.quota_gb = quota_gb
        self.keep_free_gb = keep_free_gb
        self.room: Room | None = None  # until it was looked, and while that fails
        self.free_gb: float | None = None
        self.removed = deque[str](maxlen=TOLD)
        self.removed_total = 0

    async def run(self) -> None:
        """Sweep until cancelled."""
        with ThreadPoolExecutor(1, "housekeeping", initializer=give_way) as thread:
            while True:
                await self.sweep(thread)
                await asyncio.sleep(SWEEP_S)

    async def sweep(self, thread: ThreadPoolExecutor) -> None:
        """Make room, and let the recording go on or pause."""
        loop = asyncio.get_running_loop()
        try:
            room = await loop.run_in_executor(thread, self._make_room)
            self._count_removed(room.removed)
            free_gb = await loop.run_in_executor(thread, self._look)
        except StoreError as err:
            self.room = self.free_gb = None
            trouble = str(err)
        else:
            self.room, self.free_gb = room, free_gb
            trouble = room.trouble or self._short_of_space(free_gb)
        if trouble and not self.recorder.paused:
            log.error("recording_pauses", reason=trouble)
        elif self.recorder.paused and not trouble:
            log.warning("recording_resumes", free_gb=self.status()["free_gb"])
        self.recorder.paused = trouble

    def status(self) -> dict[str, object]:
        """Describe the disk for `vgrd status`; None is what is not known now."""
        return {
            "sessions_gb": None if self.room is None else round(self.room.used_bytes / GB, 2),
            "quota_gb": self.quota_gb,
            "free_gb": None if self.free_gb is None else round(self.free_gb, 1),
            "removed": list(self.removed),
            "removed_total": self.removed_total,
            "trouble": self.recorder.paused,
        }

    def _count_removed(self, names: Sequence[str]) -> None:
        for name in names:
            log.warning("session_removed", session=name, quota_gb=self.quota_gb)
        self.removed += names
        self.removed_total += len(names)

    def _make_room(self) -> Room:
        # Whoever tidies up by hand at this moment is no reason to end the cell's process.
        with guarded("look after", self.state_dir):
            make_folder(self.state_dir)
            return make_room(self.state_dir, round(self.quota_gb * GB))

    def _look(self) -> float:
        """GB that are free."""
        with guarded("look after", self.state_dir):
            return shutil.disk_usage(self.state_dir).free / GB

    def _short_of_space(self, free_gb: float) -> str:
        needed_gb = self.keep_free_gb * (RESUME if self.recorder.paused else 1.0)
        if free_gb >= needed_gb:
            return ""
        return (
            f"{free_gb:.1f} GB are free on the disk of {self.state_dir}, "
            f"{self.keep_free_gb:g} GB must be ([recording] keep_free_gb): free space on it"
        )
