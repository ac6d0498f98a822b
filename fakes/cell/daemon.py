"""The daemon under a fake cell: `vgrd run` as a subprocess, used by control API and registers only."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from vgrd.errors import ControlError, DaemonUnreachable, IpcError
from vgrd.ipc.control import ControlClient
from vgrd.ipc.health import HEALTH_FOLDER
from vgrd.ipc.messages import HEALTH_KIND, Health
from vgrd.ipc.ring import RingReader
from vgrd.orphans import dying_with_us

START_TIMEOUT_S = 120.0  # takes 4 s; 34 s were seen with five times as much work as processors
STOP_TIMEOUT_S = 30.0  # far more than an end takes; then it is killed, so that nothing hangs
REPLY_TIMEOUT_S = 60.0  # a sample needs two pictures; on a busy machine each may take seconds


def has_devices(status: dict[str, object]) -> bool:
    """Robot and camera work."""
    return status["robot"] == "ok" and status["camera"] == "ok"


class Daemon:
    """`vgrd run CELL_FILE`, from `with` (which waits until its status is `good`) to its end.

    Its log goes to `log`. It ends with this process, however that ends; to be started from the
    main thread.
    """

    def __init__(
        self,
        cell_file: Path,
        log: Path,
        good: Callable[[dict[str, object]], bool] = has_devices,
    ) -> None:
        self.cell_file = cell_file
        self.log = log
        self.good = good
        self.runtime = cell_file.parent / "run"
        self.control = ControlClient(self.runtime / "control.sock")

    def __enter__(self) -> "Daemon":
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                dying_with_us(self.command()), stderr=log, stdout=log, start_new_session=True
            )
        try:
            self.wait_until(self.good)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def command(self) -> list[str]:
        """How it is started; what this becomes is the gate."""
        return [sys.executable, "-m", "vgrd.cli", "run", str(self.cell_file)]

    def wait_until(
        self, good: Callable[[dict[str, object]], bool], timeout_s: float = START_TIMEOUT_S
    ) -> float:
        """Wait until the status is good; seconds waited. TimeoutError with the last word and the log."""
        start, word = time.monotonic(), "no status"
        while time.monotonic() - start < timeout_s:
            if self.process.poll() is not None:
                break
            try:
                status = self.control.call("status", timeout_s=5.0)
            except (DaemonUnreachable, ControlError) as err:
                word = str(err)
            else:
                if good(status):
                    return time.monotonic() - start
                word = str(status)
            time.sleep(0.02)
        tail = self.log.read_text(encoding="utf-8", errors="replace")[-3000:]
        raise TimeoutError(f"the daemon is not as wanted after {timeout_s:.0f} s: {word}\n{tail}")

    def call(self, op: str, **arguments: object) -> dict[str, object]:
        """Result of a control operation, however busy the machine is. ControlError when it is refused."""
        return self.control.call(op, timeout_s=REPLY_TIMEOUT_S, **arguments)

    def confirm(self) -> None:
        """Confirm what stopped serving, as soon as it is gone. ControlError where it stays."""
        end_s = time.monotonic() + REPLY_TIMEOUT_S
        while True:
            try:
                self.call("confirm")
            except ControlError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(0.1)
            else:
                return

    def stop(self) -> float:
        """Stop by SIGTERM; seconds until it was gone."""
        start = time.monotonic()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        return time.monotonic() - start

    def pid_of(self, process: str) -> int:
        """Process id of "cell", "robot" or "camera", from its health ring."""
        path = self.runtime / HEALTH_FOLDER / f"{process}.ring"
        with RingReader.open(path, HEALTH_KIND) as ring:
            message = ring.newest()
        pid = Health.unpack(message.payload).pid if message else 0
        if not pid:  # a signal to process 0 would hit us and all of our group
            raise LookupError(f"{process} has not said anything yet")
        return pid

    def wait_reborn(self, process: str, former_pid: int) -> None:
        """Wait until a process runs again, as another one than `former_pid`. TimeoutError."""
        end_s = time.monotonic() + START_TIMEOUT_S
        while time.monotonic() < end_s:
            with contextlib.suppress(LookupError, IpcError):  # its ring is new and empty
                if self.pid_of(process) != former_pid:
                    return
            time.sleep(0.01)
        raise TimeoutError(f"{process} does not run again after {START_TIMEOUT_S:.0f} s")

    def pids(self) -> dict[str, int]:
        """Process ids of the gate and its children."""
        children = {name: self.pid_of(name) for name in ("cell", "robot", "camera")}
        return {"gate": self.process.pid, **children}

    def kill(self, process: str) -> None:
        """Kill one of the daemon's processes with SIGKILL."""
        os.kill(self.pid_of(process), signal.SIGKILL)
