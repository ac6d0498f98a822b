"""Files that are whole or not there: atomic writes, sealed documents, errors with the remedy."""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

from vgrd.errors import Corrupt, SchemaTooNew, StoreError
from vgrd.permissions import opener
from vgrd.store.encoding import Json, canonical, parse

LOCK_MODE = 0o600  # only who writes locks, and only the daemon's user writes
_FULL = "free space on that disk and repeat"
_LOCKED = "make it writable for the daemon's user or set another state_dir"
_REMEDIES = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EFBIG: "raise the limit of the file size (ulimit -f) and repeat",
    errno.EROFS: _LOCKED,
    errno.EACCES: _LOCKED,
    errno.EPERM: _LOCKED,
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "check the path: a part of it is a file",
}


def failure(action: str, path: Path, error: OSError) -> StoreError:
    """StoreError that says what could not be done with `path`, why, and what helps."""
    remedy = _REMEDIES.get(error.errno or 0, "check the disk")
    return StoreError(f"cannot {action} {path}: {error.strerror or error}; {remedy}")


@contextmanager
def guarded(action: str, path: Path) -> Iterator[None]:
    """Turn an OSError of the block into the StoreError of `failure`."""
    try:
        yield
    except OSError as error:
        raise failure(action, path, error) from error


def sync_directory(path: Path) -> None:
    """Make created and renamed entries of a directory survive a power cut."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that becomes `path` at the end of the block, if all went well.

    A reader, a kill or a power cut finds the old content or the new. One writer at a time. Raises
    OSError; the old content then stands.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with open(temporary, "wb", opener=opener) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def digest(body: object, schema: int) -> str:
    """sha256 (hex) that seals `body` and its schema number."""
    return hashlib.sha256(canonical({"body": body, "schema": schema})).hexdigest()


def write_document(path: Path, body: object, schema: int) -> None:
    """Write {schema, sha256, body} as canonical JSON, atomically; raises StoreError."""
    sealed = {"schema": schema, "sha256": digest(body, schema), "body": body}
    with guarded("write", path), replacing(path) as file:
        file.write(canonical(sealed, indent=1) + b"\n")


class Sealed(NamedTuple):
    """Body of a document and the checksum that it was found to have."""

    body: Json
    sha256: str
    schema: int


def read_document(path: Path, schema: int, remedy: str = "restore it from a backup") -> Json:
    """Body of a file written by `write_document`; raises as `read_sealed`."""
    return read_sealed(path, schema, remedy).body


def migrated(migrate: Callable[[int, Json], Json], sealed: Sealed, where: str) -> Json:
    """Body of a document as this version writes it; raises Corrupt naming `where`."""
    try:
        return migrate(sealed.schema, sealed.body)
    except (KeyError, TypeError, AttributeError) as error:
        raise Corrupt(
            f"{where}: is not what schema {sealed.schema} holds ({error!r}); restore it from a backup"
        ) from error


def read_sealed(path: Path, schema: int, remedy: str = "restore it from a backup") -> Sealed:
    """Content of a file written by `write_document`.

    schema: the newest that is understood; an older body is returned as it is, see `migrations`.
    Raises StoreError (unreadable), Corrupt (a bit differs from what was written) naming `remedy`,
    SchemaTooNew.
    """
    with guarded("read", path):
        text = path.read_bytes()
    damaged = Corrupt(f"{path}: the checksum is wrong, the file was changed or damaged; {remedy}")
    try:
        sealed = parse(text, str(path))
    except Corrupt as error:
        raise damaged from error
    if not isinstance(sealed, dict) or sealed.keys() != {"schema", "sha256", "body"}:
        raise damaged
    stored_schema = sealed["schema"]
    if canonical(sealed, indent=1) + b"\n" != text or not isinstance(stored_schema, int):
        raise damaged
    if digest(sealed["body"], stored_schema) != sealed["sha256"]:
        raise damaged
    if stored_schema > schema:
        raise SchemaTooNew(
            f"{path}: schema {stored_schema} was written by a newer vgrd, this one reads up to {schema}; "
            "update vgrd"
        )
    if stored_schema < 1:
        raise Corrupt(f"{path}: schema {stored_schema} is unknown; {remedy}")
    return Sealed(sealed["body"], sealed["sha256"], stored_schema)
