"""Puts a backup in place: what is there is never lost, and never overwritten unasked."""

import contextlib
import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vgrd.backup.archive import (
    CALIBRATIONS,
    CELL,
    DIARY,
    JOURNAL,
    LATCH,
    SESSIONS,
    TRIALS,
    Content,
    unpack,
)
from vgrd.backup.moving import copy, move, remove, sync
from vgrd.clock import Clock
from vgrd.errors import InputError, NoCurrentCalibration, StoreError
from vgrd.permissions import make_folder
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
    What a kill or a power cut leaves of it can be repeated, and is on the disk when this returns.
    """
    cell_file = cell_file.resolve()  # a link to it stays one
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
        sync(draft)  # a full disk is told before anything is touched
        aside = _aside(state_dir, clock)
        _put_in_place(pieces, draft, aside)
    return Restored(content, current, aside if aside.exists() else None)


@contextlib.contextmanager
def _draft(state_dir: Path) -> Iterator[Path]:
    """A folder for what is unpacked, on the disk of the state; what a kill left of one is removed."""
    draft = state_dir / _DRAFT
    make_folder(state_dir)
    shutil.rmtree(draft, ignore_errors=True)
    make_folder(draft)  # what is made in it has the owner and the mode that it needs in its place
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
    """What is unpacked, and where each of it belongs; nothing of what is there already.

    The cell file is the last: it tells a second try where the state is.
    """
    sessions = sorted(path.name for path in (draft / SESSIONS).glob("*"))
    names = (CALIBRATIONS, TRIALS, DIARY, LATCH, *(f"{SESSIONS}/{name}" for name in sessions))
    places = [(draft / name, state_dir / name) for name in names]
    places.append((draft / CELL, cell_file))
    for new, place in places:
        if new.exists() and not _is_same(new, place):
            yield new, place


def _is_same(new: Path, old: Path) -> bool:
    """The same files, to the last bit."""
    if not (new.exists() and old.exists() and new.is_dir() == old.is_dir()):
        return False
    if not new.is_dir():
        return new.read_bytes() == old.read_bytes()
    return _names(new) == _names(old) and all(
        _is_same(new / name, old / name) for name in _names(new)
    )


def _goes_on(new: Path, old: Path) -> bool:
    """Whether nothing of `old` is lost with `new` in its place: calibrations may have become more."""
    if not old.exists() or old.name == DIARY:  # every daemon writes a diary; it is set aside
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


def _aside(state_dir: Path, clock: Clock) -> Path:
    """A folder for what was there before; a new one each time."""
    number = round(clock.wall())
    while (folder := state_dir / f"before-restore-{number}").exists():
        number += 1
    return folder


def _put_in_place(pieces: Sequence[tuple[Path, Path]], draft: Path, aside: Path) -> None:
    """Put all of it in place or, after an error, nothing."""
    moved: list[tuple[Path, Path]] = []
    try:
        for new, place in pieces:
            with guarded("restore", place):
                _swap(new, place, aside / new.relative_to(draft), moved)
        sync_directory(aside.parent)
    except BaseException as error:
        _move_back(moved, aside)
        if aside.exists():
            words = str(error) or "stopped"
            raise StoreError(f"{words}; what could not be put back is in {aside}") from error
        raise


def _swap(new: Path, place: Path, kept: Path, moved: list[tuple[Path, Path]]) -> None:
    """Put it in place; what is there becomes `kept`. Adds to `moved` what was moved from where.

    At no moment a file is missing: without its cell file there is no second try, and without a latch
    a fault would be forgotten.
    """
    make_folder(place.parent)
    if new.is_file() and new.name == CELL:
        _dress(new, place)
    is_file = new.is_file() and place.is_file()
    if os.path.lexists(place):
        make_folder(kept.parent)
        moved.append((place, kept))
        (copy if is_file else move)(place, kept)
    if not is_file:
        moved.append((new, place))
    move(new, place)


def _dress(new: Path, place: Path) -> None:
    """Root writes the cell file, and the service reads it."""
    before = place.stat() if place.exists() else None
    new.chmod(_READABLE if before is None else stat.S_IMODE(before.st_mode))
    if os.geteuid() == 0:
        owner = before or place.parent.stat()
        os.chown(new, owner.st_uid, owner.st_gid)


def _move_back(moved: Sequence[tuple[Path, Path]], aside: Path) -> None:
    """Undo what was done of it; goes on whatever fails."""
    for source, target in reversed(moved):
        if os.path.lexists(target):
            with contextlib.suppress(OSError):
                if source.is_dir():  # it was copied only, and not removed
                    remove(target)
                else:
                    move(target, source)
    for folder in (aside / SESSIONS, aside):
        with contextlib.suppress(OSError):  # not there, or not empty
            folder.rmdir()
