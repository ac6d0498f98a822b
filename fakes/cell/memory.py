"""Proportional memory of a process and all its descendants, from /proc."""

from pathlib import Path

from fakes.cell.processes import descendants


def pss_mib(pid: int) -> float:
    """Proportional set size of one process, MiB; 0 for one that is gone."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except (OSError, ValueError):
        return 0.0
    line = next(line for line in text.splitlines() if line.startswith("Pss:"))
    return int(line.split()[1]) / 1024


def tree_pss_mib(pid: int) -> float:
    """Proportional set size of a process and all its descendants, MiB."""
    return sum(pss_mib(each) for each in set(descendants(pid)))
