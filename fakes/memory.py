"""Proportional memory of a process and all its descendants, from /proc."""

from collections.abc import Iterator
from pathlib import Path


def pss_mib(pid: int) -> float:
    """Proportional set size of one process, MiB; 0 for one that is gone."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except (OSError, ValueError):
        return 0.0
    line = next(line for line in text.splitlines() if line.startswith("Pss:"))
    return int(line.split()[1]) / 1024


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


def tree_pss_mib(pid: int) -> float:
    """Proportional set size of a process and all its descendants, MiB."""
    return sum(pss_mib(each) for each in set(descendants(pid)))
