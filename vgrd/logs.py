"""Logging for all processes: console on a terminal, JSON lines otherwise; never blocking, never flooding.

Standard error may be a pipe that nobody reads, a full disk, a stuck journal, or closed: lines are
lost then, and counted, but no process waits. That holds for what C libraries, `faulthandler` and
the interpreter write too, since descriptor 2 itself is exchanged.

Lines of one kind are limited to five a second; then one line says how many more there were. The
first line of a kind is always written.
"""

import atexit
import faulthandler
import io
import logging
import os
import re
import select
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import structlog

LINES: Final = 5  # of one kind in one period: enough to see that it repeats, and how fast
PERIOD_S: Final = 1.0  # chosen: who reads along sees at once that it goes on
_KINDS: Final = 512  # remembered; more than all lines of the source, less than 1 MiB
_STANDARD_ERROR: Final = 2  # its file descriptor
_KIND_CHARACTERS: Final = 512  # of a value; the rest does not make another kind
_OUR_FIELDS: Final = ("timestamp", "process")

EventDict = MutableMapping[str, Any]


def configure(process: str, *, level: str | None = None, threads: bool = True) -> None:
    """Set up structlog on standard error and bind the name of the process to every line.

    threads: False in a process that must have one thread only; it calls `sum_up` once a second.
    """
    _fill_standard_descriptors()
    stream = UnblockedStream(_STANDARD_ERROR)
    sys.stderr = cast(io.TextIOWrapper, stream)
    faulthandler.enable(_STANDARD_ERROR)
    chosen = level or os.environ.get("VGRD_LOG_LEVEL", "info")
    renderer: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer() if stream.isatty() else structlog.processors.JSONRenderer()
    )
    limit = RateLimit(
        stream.write, [structlog.processors.format_exc_info, renderer], threads=threads
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            limit,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelName(chosen.upper())),
        logger_factory=structlog.WriteLoggerFactory(file=cast(io.TextIOWrapper, stream)),
        cache_logger_on_first_use=True,
    )
    structlog.contextvars.bind_contextvars(process=process)
    logging.basicConfig(handlers=[_LibraryLines()], level=logging.WARNING, force=True)
    logging.captureWarnings(True)
    _limits[:] = [limit]
    atexit.register(limit.sum_up, everything=True)


def sum_up() -> None:
    """Tell how many lines were left out, where a period is over."""
    for limit in _limits:
        limit.sum_up()


_limits: "list[RateLimit]" = []


class UnblockedStream(io.TextIOBase):
    """Writes lines to a descriptor if it takes them now, else drops and counts them.

    The descriptor is replaced by the same file opened anew, since O_NONBLOCK on an inherited one
    would hit all its users. What cannot be opened anew is a socket, written to without waiting
    (systemd's journal socket is ours alone, and is set so), or belongs to another user: a pipe is
    set not to block all the same, a terminal is asked before each line.
    """

    def __init__(self, fd: int) -> None:
        self.dropped = 0
        self._is_torn = False  # the last line went out in part
        self._fd = fd
        self._terminal = os.isatty(fd)
        self._must_ask = False
        self._socket: socket.socket | None = None
        if stat.S_ISSOCK(os.fstat(fd).st_mode):
            self._socket = socket.socket(fileno=os.dup(fd))
            if _is_journal(fd):
                self._socket.setblocking(False)
        elif not _open_anew(fd):
            self._must_ask = self._terminal
            os.set_blocking(fd, self._terminal)

    def isatty(self) -> bool:
        """Whether a person reads."""
        return self._terminal

    def fileno(self) -> int:
        """Descriptor of what is written to."""
        return self._fd

    def writable(self) -> bool:
        """Yes."""
        return True

    def write(self, text: str) -> int:
        """Write or drop `text`; the next line that gets through tells how many were dropped."""
        line = text
        if self.dropped:
            line = f"({self.dropped} lines dropped: standard error was full)\n{line}"
        if self._is_torn:
            line = f"\n{line}"
        data = line.encode(errors="backslashreplace")
        try:
            sent = self._send(data)
        except OSError:
            self.dropped += 1
        else:
            self._is_torn = sent < len(data)
            self.dropped = int(self._is_torn)
        return len(text)

    def _send(self, data: bytes) -> int:
        if self._socket:
            return self._socket.send(data, socket.MSG_DONTWAIT)
        if self._must_ask and not select.select([], [self._fd], [], 0)[1]:
            raise BlockingIOError
        return os.write(self._fd, data)


@dataclass(slots=True, eq=False)
class _Kind:
    """Lines of one kind in the present period."""

    begin_s: float
    written: int = 0
    left_out: int = 0
    last: EventDict | None = None


class RateLimit:
    """The last processor of structlog: renders a line, or leaves it out and counts it.

    A kind is the event, level, words and type of the exception; numbers do not make another one.
    `write` takes the lines that sum up.
    """

    def __init__(
        self,
        write: Callable[[str], object],
        render: Sequence[structlog.typing.Processor],
        *,
        threads: bool = False,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._render, self._now = write, render, now
        self._threads = threads
        self._timer: threading.Timer | None = None
        self._kinds: dict[tuple[object, ...], _Kind] = {}
        self._summing: list[_Kind] = []  # those of which something was left out
        self._lock = threading.RLock()

    def __call__(self, logger: object, method: str, line: EventDict) -> str:
        """Return the rendered line. Raises structlog.DropEvent for one that is left out."""
        with self._lock:
            self.sum_up()
            kind = self._kind_of(line)
            if kind.written < LINES:
                kind.written += 1
                return self._rendered(logger, method, line)
            if kind.last is None:
                self._summing.append(kind)
            kind.left_out += 1
            kind.last = line
            self._set_timer()
        raise structlog.DropEvent

    def sum_up(self, *, everything: bool = False) -> None:
        """Tell what was left out in the periods that are over, or in all."""
        with self._lock:
            now = self._now()
            ended = [k for k in self._summing if everything or now - k.begin_s >= PERIOD_S]
            self._summing = [kind for kind in self._summing if kind not in ended]
            for kind in ended:
                self._tell(kind)
                kind.begin_s, kind.written, kind.left_out, kind.last = now, 1, 0, None

    def _kind_of(self, line: EventDict) -> _Kind:
        now, key = self._now(), _key(line)
        kind = self._kinds.get(key)
        if kind is None or now - kind.begin_s >= PERIOD_S:
            kind = self._kinds[key] = _Kind(now)
            if len(self._kinds) > _KINDS:
                del self._kinds[next(iter(self._kinds))]
        return kind

    def _tell(self, kind: _Kind) -> None:
        """The last line that was left out, for all of them."""
        line = dict(kind.last or {})
        line.pop("exc_info", None)
        line["more"] = kind.left_out
        self._write(self._rendered(None, str(line.get("level", "info")), line) + "\n")

    def _rendered(self, logger: object, method: str, line: EventDict) -> str:
        rendered: Any = line
        for processor in self._render:
            rendered = processor(logger, method, rendered)
        return str(rendered)

    def _set_timer(self) -> None:
        if self._threads and self._timer is None:
            self._timer = threading.Timer(PERIOD_S, self._time_is_over)
            self._timer.daemon = True
            self._timer.start()

    def _time_is_over(self) -> None:
        with self._lock:
            self._timer = None
            self.sum_up()
            if self._summing:
                self._set_timer()


class _LibraryLines(logging.Handler):
    """Lines of libraries that use `logging`, asyncio's among them, go the same way."""

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a line on; its place in the library is its event."""
        level = min(max(record.levelno // 10 * 10, logging.DEBUG), logging.CRITICAL)
        structlog.get_logger().log(
            level, record.name, message=record.getMessage(), exc_info=record.exc_info
        )


def _key(line: EventDict) -> tuple[object, ...]:
    error = line.get("exc_info")
    if error is True:
        error = sys.exc_info()
    if isinstance(error, tuple):
        error = error[1]
    return (
        type(error).__name__,
        *((name, _words(value)) for name, value in line.items() if name not in _OUR_FIELDS),
    )


def _words(value: object) -> object:
    """What makes a value another kind: its words, not its numbers."""
    if isinstance(value, str):
        return re.sub(r"0x[0-9a-f]+|\d+", "#", value[:_KIND_CHARACTERS])
    return value if value is None or isinstance(value, bool) else type(value).__name__


def _fill_standard_descriptors() -> None:
    """Give 0, 1 and 2 to nobody's file: what is opened next would take a closed one's place."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _open_anew(fd: int) -> bool:
    """Put the same file, opened not to block, at `fd`; False where that is not allowed."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        fresh = os.open(f"/proc/self/fd/{fd}", flags)
    except OSError:
        return False
    os.dup2(fresh, fd)
    os.close(fresh)
    return True


def _is_journal(fd: int) -> bool:
    """Whether systemd made `fd` for this service, as it says in JOURNAL_STREAM (device:inode)."""
    status = os.fstat(fd)
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
