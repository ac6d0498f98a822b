"""One child process: started so that it cannot outlive the gate, watched through a pidfd.

The gate has one thread, so code may run between fork and exec (`preexec_fn`): no child needs a
launcher. The kernel sends PDEATHSIG when the gate ends. It holds across exec, and neither a handler
nor the GIL can stop it: a child that hangs in a vendor's library dies with the gate.
"""

import asyncio
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from vgrd.orphans import die_with

_NOT_FOR_CHILDREN: Final = frozenset(
    [
        "NOTIFY_SOCKET",
        "WATCHDOG_USEC",
        "WATCHDOG_PID",
        "LISTEN_FDS",
        "LISTEN_PID",
        "LISTEN_FDNAMES",
    ]
)


class Child:
    """A running process in a session of its own; Ctrl-C on the terminal does not reach it."""

    def __init__(
        self, argv: Sequence[str], env: Mapping[str, str], pass_fds: Sequence[int] = ()
    ) -> None:
        """Start it. Raises OSError when that is not possible."""
        inherited = {k: v for k, v in os.environ.items() if k not in _NOT_FOR_CHILDREN}
        self._process = subprocess.Popen(
            list(argv),
            env={**inherited, **env},
            stdin=subprocess.DEVNULL,
            stdout=2,  # what a library prints must not block either, see `logs`
            pass_fds=pass_fds,
            start_new_session=True,
            preexec_fn=partial(die_with, os.getpid()),
        )
        self.pid = self._process.pid
        self._pidfd = os.pidfd_open(self.pid)
        self._ended = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().add_reader(self._pidfd, self._collect)

    async def wait(self) -> int:
        """Exit code once it has ended, minus the signal's number when a signal ended it."""
        return int(await asyncio.shield(self._ended))

    def terminate(self) -> None:
        """Ask it to end."""
        if not self._ended.done():
            self._process.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it and whatever it started."""
        if not self._ended.done():
            os.killpg(self.pid, signal.SIGKILL)

    def _collect(self) -> None:
        """Reap it; before that its group id cannot belong to anybody else."""
        asyncio.get_running_loop().remove_reader(self._pidfd)
        os.close(self._pidfd)
        os.killpg(self.pid, signal.SIGKILL)
        self._ended.set_result(self._process.wait())
