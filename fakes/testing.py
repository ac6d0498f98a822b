"""Helpers of the tests: fakes as processes, addresses of one's own."""

import contextlib
import os
import queue
import socket
import subprocess
import sys
import threading

from vgrd.orphans import dying_with_us

_START_S = 120.0  # for ten times as much work as processors; far less else
_ANSWER_S = 60.0  # idem: a fake answers in milliseconds


def free_loopback(port: int) -> str:
    """Return a 127.x.y.z of which `port` (TCP and UDP) is free, another one in every process."""
    for attempt in range(100):
        host = _loopback(os.getpid() + 7919 * attempt)
        with contextlib.suppress(OSError):
            for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
                with socket.socket(socket.AF_INET, kind) as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    probe.bind((host, port))
            return host
    raise OSError(f"no free loopback address for port {port}")


def free_port(host: str = "127.0.0.1") -> int:
    """Find a TCP port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _loopback(number: int) -> str:
    low = number % (64 * 256 * 254)
    return f"127.{64 + low // (256 * 254)}.{low // 254 % 256}.{1 + low % 254}"


class FakeProcess:
    """`python -m fakes NAME OPTIONS` from `with` to its end; `type` a line at it.

    It ends with this process, however that ends; to be started from the main thread.
    """

    def __init__(self, *arguments: str) -> None:
        self._arguments = arguments
        self._lines: queue.Queue[str] = queue.Queue()

    def __enter__(self) -> "FakeProcess":
        self._process = subprocess.Popen(
            dying_with_us([sys.executable, "-m", "fakes", *self._arguments]),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.ready = self._answer(_START_S)
        return self

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self._lines.put(line.strip())
        self._lines.put("")

    def _answer(self, timeout_s: float) -> str:
        line = self._lines.get(timeout=timeout_s)
        if not line:
            raise ChildProcessError(f"fakes {' '.join(self._arguments)} ended")
        return line

    def option(self, name: str) -> str:
        """Return the value that the option `name` was started with."""
        return self._arguments[self._arguments.index(name) + 1]

    def type(self, line: str) -> None:
        """Let the fake obey `line`; ValueError when it does not understand."""
        if self._process.stdin:
            self._process.stdin.write(line + "\n")
        answer = self._answer(_ANSWER_S)
        if not answer.startswith("ok"):
            raise ValueError(answer)

    def again(self) -> "FakeProcess":
        """One more like it, not started yet."""
        return FakeProcess(*self._arguments)

    def kill(self) -> None:
        """SIGKILL it."""
        self._process.kill()
        self._process.wait()

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(1.0)
        for stream in (self._process.stdin, self._process.stdout):
            if stream:
                with contextlib.suppress(OSError):
                    stream.close()


class ManualClock:
    """A clock that stands still until a test moves it."""

    def __init__(  # any times, far apart: which clock was meant, shows
        self, monotonic_s: float = 1000.0, wall_s: float = 1.7e9
    ) -> None:
        self.now_s = monotonic_s
        self._wall_minus_monotonic_s = wall_s - monotonic_s

    def monotonic(self) -> float:
        """Seconds as set by the test."""
        return self.now_s

    def wall(self) -> float:
        """Unix time that runs with `monotonic`."""
        return self.now_s + self._wall_minus_monotonic_s

    def sleep(self, seconds: float) -> None:
        """Move the clock."""
        self.now_s += seconds
