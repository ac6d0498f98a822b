"""Moves and copies of files and folders: whole at the new place and on the disk, or not there."""

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from vgrd.store.files import sync_directory


def move(source: Path, target: Path) -> None:
    """Move it, also to another disk; a file takes the place of another one.

    Raises OSError; a folder is then at its old place or at both, whole.
    """
    try:
        source.replace(target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        copy(source, target)
        remove(source)
    for folder in (target.parent, source.parent):
        sync_directory(folder)


def copy(source: Path, target: Path) -> None:
    """Copy it with modes and owners; a file takes the place of another one. Raises OSError."""
    draft = target.with_name(f".{target.name}.tmp")
    remove(draft)  # what a kill left
    try:
        _copy_all(source, draft)
        sync(draft)
        draft.replace(target)
    except BaseException:  # Ctrl-C, too
        remove(draft)
        raise
    sync_directory(target.parent)


def remove(path: Path) -> None:
    """Remove it, if it is there; of a folder no half is ever found under its name. Raises OSError."""
    if not path.is_dir() or path.is_symlink():
        path.unlink(missing_ok=True)
        return
    gone = path.with_name(f".{path.name}.gone")
    shutil.rmtree(gone, ignore_errors=True)
    path.replace(gone)
    shutil.rmtree(gone, ignore_errors=True)


def sync(path: Path) -> None:
    """Bring a file, or a folder with all that is in it, to the disk. Raises OSError."""
    for entry in _all(path):
        if entry.is_file() or entry.is_dir():
            descriptor = os.open(entry, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def _copy_all(source: Path, target: Path) -> None:
    for entry in _all(source):
        new = target / entry.relative_to(source)
        if entry.is_dir() and not entry.is_symlink():
            new.mkdir()
            shutil.copystat(entry, new)
        else:
            shutil.copy2(entry, new, follow_symlinks=False)
        if os.geteuid() == 0:
            owner = entry.lstat()
            os.chown(new, owner.st_uid, owner.st_gid, follow_symlinks=False)


def _all(path: Path) -> Iterator[Path]:
    yield path
    yield from path.rglob("*")
