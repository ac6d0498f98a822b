"""How a process says that it lives: a health ring whose progress counts loops of real work."""

import os
from pathlib import Path

from vgrd.clock import Clock
from vgrd.ipc.messages import HEALTH_BYTES, HEALTH_KIND, HEALTH_SLOTS, Health, HealthState
from vgrd.ipc.ring import RingWriter

HEALTH_FOLDER = "health"
PERIOD_S = 0.1


def health_path(runtime_dir: Path, process: str) -> Path:
    """Where the health ring of a process lies."""
    return runtime_dir / HEALTH_FOLDER / f"{process}.ring"


class HealthReporter:
    """Writes the health of this process."""

    def __init__(self, runtime_dir: Path, process: str, clock: Clock) -> None:
        self.process = process
        self.clock = clock
        self.count = 0
        self.said: tuple[float, HealthState, str] = (0.0, "starting", "")
        path = health_path(runtime_dir, process)
        path.parent.mkdir(parents=True, exist_ok=True)
        self.ring = RingWriter.create(path, HEALTH_SLOTS, HEALTH_BYTES, HEALTH_KIND)

    def progress(self, state: HealthState, detail: str = "") -> None:
        """One more loop of real work; written at most each 100 ms unless the state changed."""
        self.count += 1
        now = self.clock.monotonic()
        last, *words = self.said
        if now - last >= PERIOD_S or words != [state, detail]:
            self.report(state, detail)

    def report(self, state: HealthState, detail: str = "") -> None:
        """Say it now."""
        now = self.clock.monotonic()
        self.said = (now, state, detail)
        health = Health(self.process, state, self.count, detail, os.getpid())
        self.ring.publish(health.pack(), stamp_s=now)
