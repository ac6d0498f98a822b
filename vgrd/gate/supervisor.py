"""Keeps the processes of the table running: starts, watches, restarts, stops them."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

import structlog

from vgrd.clock import Clock
from vgrd.errors import ConfigError, DeviceRefused, IpcError
from vgrd.gate.child import Child
from vgrd.gate.settings import CELL_KIND, ProcessSpec
from vgrd.ipc.health import health_path
from vgrd.ipc.messages import HEALTH_KIND, Health, ProcessReport
from vgrd.ipc.ring import RingReader

FIRST_DELAY_S: Final = 0.25  # little beside the 1.6 s of a start
GROWTH: Final = 1.5  # of the delay: the fourth end in a row still waits less than a second
LAST_DELAY_S: Final = 2.0  # with 1.6 s for its start, a device that is back serves within 5 s
REFUSED_DELAY_S: Final = 5.0  # what somebody has to mend first
GOOD_AFTER_S: Final = 30.0  # a process that lived so long begins with the first delay again
STOP_S: Final = 1.0  # from SIGTERM to SIGKILL; the service manager waits 5 s for the gate
LOOK_S: Final = 0.1  # a look costs one ring read; hangs are told after 5 s (`hang_s`)
REFUSED_EXIT: Final = DeviceRefused.exit_code
CONFIG_EXIT: Final = ConfigError.exit_code

GATE_FD: Final = "VGRD_GATE_FD"

log = structlog.get_logger()


class HealthWatch:
    """Whether a process makes progress; counts only time in which the gate itself ran."""

    def __init__(self, path: Path, spec: ProcessSpec, pid: int) -> None:
        self.health: Health | None = None
        self._path, self._spec, self._pid = path, spec, pid
        self._reader: RingReader | None = None
        self._silent_s = 0.0

    def is_hung(self, elapsed_s: float) -> bool:
        """Look once, `elapsed_s` after the last look."""
        if self._spec.hang_s is None:
            return False
        self._silent_s += min(elapsed_s, 2 * LOOK_S)
        health = self._read()
        if health and (self.health is None or health.progress != self.health.progress):
            self._silent_s = 0.0
        self.health = health or self.health
        return self._silent_s > (self._spec.hang_s if self.health else self._spec.start_s)

    def close(self) -> None:
        """Let go of the ring."""
        if self._reader:
            self._reader.close()

    def _read(self) -> Health | None:
        """Newest health of this very process, None while only its predecessor's is there."""
        try:
            if self._reader is None:
                self._reader = RingReader.open(self._path, HEALTH_KIND)
            message = self._reader.newest()
            health = Health.unpack(message.payload) if message else None
        except IpcError:
            return None
        return health if health and health.pid == self._pid else None


class Managed:
    """One row of the process table and its life."""

    def __init__(
        self,
        spec: ProcessSpec,
        runtime_dir: Path,
        clock: Clock,
        on_start: Callable[[socket.socket], None],
        on_end: Callable[[int], None],
    ) -> None:
        self.spec = spec
        self._path = health_path(runtime_dir, spec.name)
        self._clock = clock
        self._on_start, self._on_end = on_start, on_end
        self._child: Child | None = None
        self._watch: HealthWatch | None = None
        self._state: Literal["running", "waiting", "stopped"] = "waiting"
        self._starts = self._hangs = 0
        self._exit_code: int | None = None
        self.is_begun = False
        self._stopping = asyncio.Event()
        self._ended = asyncio.Event()

    async def keep_running(self) -> None:
        """Start it again whenever it ends, later each time; never after a configuration error."""
        delay_s = FIRST_DELAY_S
        while not self._stopping.is_set():
            start_s = self._clock.monotonic()
            self._exit_code = await self._live()
            lived_s = self._clock.monotonic() - start_s
            if self._exit_code == CONFIG_EXIT or self._stopping.is_set():
                break
            if lived_s > GOOD_AFTER_S:
                delay_s = FIRST_DELAY_S
            wait_s = REFUSED_DELAY_S if self._exit_code == REFUSED_EXIT else delay_s
            log.warning(
                "process_ended",
                child=self.spec.name,
                exit_code=self._exit_code,
                lived_s=round(lived_s, 2),
                restart_in_s=wait_s,
            )
            self._state = "waiting"
            with suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await self._stopping.wait()
            delay_s = min(GROWTH * delay_s, LAST_DELAY_S)
        self._state = "stopped"
        if not self._stopping.is_set():
            log.error("process_given_up", child=self.spec.name, exit_code=self._exit_code)
        self._ended.set()

    async def stop(self) -> None:
        """End it: SIGTERM, and SIGKILL a second later. Its end has been told when this returns."""
        self._stopping.set()
        if self._child is not None:
            await self._end(self._child)
        if self.is_begun:
            await self._ended.wait()

    async def _end(self, child: Child) -> None:
        child.terminate()
        try:
            async with asyncio.timeout(STOP_S):
                await child.wait()
        except TimeoutError:
            log.warning("process_killed", child=self.spec.name, reason="did not stop in time")
            child.kill()
            await child.wait()

    def report(self) -> ProcessReport:
        """Row for `vgrd status`."""
        health = self._watch.health if self._watch else None
        if health is None:
            health = Health(self.spec.name, "starting", 0)
        return ProcessReport(
            name=self.spec.name,
            kind=self.spec.kind,
            pid=self._child.pid if self._child else 0,
            state=self._state,
            starts=self._starts,
            hangs=self._hangs,
            exit_code=self._exit_code,
            health=health.state if self._state == "running" else "failed",
            detail=health.detail,
        )

    async def _live(self) -> int:
        """Run it once, to its end."""
        self._starts += 1
        try:
            self._child = self._start()
        except OSError as error:
            log.warning("process_not_started", child=self.spec.name, reason=str(error))
            return REFUSED_EXIT
        self._state = "running"
        log.info("process_started", child=self.spec.name, child_pid=self._child.pid)
        self._watch = HealthWatch(self._path, self.spec, self._child.pid)
        try:
            async with asyncio.TaskGroup() as tasks:
                watching = tasks.create_task(self._kill_when_hung(self._child, self._watch))
                exit_code = await self._child.wait()
                watching.cancel()
        finally:
            self._watch.close()
            self._child = None
        self._on_end(exit_code)
        return exit_code

    def _start(self) -> Child:
        if self.spec.kind != CELL_KIND:
            return Child(self.spec.argv, self.spec.env)
        gate_end, cell_end = socket.socketpair()
        with cell_end:
            try:
                env = {**self.spec.env, GATE_FD: str(cell_end.fileno())}
                child = Child(self.spec.argv, env, [cell_end.fileno()])
            except OSError:
                gate_end.close()
                raise
        self._on_start(gate_end)
        return child

    async def _kill_when_hung(self, child: Child, watch: HealthWatch) -> None:
        last = self._clock.monotonic()
        while True:
            await asyncio.sleep(LOOK_S)
            now = self._clock.monotonic()
            if watch.is_hung(now - last):
                self._hangs += 1
                log.error("process_hung", child=self.spec.name, hang_s=self.spec.hang_s)
                child.kill()
                return
            last = now


class Supervisor:
    """The process table, alive. `on_cell_start` gets the gate's end of the cell's link."""

    def __init__(
        self,
        specs: tuple[ProcessSpec, ...],
        runtime_dir: Path,
        clock: Clock,
        on_cell_start: Callable[[socket.socket], None],
        on_cell_end: Callable[[int], None],
    ) -> None:
        self._specs = specs
        self._runtime_dir, self._clock = runtime_dir, clock
        self._on_cell_start, self._on_cell_end = on_cell_start, on_cell_end
        self._rows = [self._managed(spec) for spec in specs]
        self._tasks: asyncio.TaskGroup | None = None

    async def run(self) -> None:
        """Keep all of the table running until cancelled."""
        async with asyncio.TaskGroup() as self._tasks:
            self.start()
            await asyncio.Event().wait()

    def start(self) -> None:
        """Start those of the table that are not there yet, while `run` runs."""
        present = [row.spec for row in self._rows]
        self._rows += [self._managed(spec) for spec in self._specs if spec not in present]
        for row in self._rows:
            if not row.is_begun and self._tasks is not None:
                row.is_begun = True
                self._tasks.create_task(row.keep_running())

    async def change(self, specs: tuple[ProcessSpec, ...]) -> None:
        """Take another table: end, at once, what is not in it as it is; `start` starts the rest."""
        self._specs = specs
        leaving = [row for row in self._rows if row.spec not in specs]
        await self._end(leaving)
        self._rows = [row for row in self._rows if row not in leaving]

    async def stop(self) -> None:
        """End all of them at once, for good; takes little more than a second at most."""
        self._specs = ()
        await self._end(self._rows)

    async def _end(self, rows: list[Managed]) -> None:
        async with asyncio.TaskGroup() as tasks:
            for row in rows:
                tasks.create_task(row.stop())

    def _managed(self, spec: ProcessSpec) -> Managed:
        ends = self._on_cell_end if spec.kind == CELL_KIND else _ignore
        return Managed(spec, self._runtime_dir, self._clock, self._on_cell_start, ends)

    def reports(self) -> tuple[ProcessReport, ...]:
        """Rows for `vgrd status`."""
        return tuple(row.report() for row in self._rows)


def _ignore(exit_code: int) -> None:
    """Nobody waits for the end of a device process."""
