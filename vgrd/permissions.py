"""Who may read what the daemon writes: its user, one group if the cell file names one, nobody else.

The mode and the group of the runtime and the state folder say it. What is made in a folder gets the
group and the mode of that folder, whatever the umask and whoever writes. A folder that is open to
others is not the daemon's: what is made in it is private.
"""

import errno
import grp
import os
import pwd
import stat
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Final

from vgrd.errors import InputError

OTHERS: Final = 0o007  # the mode bits of all other users
_GROUP_ENTERS: Final = 0o050  # members look and read; only the daemon's user changes anything
_GROUP_READS: Final = 0o040  # of a file
_GROUP_CONNECTS: Final = 0o060  # connecting to a Unix socket is writing to it
_FOR_OWNER: Final = 0o700  # of what is new, whatever the umask left of it
_FILE_OF_OWNER: Final = 0o600  # nobody else, until it has taken after its folder
# Not our file, a file system mounted read-only, an id that the user namespace does not know.
_REFUSED: Final = (errno.EPERM, errno.EACCES, errno.EROFS, errno.EINVAL)


def opener(path: str, flags: int) -> int:
    """For `open(..., opener=opener)`: the file takes after its folder. Raises OSError."""
    fd = os.open(path, flags | os.O_CLOEXEC, _FILE_OF_OWNER)
    try:
        take_after(fd, Path(path).parent)
    except OSError:
        os.close(fd)
        raise
    return fd


def way_in(path: Path) -> str:
    """What to do for somebody to whom `path`, or the folder that hides it, is closed."""
    for place in (path, *path.parents):
        try:
            status = place.stat()
        except OSError:
            continue
        break
    if not status.st_mode & _GROUP_ENTERS:
        return f"only user {_name(pwd.getpwuid, status.st_uid)} may: run this as that user, by sudo -u"
    group = _name(grp.getgrgid, status.st_gid)
    return f"members of the group {group} may: adduser NAME {group}, as root, and log in anew"


def _name(entry: Callable[[int], tuple[object, ...]], number: int) -> str:
    """Of a user or a group; its number where it has none here."""
    try:
        return str(entry(number)[0])
    except KeyError:
        return str(number)


def make_folder(path: Path, *, exist_ok: bool = True) -> None:
    """Make a folder, and those above it that are missing; an old one stays as it is. Raises OSError."""
    try:
        path.mkdir(mode=_FOR_OWNER)
    except FileNotFoundError:
        make_folder(path.parent)
        make_folder(path, exist_ok=exist_ok)
    except OSError:
        if not exist_ok or not path.is_dir():
            raise
    else:
        take_after(path, path.parent)


def take_after(entry: int | Path, folder: Path) -> None:
    """Give a new file, folder or socket of ours the owner, the group and the mode that `folder` means."""
    above, status = folder.stat(), os.stat(entry)  # noqa: PTH116 (or a descriptor)
    us = os.geteuid()
    if us not in (0, status.st_uid):
        return
    closed = not above.st_mode & OTHERS
    owner = above.st_uid if us == 0 and closed else status.st_uid
    shared = closed and above.st_mode & _GROUP_ENTERS == _GROUP_ENTERS
    group = above.st_gid if shared else status.st_gid
    shared &= _has_group(entry, status, owner, group)
    _set_mode(entry, status.st_mode | _FOR_OWNER, shared=shared)


def own_folder(path: Path, group: str | int | None, parts: Collection[str]) -> list[Path]:
    """Make `path` if need be, and close it and its `parts` (names in it) to all but user and `group`.

    group: a name or a number, none: the user alone. Returns what stays open since it is not ours to
    change. Raises InputError where `path` itself cannot be closed, or is evidently not a folder of the
    daemon's own; OSError where it cannot be made.
    """
    make_folder(path)
    gid = (_number_of(group) if group else None) if isinstance(group, str) else group
    check_ours(path, gid, parts)
    try:
        _close(path, gid)
    except OSError as err:
        if err.errno not in _REFUSED:
            raise
        _check_close_enough(path, group, gid, err)
    return [entry for part in parts for entry in _close_below(path / part, gid)]


def group_let_in(path: Path) -> int | None:
    """Number of the group that a folder lets in, None where none or others too; raises OSError.

    systemd makes the folders of a unit as that says, before the daemon starts.
    """
    status = path.stat()
    if status.st_mode & OTHERS or status.st_mode & _GROUP_ENTERS != _GROUP_ENTERS:
        return None
    return status.st_gid


def check_ours(path: Path, gid: int | None, parts: Collection[str]) -> None:
    """Nobody's home, /tmp or /var/lib may change its mode because a cell file names it."""
    status = path.stat()
    wanted = _mode(status.st_mode, shared=gid is not None)
    if stat.S_IMODE(status.st_mode) == wanted and gid in (None, status.st_gid):
        return
    strange = any(path.iterdir()) and not any((path / part).exists() for part in parts)
    if strange or status.st_mode & stat.S_ISVTX:
        raise InputError(
            f"folder {path}: holds what is not the daemon's, and its mode would have to change to"
            f" {wanted:04o}; name a folder of the daemon's own in [cell], or chmod this one"
        )


def _check_close_enough(
    path: Path, group: str | int | None, gid: int | None, error: OSError
) -> None:
    """A folder that cannot be changed will do if others are out and the group, if any, is in."""
    status = path.stat()
    if error.errno == errno.EROFS:
        return
    if gid is not None and status.st_gid != gid:
        raise InputError(
            f"folder {path}: cannot be given to the group {group!r} ({error.strerror}); run the"
            f" daemon as a user of that group (systemd: Group={group})"
        ) from error
    if status.st_mode & OTHERS:
        raise InputError(
            f"folder {path}: open to other users and not ours to close ({error.strerror});"
            f" chown it to the daemon's user or chmod o= it"
        ) from error


def _close_below(path: Path, gid: int | None) -> Iterator[Path]:
    """Close an entry and all below it; yields what could not be. Symbolic links are not followed."""
    if path.is_symlink() or not path.exists():
        return
    try:
        _close(path, gid)
    except OSError as err:
        if err.errno not in _REFUSED:
            raise
        if path.stat().st_mode & OTHERS:
            yield path
    if path.is_dir():
        for entry in path.iterdir():
            yield from _close_below(entry, gid)


def _close(path: Path, gid: int | None) -> None:
    status = path.stat()
    if gid is not None and status.st_gid != gid:
        os.chown(path, -1, gid)
    _set_mode(path, status.st_mode, shared=gid is not None)


def _set_mode(entry: int | Path, mode: int, *, shared: bool) -> None:
    wanted = _mode(mode, shared=shared)
    if stat.S_IMODE(os.stat(entry).st_mode) != wanted:  # noqa: PTH116 (idem)
        os.chmod(entry, wanted)  # noqa: PTH101 (idem)


def _mode(mode: int, *, shared: bool) -> int:
    """Keep what the owner may; the group may what it needs or nothing, others nothing."""
    if stat.S_ISDIR(mode):
        for_owner, for_group = _FOR_OWNER, _GROUP_ENTERS
    else:
        for_owner = _FILE_OF_OWNER
        for_group = _GROUP_CONNECTS if stat.S_ISSOCK(mode) else _GROUP_READS
    return mode & for_owner | (for_group if shared else 0)


def _has_group(entry: int | Path, status: os.stat_result, uid: int, gid: int) -> bool:
    """Give an entry to `uid` and `gid`; whether it has that group then.

    Not called where nothing differs: the service's filter refuses every chown, and knows no need.
    """
    if (status.st_uid, status.st_gid) != (uid, gid):
        try:
            os.chown(entry, uid, gid)
        except OSError as err:
            if err.errno not in _REFUSED:
                raise
            return status.st_gid == gid
    return True


def _number_of(group: str) -> int:
    try:
        return grp.getgrnam(group).gr_gid
    except KeyError:
        raise InputError(
            f"[cell] group = {group!r}: no such group here; make it (groupadd --system {group})"
            " or leave the key out"
        ) from None
