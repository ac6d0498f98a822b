"""Which processes run: below one, or started by somebody who left a mark in their environment."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

MARK = "VGRD_STARTED_BY"
_LOOK_S = 0.05  # a look reads all of /proc: more often it would be load itself


def descendants(pid: int) -> Iterator[int]:
    """The process itself and all below it."""
    yield pid
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = task.read_text(encoding="ascii").split()
        except OSError:
            continue
        for child in children:
            yield from descendants(int(child))


def is_alive(pid: int) -> bool:
    """It runs; one that has ended and was not collected yet does not."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] not in ("Z", "X")


def started_s(pid: int) -> float:
    """When a process was started (monotonic), to the hundredth; ProcessLookupError when it is gone."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError as err:
        raise ProcessLookupError(pid) from err
    ticks = int(text.rpartition(")")[2].split()[19])  # field 22, counted from the state, field 3
    since_boot_s = ticks / os.sysconf("SC_CLK_TCK")
    slept_s = time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
    return since_boot_s - slept_s


def marked(mark: str) -> dict[int, str]:
    """Command by process id of all that were started with the environment variable MARK set to `mark`.

    Left out: multiprocessing's resource tracker, which ends with its user.
    """
    variable = f"{MARK}={mark}".encode()
    commands = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if variable not in (folder / "environ").read_bytes().split(b"\0"):
                continue
            command = (
                (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            )
        except OSError:  # gone, or somebody else's
            continue
        pid = int(folder.name)
        if (
            pid != os.getpid()
            and is_alive(pid)
            and "multiprocessing.resource_tracker" not in command
        ):
            commands[pid] = command.strip()
    return commands


def left_behind(mark: str, within_s: float) -> dict[int, str]:
    """What of the marked processes is still there after `within_s`; ends those."""
    end_s = time.monotonic() + within_s
    while (left := marked(mark)) and time.monotonic() < end_s:
        time.sleep(_LOOK_S)
    for pid in left:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
    return left
