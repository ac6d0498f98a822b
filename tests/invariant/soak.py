"""A day of the cell and ten million reads: no lie, and memory, descriptors and disk stay as they are."""

import gc
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.invariant.rig import Rig
from tests.invariant.simulation.teaching import VARIANTS, Variant
from tests.invariant.walk import Walk, walked

HOURS, READS = 24.0, 10_000_000
READ_S = 0.025  # so that there are as many reads in a day
TOLD_S = 20.0  # real time between two lines
WARM_S = 600.0  # of the cell, in which caches fill
MEMORY_MIB = 30.0  # growth in all the time after that; Python gives memory back in large pieces
DESCRIPTORS = 4
DISK_KIB_PER_HOUR = 256.0  # the record of activations; everything else is written over
_PAGE_MIB = resource.getpagesize() / 2**20


class Growth(AssertionError):
    """Something grows that must not."""


@dataclass(frozen=True, slots=True)
class Use:
    """What a process and its cell take."""

    memory_mib: float
    descriptors: int
    disk_kib: float

    @classmethod
    def now(cls, folder: Path) -> "Use":
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        files = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
        return cls(
            _PAGE_MIB * pages, len(list(Path("/proc/self/fd").iterdir())), sum(files) / 1024
        )

    def check(self, later: "Use", hours: float) -> None:
        """Raises Growth."""
        for what, grown, limit in (
            ("MiB of memory", later.memory_mib - self.memory_mib, MEMORY_MIB),
            ("descriptors", later.descriptors - self.descriptors, DESCRIPTORS),
            ("KiB on the disk", later.disk_kib - self.disk_kib, DISK_KIB_PER_HOUR * hours + 64),
        ):
            if grown > limit:
                raise Growth(
                    f"{grown:.0f} {what} more after {hours:.2f} h, {limit:.0f} are allowed"
                )

    def __str__(self) -> str:
        return (
            f"{self.memory_mib:.0f} MiB, {self.descriptors} descriptors, {self.disk_kib:.0f} KiB"
        )


class Watch:
    """Looks at one cell while it walks; told to `tell` now and then. ends: when it has walked so far."""

    def __init__(self, walk: Walk, hours: float, tell: Callable[[str], None]) -> None:
        self.walk, self.hours, self.tell = walk, hours, tell
        self.first: Use | None = None
        self._told_s = time.monotonic()

    def look(self, rig: Rig) -> None:
        """After each step. Raises Growth."""
        if self.first is None and rig.awake_s > WARM_S:
            _raise_all(rig)
            self.first = Use.now(rig.daemon.folder)
        if time.monotonic() - self._told_s > TOLD_S:
            self._told_s = time.monotonic()
            reads = self.walk.counts["reads"] + rig.judge.counts["reads"]
            self.tell(f"{self.walk.variant}: {rig.awake_s / 3600:.2f} h, {reads:,} reads")

    def end(self, rig: Rig) -> None:
        """Compare. Raises Growth."""
        _raise_all(rig)
        last = Use.now(rig.daemon.folder)
        self.tell(
            f"{self.walk.variant}: {self.first} after {WARM_S / 60:.0f} min, {last} at the end"
        )
        if self.first is not None:
            self.first.check(last, self.hours)


def _raise_all(rig: Rig) -> None:
    """Wait until every process runs: one that is just being started holds nothing yet."""
    rig.repair()
    while rig.daemon.cell is None:
        rig.repair()
    rig.repair()


def soak(
    hours: float,
    reads: int,
    seed: int,
    tell: Callable[[str], None],
    variants: Sequence[Variant] = VARIANTS,
) -> Walk:
    """Every variant for its share of what all take. Raises Lie, Growth."""
    total = Walk(VARIANTS[0], seed)
    share_h, share = hours / len(VARIANTS), reads // len(VARIANTS) + 1
    for variant in variants:
        watch = Watch(Walk(variant, seed), share_h, tell)
        total.add(
            walked(
                variant,
                seed,
                share,
                read_s=READ_S,
                at_least_s=3600 * share_h,
                on_step=watch.look,
                on_end=watch.end,
            )
        )
        tell(f"{variant}: done\n{total.summary()}")
    return total
