"""How a process reports its health: a ring with a count of work done, and a beat in between.

The count tells the gate that the process makes progress. The beat, every 50 ms from a thread of its
own, tells the cell that the process runs while a driver waits for its device. A process that was
killed or stopped, or that hangs in a library which holds the GIL, does not beat.
"""

import os
import threading
from pathlib import Path

from vgrd.clock import Clock
from vgrd.ipc.messages import HEALTH_BYTES, HEALTH_KIND, HEALTH_SLOTS, Health, HealthState
from vgrd.ipc.ring import RingWriter
from vgrd.permissions import make_folder

HEALTH_FOLDER = "health"
PERIOD_S = 0.1  # of reports while work goes on; chosen: as the gate looks
BEAT_S = 0.05  # four of them in the 0.2 s after which a device counts as lost


def health_path(runtime_dir: Path, process: str) -> Path:
    """Where the health ring of a process lies."""
    return runtime_dir / HEALTH_FOLDER / f"{process}.ring"


class HealthReporter:
    """Writes the health of this process; its methods may be called from several threads."""

    def __init__(self, runtime_dir: Path, process: str, clock: Clock) -> None:
        self.process = process
        self.clock = clock
        self.count = 0
        self.last_report: tuple[float, HealthState, str] = (0.0, "starting", "")
        self._writing = threading.Lock()
        path = health_path(runtime_dir, process)
        make_folder(path.parent)
        self.ring = RingWriter.create(path, HEALTH_SLOTS, HEALTH_BYTES, HEALTH_KIND)

    def progress(self, state: HealthState, detail: str = "") -> None:
        """One more loop of real work; written at most each 100 ms unless the state changed."""
        self.count += 1
        now = self.clock.monotonic()
        reported_s, *words = self.last_report
        if now - reported_s >= PERIOD_S or words != [state, detail]:
            self.report(state, detail)

    def report(self, state: HealthState, detail: str = "") -> None:
        """Report now."""
        now = self.clock.monotonic()
        with self._writing:
            self.last_report = (now, state, detail)
            self._write(now)

    def beat(self) -> None:
        """Repeat the last report with the present time: the process is there."""
        with self._writing:
            self._write(self.clock.monotonic())

    def keep_beating(self) -> None:
        """Beat from a thread of its own to the end of the process."""
        threading.Thread(target=self._beat_on, name="beat", daemon=True).start()

    def _beat_on(self) -> None:
        while True:
            self.beat()
            self.clock.sleep(BEAT_S)

    def _write(self, now_s: float) -> None:
        _, state, detail = self.last_report
        health = Health(self.process, state, self.count, detail, os.getpid())
        self.ring.publish(health.pack(), stamp_s=now_s)
