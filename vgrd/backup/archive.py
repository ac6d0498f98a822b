"""A backup: one tar of plain files, at its end a sealed list of them with checksums.

::

    calibrations/cal-000001.json, CURRENT, activations.jsonl
    sessions/NAME/...       where they were asked for
    trials/cal-000001.json  verifications of a calibration in use, if there are any
    diary.json              what became of the cell over weeks
    latch.json              a fault that a person must confirm, if there is one
    cell.toml
    manifest.json           the list; an archive that was cut short has none
"""

import contextlib
import fcntl
import hashlib
import io
import os
import re
import shutil
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from vgrd.clock import Clock
from vgrd.errors import Corrupt, InputError, StoreError
from vgrd.permissions import make_folder, opener
from vgrd.store.files import guarded, read_document, replacing, write_document
from vgrd.store.retention import in_use
from vgrd.store.sessions import list_sessions, session_directory

SCHEMA: Final = 1
MANIFEST: Final = "manifest.json"
CELL: Final = "cell.toml"
LATCH: Final = "latch.json"  # as vgrd.cell.serving.latches: on a spare computer it is no less true
DIARY: Final = "diary.json"  # as vgrd.cell.serving.diary
SESSIONS: Final = "sessions"
TRIALS: Final = "trials"  # as vgrd.cell.serving.trials
CALIBRATIONS: Final = "calibrations"
JOURNAL: Final = "activations.jsonl"
_CHANGING: Final = (JOURNAL, "CURRENT")  # of the calibrations; the others never change
_TRIES: Final = 5  # an activation takes milliseconds, people do not activate five in a row
_NAME: Final = re.compile(
    r"manifest\.json|latch\.json|diary\.json|cell\.toml"
    r"|calibrations/(cal-\d{6}\.json|CURRENT|activations\.jsonl)|trials/cal-\d{6}\.json"
    r"|sessions/[A-Za-z0-9][A-Za-z0-9._-]{0,79}/[A-Za-z0-9][A-Za-z0-9._-]{0,79}"
)


@dataclass(slots=True)
class Content:
    """What an archive holds. files: sha256 by name. left_out: sessions that are being recorded."""

    cell: str
    created_unix_s: float
    files: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def write_archive(
    path: Path, state_dir: Path, cell_file: Path, cell: str, clock: Clock, *, sessions: bool
) -> Content:
    """Write a backup, whole or not at all. Raises InputError where `path` is there, StoreError."""
    if path.exists():
        raise InputError(
            f"{path}: is there already; a backup overwrites nothing: name another file"
        )
    content = Content(cell, clock.wall())
    with guarded("write", path):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with replacing(path) as file, tarfile.open(fileobj=file, mode="w") as archive:
            _add_calibrations(archive, state_dir / CALIBRATIONS, content)
            _add_file(archive, CELL, cell_file, content)
            trials = (
                f"{TRIALS}/{file.name}" for file in sorted((state_dir / TRIALS).glob("cal-*"))
            )
            for name in (LATCH, DIARY, *trials):
                with contextlib.suppress(FileNotFoundError):
                    _add_file(archive, name, state_dir / name, content)
            for name in list_sessions(state_dir) if sessions else ():
                _add_session(archive, session_directory(state_dir, name), content)
            _add_manifest(archive, path.parent, content)
    return content


def unpack(path: Path, folder: Path) -> Content:
    """Unpack a backup into an empty folder, checked to the last bit.

    Raises InputError for what is no backup of ours, Corrupt for a damaged one.
    """
    try:
        with guarded("read", path), tarfile.open(path, "r:") as archive:
            for member in _members(path, archive):
                _take_out(archive, member, folder)
    except (tarfile.TarError, EOFError) as error:
        raise Corrupt(f"{path}: is no backup, or a damaged one ({error}); take another") from error
    if not (folder / MANIFEST).exists():
        raise Corrupt(f"{path}: was cut short, it has no {MANIFEST}; take another")
    remedy = "take another backup"
    body = read_document(folder / MANIFEST, SCHEMA, remedy)
    content = _content(body, path)
    found = {name: _digest(folder / name) for name in _files(folder) if name != MANIFEST}
    for name in found.keys() | content.files.keys():
        if found.get(name) != content.files.get(name):
            raise Corrupt(f"{path}: {name} is not as it was backed up; {remedy}")
    return content


def _take_out(archive: tarfile.TarFile, member: tarfile.TarInfo, folder: Path) -> None:
    """Write what a member holds, and nothing else that it says: not its owner, mode, kind or links.

    Debian 12's Python knows no `filter=` of tarfile yet.
    """
    place = folder / member.name
    make_folder(place.parent)
    content = archive.extractfile(member)
    if content is None:
        raise tarfile.ReadError(f"{member.name} holds nothing")
    with content, open(place, "xb", opener=opener) as file:
        shutil.copyfileobj(content, file)


def _members(path: Path, archive: tarfile.TarFile) -> Iterator[tarfile.TarInfo]:
    """Plain files with names of ours, each once; nothing else is looked at."""
    seen: set[str] = set()
    for member in archive:
        plain = (
            member.isreg() and not member.issparse()
        )  # a sparse one holds more than the archive has bytes
        if not plain or not _NAME.fullmatch(member.name) or member.name in seen:
            raise InputError(
                f"{path}: {member.name!r} does not belong into a backup of vgrd; nothing was taken from it"
            )
        seen.add(member.name)
        yield member


def _content(body: object, path: Path) -> Content:
    match body:
        case {"cell": str(cell), "created_unix_s": float(created), "files": dict(files)}:
            return Content(cell, created, {str(name): str(sha) for name, sha in files.items()})
    raise Corrupt(f"{path}: {MANIFEST} is not a list of ours; take another backup")


def _add_calibrations(archive: tarfile.TarFile, folder: Path, content: Content) -> None:
    """The journal and what is in use of the same moment; then the files that they name."""
    for _ in range(_TRIES):
        moment = _changing(folder)
        if moment == _changing(folder):
            break
    else:
        raise StoreError(
            f"{folder} changes all the time; end what activates calibrations and repeat"
        )
    for name, data in moment.items():
        _add(archive, f"{CALIBRATIONS}/{name}", io.BytesIO(data), len(data), content)
    for file in sorted(folder.glob("cal-*.json")):
        _add_file(archive, f"{CALIBRATIONS}/{file.name}", file, content)


def _changing(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in _CHANGING if (folder / name).exists()}


def _add_session(archive: tarfile.TarFile, folder: Path, content: Content) -> None:
    """A session with all its files, unless it is being recorded."""
    with in_use(folder):
        if _is_recorded(folder):
            content.left_out.append(folder.name)
            return
        for file in sorted(folder.iterdir()):
            name = f"{SESSIONS}/{folder.name}/{file.name}"
            if _NAME.fullmatch(name):
                _add_file(archive, name, file, content)


def _is_recorded(folder: Path) -> bool:
    """Whether somebody holds the lock of the session."""
    with contextlib.ExitStack() as stack:
        try:
            lock = stack.enter_context((folder / ".lock").open("rb"))
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except FileNotFoundError:
            return False
        except BlockingIOError:
            return True
    return False


def _add_file(archive: tarfile.TarFile, name: str, path: Path, content: Content) -> None:
    with path.open("rb") as file:
        _add(archive, name, file, os.fstat(file.fileno()).st_size, content)


def _add(
    archive: tarfile.TarFile, name: str, file: IO[bytes], size: int, content: Content
) -> None:
    member = tarfile.TarInfo(name)
    member.size, member.mode, member.mtime = size, 0o600, round(content.created_unix_s)
    counting = _Digesting(file)
    archive.addfile(member, counting)
    content.files[name] = counting.sha.hexdigest()


class _Digesting(io.RawIOBase):
    """A file whose bytes are counted into a checksum as they are read."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.sha = hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self.sha.update(data)
        return data


def _add_manifest(archive: tarfile.TarFile, folder: Path, content: Content) -> None:
    draft = folder / f".{MANIFEST}.{os.getpid()}"
    body = {
        "cell": content.cell,
        "created_unix_s": content.created_unix_s,
        "files": dict(content.files),
    }
    try:
        write_document(draft, body, SCHEMA)
        _add_file(archive, MANIFEST, draft, content)
    finally:
        draft.unlink(missing_ok=True)


def _files(folder: Path) -> Iterator[str]:
    for path in folder.rglob("*"):
        if path.is_file():
            yield str(path.relative_to(folder))


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
