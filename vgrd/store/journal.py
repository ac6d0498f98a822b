"""Append-only lines that are on the disk before the call returns, each numbered and with a CRC."""

import os
import zlib
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from vgrd.errors import Corrupt, StoreError
from vgrd.permissions import opener
from vgrd.store.encoding import Json, canonical, parse
from vgrd.store.files import guarded, sync_directory


class JournalContent(NamedTuple):
    """Records in order, the size of their bytes, and what was left out at the end, or ""."""

    records: tuple[Json, ...]
    size: int
    warning: str


class Journal:
    """Appends JSON records to a file; continues an existing one behind its last whole line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        content = read_journal(path)
        self.sequence = len(content.records)
        self._size = content.size
        self._is_torn = True
        with guarded("write", path):
            self._file = open(path, "ab", buffering=0, opener=opener)  # noqa: SIM115
            try:
                self._mend()
                sync_directory(path.parent)
            except OSError:
                self._file.close()
                raise

    def append(self, record: object) -> int:
        """Write a record to the disk and return its number, counted from 1.

        Raises StoreError; the file then ends with the record before, or is made to by the next call.
        """
        if self._file.closed:
            raise StoreError(f"cannot write {self.path}: it is closed; begin a new session")
        sequence = self.sequence + 1
        line = _line(sequence, record)
        with guarded("write", self.path):
            self._mend()
            self._is_torn = True
            try:
                _write_all(self._file.fileno(), line)
                os.fsync(self._file.fileno())
            except OSError:
                with suppress(OSError):  # the next append tries again before it writes
                    self._mend()
                raise
            self._is_torn = False
        self.sequence = sequence
        self._size += len(line)
        return sequence

    def close(self) -> None:
        """Release the file; may be called more than once."""
        if not self._file.closed:
            with suppress(
                OSError
            ):  # a whole line that was not acknowledged may stay: nothing is lost
                self._mend()
        self._file.close()

    def _mend(self) -> None:
        """Cut off what a failed append has left behind the last whole line."""
        if self._is_torn:
            self._file.truncate(self._size)
            self._is_torn = False


def read_journal(path: Path) -> JournalContent:
    """All whole lines of `path`, none where it does not exist.

    A torn last line was never acknowledged: it is left out with a warning. Any other fault is
    Corrupt, naming the line.
    """
    with guarded("read", path):
        text = path.read_bytes() if path.exists() else b""
    *lines, tail = text.split(b"\n")
    records = tuple(_record(path, number, line) for number, line in enumerate(lines, 1))
    warning = (
        f"{path}: line {len(lines) + 1} was cut short ({len(tail)} bytes) and is left out; "
        "it had not been acknowledged"
    )
    return JournalContent(records, len(text) - len(tail), warning if tail else "")


def _write_all(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def _line(sequence: int, record: object) -> bytes:
    crc = zlib.crc32(canonical([sequence, record]))
    return canonical({"seq": sequence, "crc32": crc, "record": record}) + b"\n"


def _record(path: Path, number: int, line: bytes) -> Json:
    where = f"{path}, line {number}"
    record = parse(line, where)
    if not isinstance(record, dict) or "record" not in record:
        raise Corrupt(f"{where}: not a record of this journal; restore the file from a backup")
    if _line(number, record["record"]) != line + b"\n":
        raise Corrupt(f"{where}: the checksum is wrong; restore the file from a backup")
    return record["record"]
