"""Time that passes as fast as it can be computed: a clock, and an event loop that runs by it.

The loop never sleeps: when nothing is ready, the clock goes to the next timer. Threads do not run; what is
given to an executor is computed at once, and its result comes `executor_s` later by the clock. Every
simulated process is a name in the context of its tasks and callbacks, so that one of them can be stopped as
SIGSTOP does, and go on later.
"""

import asyncio
import heapq
import selectors
from collections import deque
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

PROCESS: ContextVar[str] = ContextVar("PROCESS", default="")
START_S = 1000.0  # of the monotonic clock; any
START_UNIX_S = 1.7e9  # of the wall clock, far from the other: which one was meant, shows


class SimulatedClock:
    """Both clocks of the machine; `step_wall` is what NTP or a person does to one of them."""

    def __init__(self) -> None:
        self.now_s = START_S
        self._wall_minus_monotonic_s = START_UNIX_S - START_S

    def monotonic(self) -> float:
        return self.now_s

    def wall(self) -> float:
        return self.now_s + self._wall_minus_monotonic_s

    def step_wall(self, seconds: float) -> None:
        self._wall_minus_monotonic_s += seconds

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Runs by a `SimulatedClock`. executor_s: by process, how long a call in a thread takes."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock = clock
        self.executor_s: dict[str, Callable[[], float]] = {}
        self.lines: dict[object, Callable[[], None]] = {}  # readers of sockets that are none
        self._standing: dict[str, list[asyncio.Handle]] = {}
        self._connections: dict[str, list[asyncio.Transport]] = {}
        super().__init__(_EpollThatNeverWaits())

    def time(self) -> float:
        return self.clock.now_s

    def stop_process(self, name: str) -> None:
        """SIGSTOP: nothing of it runs until `continue_process`."""
        self._standing.setdefault(name, [])

    def continue_process(self, name: str) -> None:
        self._ready.extend(self._standing.pop(name, []))

    def is_stopped(self, name: str) -> bool:
        return name in self._standing

    def forget_process(self, name: str) -> None:
        """It ended: what was stopped never runs, and its connections are hung up."""
        self._standing.pop(name, None)
        for transport in self._connections.pop(name, []):
            transport.abort()

    def run_for(self, seconds: float) -> None:
        """Let so much time pass."""
        self.run_until_complete(_at(self, self.clock.now_s + seconds))

    def run_in_executor(self, executor: object, func: Callable[..., Any], *args: Any) -> Any:
        future = self.create_future()
        wait_s = self.executor_s.get(PROCESS.get(), float)()
        try:
            result = func(*args)
        except Exception as err:  # noqa: BLE001  an executor takes all of them along
            self.call_later(wait_s, _settle, future, None, err)
        else:
            self.call_later(wait_s, _settle, future, result, None)
        return future

    async def create_unix_connection(self, *args: Any, **options: Any) -> Any:
        transport, protocol = await super().create_unix_connection(*args, **options)
        self._connections.setdefault(PROCESS.get(), []).append(transport)
        return transport, protocol

    def add_reader(self, fd: Any, callback: Callable[..., None], *args: Any) -> None:
        if isinstance(fd, int) or not hasattr(fd, "asked"):
            super().add_reader(fd, callback, *args)
        else:
            self.lines[fd] = callback

    def remove_reader(self, fd: Any) -> bool:
        if isinstance(fd, int) or not hasattr(fd, "asked"):
            return super().remove_reader(fd)
        return self.lines.pop(fd, None) is not None

    def remove_writer(self, fd: Any) -> bool:
        return hasattr(fd, "asked") or super().remove_writer(fd)

    def _run_once(self) -> None:
        """One turn, as asyncio's; what belongs to a process that stands is put aside."""
        self._collect_timers()
        self._put_aside()
        if not self._ready:
            self._process_events(self._selector.select(0))
            self._put_aside()
        if not self._ready and self._scheduled:
            self.clock.now_s = max(self.clock.now_s, self._scheduled[0].when())
            self._collect_timers()
            self._put_aside()
        ready: deque[asyncio.Handle] = self._ready
        for _ in range(len(ready)):
            handle = ready.popleft()
            if not handle.cancelled():
                handle._run()

    def _put_aside(self) -> None:
        """A socket that a process does not read goes on being readable: its handle comes again."""
        if not self._standing:
            return
        others: list[asyncio.Handle] = []
        for handle in self._ready:
            aside = self._standing.get(handle._context.get(PROCESS, ""))
            if aside is None:
                others.append(handle)
            elif handle not in aside:
                aside.append(handle)
        self._ready.clear()
        self._ready.extend(others)

    def _collect_timers(self) -> None:
        timers, now = self._scheduled, self.clock.now_s
        while timers and (timers[0].cancelled() or timers[0].when() <= now):
            timer = heapq.heappop(timers)
            timer._scheduled = False
            if not timer.cancelled():
                self._ready.append(timer)


class _EpollThatNeverWaits(selectors.DefaultSelector):
    def select(self, timeout: float | None = None) -> Any:
        del timeout
        return super().select(0)


def _settle(future: asyncio.Future[Any], result: object, error: BaseException | None) -> None:
    if future.done():
        return
    if error is None:
        future.set_result(result)
    else:
        future.set_exception(error)


async def _at(loop: SimulatedLoop, when_s: float) -> None:
    reached = loop.create_future()
    loop.call_at(when_s, _settle, reached, None, None)
    await reached
