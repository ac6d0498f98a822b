"""Puts a backup in place: what is there is never lost, and never overwritten unasked."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from vgrd.backup.archive import (
    CALIBRATIONS,
    CELL,
    DIARY,
    JOURNAL,
    LATCH,
    TRIALS,
    Content,
    unpack,
)
from vgrd.clock import Clock
from vgrd.errors import InputError, NoCurrentCalibration
from vgrd.permissions import make_folder, take_after
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.files import guarded, sync_directory

_DRAFT = ".restoring"
_READABLE = 0o644  # a cell file holds no secret


@dataclass(frozen=True, slots=True)
class Restored:
    """current: the calibration in use, "" without one. set_aside: folder with what was there before, if anything."""

    content: Content
    current: str
    set_aside: Path | None


def restore(
    archive: Path, state_dir: Path, cell_file: Path, clock: Clock, *, replace: bool
) -> Restored:
    """Put state and cell file of a backup in place; the daemon must not run.

    replace: also where what is there is not in the backup; it is set aside under another name. Raises
    InputError (not a backup, would overwrite), Corrupt, SchemaTooNew, StoreError; all is as before then.
    """
    with guarded("restore into", state_dir), _draft(state_dir) as draft:
        content = unpack(archive, draft)
        current = _usable(draft)
        pieces = list(_pieces(draft, state_dir, cell_file))
        others = [str(place) for new, place in pieces if not _goes_on(new, place)]
        if others and not replace:
            raise InputError(
                f"{', '.join(others)}: is not what {archive} has, and may be newer; "
                "with --replace it is set aside, not lost"
            )
        aside = state_dir / f"before-restore-{round(clock.wall())}"
        is_moved = [_place(new, place, aside) for new, place in pieces]
    return Restored(content, current, aside if any(is_moved) else None)


@contextmanager
def _draft(state_dir: Path) -> Iterator[Path]:
    """A folder for what is unpacked, on the disk of the state; what a kill left of one is removed."""
    draft = state_dir / _DRAFT
    make_folder(state_dir)
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(mode=0o700)
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _usable(draft: Path) -> str:
    """Id of the calibration in use, "" without one; raises SchemaTooNew, Corrupt for what cannot be read."""
    store = CalibrationStore(draft)
    for name in store.list():
        store.read(name)
    try:
        return store.current().id
    except NoCurrentCalibration:
        return ""


def _pieces(draft: Path, state_dir: Path, cell_file: Path) -> Iterator[tuple[Path, Path]]:
    """What is unpacked, and where each of it belongs; nothing of what is there already."""
    names = (CALIBRATIONS, TRIALS, DIARY, LATCH)
    places = [(draft / name, state_dir / name) for name in names]
    places.append((draft / CELL, cell_file))
    sessions = draft / "sessions"
    for session in sorted(sessions.iterdir()) if sessions.exists() else ():
        places.append((session, state_dir / "sessions" / session.name))
    for new, place in places:
        if new.exists() and not _is_same(new, place):
            yield new, place


def _is_same(new: Path, old: Path) -> bool:
    """The same files, to the last bit."""
    if not old.exists():
        return False
    if new.is_file():
        return new.read_bytes() == old.read_bytes()
    return _names(new) == _names(old) and all(
        _is_same(new / name, old / name) for name in _names(new)
    )


def _goes_on(new: Path, old: Path) -> bool:
    """Whether nothing of `old` is lost with `new` in its place: calibrations may have become more."""
    if (
        not old.exists() or old.name == DIARY
    ):  # a spare's daemon writes one by itself; it is set aside
        return True
    if old.name != CALIBRATIONS:
        return _is_same(new, old)
    told = (new / JOURNAL, old / JOURNAL)
    after, before = (path.read_bytes() if path.exists() else b"" for path in told)
    kept = _names(old) - {JOURNAL, "CURRENT"}
    return after.startswith(before) and all(_is_same(new / name, old / name) for name in kept)


def _names(folder: Path) -> frozenset[str]:
    """What is in a folder, but for locks and drafts."""
    return frozenset(path.name for path in folder.iterdir() if not path.name.startswith("."))


def _place(new: Path, place: Path, aside: Path) -> bool:
    """Move it where it belongs; True where something was there, which is now in `aside`."""
    make_folder(place.parent)
    before = place.stat() if place.exists() else None
    if before:
        make_folder(aside)
        shutil.move(place, aside / place.name)
    shutil.move(new, place)
    if new.name == CELL:  # root writes it, and the service reads it
        place.chmod(_READABLE if before is None else before.st_mode)
        if before and os.geteuid() == 0:
            os.chown(place, before.st_uid, before.st_gid)
    else:
        for entry in (place, *place.rglob("*")):
            take_after(entry, entry.parent)
    sync_directory(place.parent)
    return before is not None
