"""Room for recordings: old sessions give way, and a disk that runs full pauses the recording."""

import asyncio
import shutil
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
        self.room = Room(0)
        self.free_gb = 0.0
        self.removed: list[str] = []

    async def run(self) -> None:
        """Sweep until cancelled."""
        with ThreadPoolExecutor(1, "housekeeping", initializer=give_way) as thread:
            while True:
                await self.sweep(thread)
                await asyncio.sleep(SWEEP_S)

    async def sweep(self, thread: ThreadPoolExecutor) -> None:
        """Make room, and let the recording go on or pause."""
        try:
            loop = asyncio.get_running_loop()
            self.room, self.free_gb = await loop.run_in_executor(thread, self._look)
            trouble = self.room.trouble or self._short_of_space()
        except StoreError as err:
            trouble = str(err)
        for name in self.room.removed:
            log.warning("session_removed", session=name, quota_gb=self.quota_gb)
        self.removed += self.room.removed
        if trouble and not self.recorder.paused:
            log.error("recording_pauses", reason=trouble)
        elif self.recorder.paused and not trouble:
            log.warning("recording_resumes", free_gb=round(self.free_gb, 1))
        self.recorder.paused = trouble

    def status(self) -> dict[str, object]:
        """Describe the disk for `vgrd status`."""
        return {
            "sessions_gb": round(self.room.used_bytes / GB, 2),
            "quota_gb": self.quota_gb,
            "free_gb": round(self.free_gb, 1),
            "removed": list(self.removed),
            "trouble": self.recorder.paused,
        }

    def _look(self) -> tuple[Room, float]:
        # Whoever tidies up by hand at this moment is no reason to end the cell's process.
        with guarded("look after", self.state_dir):
            make_folder(self.state_dir)
            room = make_room(self.state_dir, round(self.quota_gb * GB))
            return room, shutil.disk_usage(self.state_dir).free / GB

    def _short_of_space(self) -> str:
        needed_gb = self.keep_free_gb * (RESUME if self.recorder.paused else 1.0)
        if self.free_gb >= needed_gb:
            return ""
        return (
            f"{self.free_gb:.1f} GB are free on the disk of {self.state_dir}, "
            f"{self.keep_free_gb:g} GB must be ([recording] keep_free_gb): free space on it"
        )
