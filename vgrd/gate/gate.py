"""The gate put together: registers served, processes kept alive, systemd told."""

import asyncio
import fcntl
import os
import signal
import socket
from collections import Counter
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import structlog

from vgrd import logs
from vgrd.clock import Clock
from vgrd.errors import AlreadyRunning
from vgrd.gate import systemd
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.lines import LINES, Desk
from vgrd.gate.link import CellLink
from vgrd.gate.pdu import MODBUS, Data
from vgrd.gate.register_bank import RegisterBank
from vgrd.gate.server import ConnectionLimits, Server
from vgrd.gate.settings import GateSettings
from vgrd.gate.supervisor import CONFIG_EXIT, Supervisor
from vgrd.gate.wanted import WantedTable
from vgrd.ipc.messages import GATE_BYTES, GATE_KIND, GATE_RING, GATE_SLOTS, GateReport
from vgrd.ipc.ring import RingWriter
from vgrd.registers import Request, Status, request_message

LOCK_FILE: Final = "gate.lock"
TICK_S: Final = 0.02  # as the cell publishes: the registers follow the cell within 40 ms
REPORT_S: Final = 0.25  # chosen: `vgrd status` and `vgrd reload` wait no longer for the gate
SWEEP_S: Final = 0.25  # a quarter of the second after which cut frames end
ABUSE_LOG_S: Final = 1.0  # at most one line a second, however hard somebody knocks
_PID_BYTES: Final = 32  # more digits than any process number has
LINE_CONNECTIONS: Final = 128  # chosen: a hundred clients, and room for those who come back
_KINDS: Final = ("refused", "garbage", "timeouts", "evicted")
_ABUSE: Final = (*_KINDS, *(f"line_{kind}" for kind in _KINDS))

log = structlog.get_logger()


class LastUse:
    """When the robot asked and read last, by what the register bank has counted since the last look."""

    def __init__(self) -> None:
        self._counted = (0, 0)
        self._times: list[float | None] = [None, None]

    def times(self, requests: int, reads: int, now_s: float) -> tuple[float | None, float | None]:
        """Of the last request and the last read, None for none so far; a new bank counts from 0."""
        counted = (requests, reads)
        for i, (now, before) in enumerate(zip(counted, self._counted, strict=True)):
            if now not in (before, 0):
                self._times[i] = now_s
        self._counted = counted
        return self._times[0], self._times[1]


def lock(runtime_dir: Path) -> int:
    """Claim the runtime folder until the returned descriptor is closed. Raises AlreadyRunning."""
    fd = os.open(runtime_dir / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        holder = os.read(fd, _PID_BYTES).decode(errors="replace") or "?"
        os.close(fd)
        raise AlreadyRunning(
            f"{runtime_dir}: another daemon (process {holder}) uses this runtime folder; stop it"
            " first or give this cell a runtime_dir of its own"
        ) from error
    os.ftruncate(fd, 0)
    os.write(fd, str(os.getpid()).encode())
    return fd


class Gate:
    """One run of the daemon's parent process."""

    def __init__(self, settings: GateSettings, runtime_dir: Path, clock: Clock) -> None:
        self._settings, self._clock = settings, clock
        self._link: CellLink | None = None
        self._stop = asyncio.Event()
        self._manager = systemd.ServiceManager()
        self._failure: BaseException | None = None
        self._runtime_dir = runtime_dir
        self._bank = self._new_bank()
        self._wanted = WantedTable(runtime_dir)
        limits = ConnectionLimits(allow=settings.allow)
        self._server = Server[Data](MODBUS, self._bank, clock, limits)
        more = replace(limits, connections=LINE_CONNECTIONS)
        self._lines = Server[Desk](LINES, self._bank, clock, more)
        self._supervisor = Supervisor(
            settings.processes, runtime_dir, clock, self._cell_started, self._cell_ended
        )
        self._ring = RingWriter.create(runtime_dir / GATE_RING, GATE_SLOTS, GATE_BYTES, GATE_KIND)
        self._port, self._line_port = settings.port, settings.line_port
        self._status_words = ""
        self._use = LastUse()
        self._abuse: Counter[str] = Counter()

    async def run(self) -> None:
        """Serve until SIGTERM or SIGINT. Raises ServingError when the port cannot be had."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop.set)
        loop.set_exception_handler(self._fail)
        settings = self._settings
        inherited = systemd.inherited_socket()
        self._port = await self._server.listen(settings.host, settings.port, inherited)
        if settings.line_port is not None:
            self._line_port = await self._lines.listen(settings.host, settings.line_port)
        log.info(
            "serving",
            cell=settings.cell,
            host=settings.host,
            port=self._port,
            line_port=self._line_port,
        )
        self._manager.tell(READY="1", STATUS=f"serving on {settings.host}:{self._port}")
        try:
            async with asyncio.TaskGroup() as tasks:
                chores = [tasks.create_task(chore) for chore in self._chores()]
                await self._stop.wait()
                await self._shut_down()
                for chore in chores:
                    chore.cancel()
        finally:
            self._server.close()
            self._lines.close()
            self._ring.close()
        if self._failure is not None:
            raise self._failure

    def _chores(self) -> list[Coroutine[object, object, None]]:
        """What runs as long as the gate; the end of one of them by an error is the gate's end."""
        chores = [
            self._supervisor.run(),
            self._each(TICK_S, self._refresh),
            self._follow_wanted(),
            self._each(SWEEP_S, self._server.sweep),
            self._each(SWEEP_S, self._lines.sweep),
            self._each(REPORT_S, self._report),
            self._each(ABUSE_LOG_S, self._log_abuse),
        ]
        if period_s := systemd.watchdog_period_s():
            chores.append(self._each(period_s, self._kick))
        return chores

    def _fail(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """End, and be started anew, when a callback of the loop failed: half a gate is none."""
        error = context.get("exception")
        log.error("callback_failed", what=context["message"], exc_info=error)
        self._failure = self._failure or error or RuntimeError(context["message"])
        self._stop.set()

    def _new_bank(self) -> RegisterBank:
        return RegisterBank(
            ImageFeed(self._runtime_dir, self._clock),
            self._clock,
            deadline_s=self._settings.deadline_s,
            timeout_s=self._settings.timeout_s,
            scale=self._settings.int16_scale,
            forward=self._forward,
            abort=self._abort,
        )

    async def _follow_wanted(self) -> None:
        """Take over what `vgrd reload` wants; the port stays open, the registers invalid meanwhile."""
        while not self._stop.is_set():
            if wanted := self._wanted.take(self._settings):
                await self._change(wanted)
            await asyncio.sleep(REPORT_S)

    async def _change(self, wanted: GateSettings) -> None:
        log.info("reloading", loaded_unix_s=wanted.loaded_unix_s)
        await self._supervisor.change(wanted.processes)
        self._settings, counters = wanted, self._bank.counters
        self._bank = self._new_bank()
        self._bank.counters.update(counters)
        self._bank.cell_lost()  # its last image belongs to the old table
        self._server.serve_from_now_on(self._bank, wanted.allow)
        self._lines.serve_from_now_on(self._bank, wanted.allow)
        self._supervisor.start()
        self._wanted.mark_in_force(wanted)

    async def _shut_down(self) -> None:
        log.info("stopping")
        self._manager.tell(STOPPING="1", STATUS="stopping")
        self._bank.close(Status.SHUTTING_DOWN)
        await self._supervisor.stop()
        self._report()
        log.info("stopped")

    async def _each(self, period_s: float, chore: Callable[[], None]) -> None:
        while True:
            chore()
            await asyncio.sleep(period_s)

    def _forward(self, request: Request) -> bool:
        return self._link is not None and self._link.send(**request_message(request))

    def _abort(self) -> None:
        if self._link:
            self._link.send(op="abort")

    def _cell_started(self, gate_end: socket.socket) -> None:
        self._link = CellLink(gate_end, self._log_message)

    def _cell_ended(self, exit_code: int) -> None:
        if self._link:
            self._link.close()
        self._link = None
        self._bank.cell_lost()
        if exit_code == CONFIG_EXIT:
            self._bank.close(Status.CONFIG_ERROR)

    def _log_message(self, message: dict[str, object]) -> None:
        log.info("cell_says", **{"what": message.pop("op", "?"), **message})

    def _refresh(self) -> None:
        self._bank.refresh()

    def _kick(self) -> None:
        self._manager.tell(WATCHDOG="1")

    def _report(self) -> None:
        counters = {**self._counters(), **self._bank.counters}
        rows, now_s = self._supervisor.reports(), self._clock.monotonic()
        report = GateReport(
            os.getpid(),
            self._settings.host,
            self._port,
            counters,
            rows,
            self._wanted.asked_unix_s,
            self._wanted.refused,
            self._line_port,
            self._bank.response.hex(),
            *self._use.times(self._bank.counters["triggers"], self._bank.reads, now_s),
        )
        self._ring.publish(report.pack(), stamp_s=now_s)
        words = ", ".join(f"{row.name} {row.health}" for row in rows)
        if words != self._status_words:
            self._status_words = words
            self._manager.tell(STATUS=words)
            if all(row.health == "ok" for row in rows):  # losses are logged by who has them
                log.info("ready", state=f"{words}, serving on {report.host}:{report.port}")
        self._manager.catch_up()

    def _counters(self) -> dict[str, int]:
        """Of both servers, and how many connections each has."""
        counters = {**self._server.counters, "connections": self._server.connections}
        if self._line_port is not None:
            counters |= {f"line_{name}": n for name, n in self._lines.counters.items()}
            counters["line_connections"] = self._lines.connections
        return counters

    def _log_abuse(self) -> None:
        """At most one line a second, however hard somebody knocks, and the sums of the others."""
        counters = self._counters()
        now = Counter({name: count for name, count in counters.items() if name in _ABUSE})
        if more := now - self._abuse:
            log.warning("clients", **more)
        self._abuse = now
        logs.sum_up()
