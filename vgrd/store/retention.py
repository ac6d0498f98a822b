"""How much the recorded sessions may take: the oldest give way, never one that is still needed.

Never removed: a session that is being recorded or solved, one that a calibration cites, and the
newest two (the one just taught is not solved yet). Where a calibration cannot be read, nothing is
removed, since it may cite any of them.
"""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import Timeout

from vgrd.errors import InputError, StoreError
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.files import guarded, sync_directory
from vgrd.store.sessions import list_sessions, session_directory, session_lock

KEPT_NEWEST = 2  # the session just taught and the one before it
_REMOVED = ".removed-"
_GB = 1e9  # bytes, as disks are sold


@dataclass(frozen=True, slots=True)
class Room:
    """What the sessions take after old ones have given way; trouble: why they take too much."""

    used_bytes: int
    removed: tuple[str, ...] = ()
    trouble: str = ""


def used_bytes(state_dir: Path) -> dict[str, int]:
    """Bytes that each session takes on the disk, oldest session first."""
    return {name: _size(session_directory(state_dir, name)) for name in list_sessions(state_dir)}


def make_room(state_dir: Path, quota_bytes: int) -> Room:
    """Remove the oldest sessions that are not needed until all take `quota_bytes` at most.

    What a disk or a calibration that cannot be read stops is told as trouble, beside what was removed
    before. Raises StoreError where the sessions cannot be read, or the rest of one not be deleted.
    """
    _finish_removals(state_dir)
    sizes = used_bytes(state_dir)
    total, trouble = sum(sizes.values()), ""
    removed: list[str] = []
    try:
        for name in list(sizes)[:-KEPT_NEWEST]:
            if total <= quota_bytes:
                break
            if removed_path := _remove(state_dir, name):
                removed.append(name)
                _delete(removed_path)
                total -= sizes[name]
    except StoreError as error:
        trouble = str(error)
    if total > quota_bytes and not trouble:
        trouble = (
            f"the sessions take {total / _GB:.1f} GB of {quota_bytes / _GB:g} GB and all are needed: "
            "raise [recording] quota_gb, or move sessions and the calibrations that cite them away"
        )
    return Room(total, tuple(removed), trouble)


@contextmanager
def in_use(directory: Path) -> Iterator[None]:
    """Keep a session while its files are read and until the calibration that cites it is stored."""
    with guarded("read", directory):
        descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks: nothing else is lost
            fcntl.flock(descriptor, fcntl.LOCK_SH)
        yield
    finally:
        os.close(descriptor)


def _remove(state_dir: Path, name: str) -> Path | None:
    """Set a session aside that nobody needs, to be deleted; None for one that is needed."""
    directory = session_directory(state_dir, name)
    lock = session_lock(directory)
    with guarded("remove", directory):
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return None
        try:
            return None if name in _cited(state_dir) else _set_aside(directory)
        finally:
            lock.release()


def _set_aside(directory: Path) -> Path | None:
    """Rename a session, so that no half of one is ever found; None where somebody reads it."""
    removed_path = directory.with_name(_REMOVED + directory.name)
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        directory.replace(removed_path)
        sync_directory(removed_path.parent)
    except BlockingIOError:
        return None
    finally:
        os.close(descriptor)
    return removed_path


def _cited(state_dir: Path) -> frozenset[str]:
    """Sessions that stored calibrations were solved from; StoreError if one cannot be read."""
    store = CalibrationStore(state_dir)
    try:
        return frozenset(store.load(name).session for name in store.list())
    except (StoreError, InputError) as error:
        raise StoreError(
            f"no session is removed, since a calibration may cite it: {error}"
        ) from error


def _finish_removals(state_dir: Path) -> None:
    """Delete what a kill left of removed sessions."""
    for removed_path in (state_dir / "sessions").glob(_REMOVED + "*"):
        _delete(removed_path)


def _delete(directory: Path) -> None:
    with guarded("remove", directory):
        shutil.rmtree(directory)


def _size(directory: Path) -> int:
    total = 0
    with guarded("read", directory):
        for file in directory.iterdir():
            # A segment is renamed when it is full.
            with contextlib.suppress(FileNotFoundError):
                total += file.stat().st_size
    return total
