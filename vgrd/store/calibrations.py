"""Calibrations on the disk: immutable numbered files, one of which is in use.

::

    STATE_DIR/calibrations/
      cal-000001.json     sealed by a checksum, never changed
      CURRENT             which one serves, with its checksum
      activations.jsonl   who put which one in use, when, in place of which
"""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from filelock import FileLock, Timeout

from vgrd.calibration.calibration import Calibration
from vgrd.clock import Clock, SystemClock
from vgrd.errors import Corrupt, InputError, NoCurrentCalibration, StoreError
from vgrd.permissions import make_folder
from vgrd.store import migrations
from vgrd.store.encoding import decode, encode
from vgrd.store.files import (
    LOCK_MODE,
    guarded,
    migrated,
    read_document,
    read_sealed,
    write_document,
)
from vgrd.store.journal import Journal, read_journal

SCHEMA = migrations.CALIBRATION_SCHEMA
_LOCK_S = 10.0  # a save of the largest calibration takes 2 s on a busy machine
_ID = re.compile(r"cal-(\d{6})")


@dataclass(frozen=True, slots=True)
class ActivationRecord:
    """One line of activations.jsonl; previous: id, empty at the first."""

    calibration: str
    previous: str
    by: str
    unix_s: float


@dataclass(frozen=True, slots=True)
class _Current:
    id: str
    sha256: str


class StoredCalibration(NamedTuple):
    """A calibration and the checksum that seals its file."""

    calibration: Calibration
    sha256: str

    @property
    def id(self) -> str:
        """Id of the calibration."""
        return self.calibration.id

    @property
    def register_id(self) -> int:
        """Number by which robots know it: 32 bits of its file's checksum, never 0."""
        return int(self.sha256[:8], 16) or 1  # 8 hex digits: the u32 register CALID


class CalibrationStore:
    """Calibrations of one cell; a failure is a StoreError that leaves all files as they were."""

    def __init__(self, state_dir: Path, clock: Clock | None = None) -> None:
        self.path = state_dir / "calibrations"
        self._clock = clock or SystemClock()

    def save(self, calibration: Calibration) -> str:
        """Store under the next number, which becomes its id and is returned; does not activate."""
        with self._locked():
            numbers = [int(name.removeprefix("cal-")) for name in self.list()]
            name = f"cal-{max(numbers, default=0) + 1:06d}"
            body = encode(replace(calibration, id=name), name)
            write_document(self._file(name), body, SCHEMA)
        return name

    def load(self, name: str) -> Calibration:
        """Calibration `name`, exactly as saved.

        Raises InputError (no such calibration), Corrupt, SchemaTooNew.
        """
        return self.read(name).calibration

    def read(self, name: str) -> StoredCalibration:
        """As `load`, with the checksum of the file."""
        path = self._file(name)
        if not _is_there(path):
            known = ", ".join(self.list()) or "none"
            raise InputError(f"no calibration {name!r} in {self.path}; there are: {known}")
        remedy = "restore it from a backup or solve its session again"
        sealed = read_sealed(path, SCHEMA, remedy)
        body = migrated(migrations.calibration, sealed, str(path))
        calibration = decode(Calibration, body, str(path))
        if calibration.id != name:
            raise Corrupt(f"{path} holds {calibration.id}: the file was renamed; name it back")
        return StoredCalibration(calibration, sealed.sha256)

    def list(self) -> tuple[str, ...]:
        """Ids of all stored calibrations, oldest first."""
        return tuple(sorted(p.stem for p in self.path.glob("cal-*.json") if _ID.fullmatch(p.stem)))

    def current_id(self) -> str:
        """Id of the calibration in use, its file not read; as `current`."""
        return self._read_current().id

    def current(self) -> StoredCalibration:
        """Calibration in use, verified to be the very one that was activated.

        Raises NoCurrentCalibration, Corrupt, SchemaTooNew; never falls back to another one.
        """
        current = self._read_current()
        try:
            stored = self.read(current.id)
        except InputError as error:
            raise Corrupt(f"{error}; {self._way_out(current.id)}") from error
        except Corrupt as error:
            raise Corrupt(f"{error}; or {self._way_out(current.id)}") from error
        if stored.sha256 != current.sha256:
            raise Corrupt(
                f"{self._file(current.id)} is not the file that was activated; "
                f"{self._way_out(current.id)}"
            )
        return stored

    def activate(
        self, name: str, by: str = "", check: Callable[[Calibration], None] = lambda _: None
    ) -> StoredCalibration:
        """Put a stored calibration in use and log who did it; returns it, verified.

        What `check` raises for it leaves everything as it was.
        """
        stored = self.read(name)
        check(stored.calibration)
        with self._locked():
            try:
                previous = self.current_id()
            except (NoCurrentCalibration, Corrupt):
                previous = self._last_activated()
            author = by or f"uid {os.getuid()}"
            record = ActivationRecord(name, previous, author, self._clock.wall())
            journal = Journal(self.path / "activations.jsonl")
            try:
                journal.append(encode(record, "activation"))
            finally:
                journal.close()
            current = _Current(name, stored.sha256)
            write_document(self.path / "CURRENT", encode(current, "CURRENT"), SCHEMA)
        return stored

    def activations(self) -> tuple[ActivationRecord, ...]:
        """Every activation ever asked for, in order."""
        path = self.path / "activations.jsonl"
        return tuple(
            decode(ActivationRecord, record, str(path)) for record in read_journal(path).records
        )

    @contextmanager
    def _locked(self) -> Iterator[None]:
        lock = FileLock(self.path / ".lock", timeout=_LOCK_S, mode=LOCK_MODE)
        with guarded("write into", self.path):
            make_folder(self.path)
            try:
                lock.acquire()
            except Timeout:
                raise StoreError(
                    f"{self.path} is locked by another process since {_LOCK_S:g} s; end that one"
                ) from None
        try:
            yield
        finally:
            lock.release()

    def _file(self, name: str) -> Path:
        if not _ID.fullmatch(name):
            known = ", ".join(self.list()) or "none"
            raise InputError(
                f"{name!r} is not a calibration id such as cal-000001; in {self.path} there are: {known}"
            )
        return self.path / f"{name}.json"

    def _read_current(self) -> _Current:
        path = self.path / "CURRENT"
        if not _is_there(path):
            last = self._last_activated()
            hint = f" (the file CURRENT is gone; {last} was activated last)" if last else ""
            raise NoCurrentCalibration(
                f"no calibration is in use in {self.path}{hint}; solve a session and run "
                "`vgrd activate`"
            )
        remedy = "activate a calibration again: `vgrd activate`"
        return decode(_Current, read_document(path, SCHEMA, remedy), str(path))

    def _last_activated(self) -> str:
        log = self.activations()
        return log[-1].calibration if log else ""

    def _way_out(self, name: str) -> str:
        earlier = [a.calibration for a in self.activations() if a.calibration != name]
        other = earlier[-1] if earlier else "another one"
        return f"activate {other} (`vgrd activate`) if it is still right for the cell"


def _is_there(path: Path) -> bool:
    with guarded("look for", path):
        return path.exists()
