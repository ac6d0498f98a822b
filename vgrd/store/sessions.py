"""Teaching sessions on the disk.

::

    STATE_DIR/sessions/NAME/
      session.json      plan and cell facts, sealed by a checksum
      samples.jsonl     one line per taught sample, on the disk before it is acknowledged
      closed.json       how many lines that are, written when the session is closed
      000.mcap ...      flange poses, observations, pictures; `.mcap.open` while growing, the
                        original of a recovered one is `.mcap.damaged`
"""

import re
import shutil
import threading
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Self, TypeVar

from filelock import FileLock, Timeout

from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import Corrupt, InputError, StoreError
from vgrd.model import CellFacts, Observation, Plan, Recording, Touch
from vgrd.permissions import make_folder
from vgrd.store import migrations
from vgrd.store.encoding import Json, canonical, decode, encode, parse
from vgrd.store.files import (
    LOCK_MODE,
    guarded,
    migrated,
    read_document,
    read_sealed,
    write_document,
)
from vgrd.store.images import EncodedImage, decode_image, encode_image, stamp_of
from vgrd.store.journal import Journal, read_journal
from vgrd.store.recovery import StoredMessage, read_messages, recover
from vgrd.store.segments import SegmentWriter
from vgrd.store.topics import Topic, pose_in_frame

SCHEMA = migrations.SESSION_SCHEMA
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")
_HEADER, _SAMPLES, _LOCK = "session.json", "samples.jsonl", ".lock"
_CLOSED = "closed.json"
_NS = 1_000_000_000

T = TypeVar("T")


class SampleKind(StrEnum):
    """What was taught: looks and spins are Observations, the others Touches."""

    LOOK = "look"
    SPIN = "spin"
    TOUCH = "touch"
    POINT = "point"
    VERIFY = "verify"

    @property
    def value_type(self) -> type[Observation] | type[Touch]:
        """Class of the samples of this kind."""
        return Observation if self in (SampleKind.LOOK, SampleKind.SPIN) else Touch


@dataclass(frozen=True, slots=True, eq=False)
class SessionHeader:
    """Content of session.json; unix_minus_monotonic_s turns cell clock stamps into Unix time."""

    name: str
    plan: Plan
    facts: CellFacts
    created_unix_s: float
    unix_minus_monotonic_s: float


@dataclass(frozen=True, slots=True, eq=False)
class StoredSession:
    """A session as found on the disk; warnings tell what was left out or not tidied up."""

    header: SessionHeader
    recording: Recording
    warnings: tuple[str, ...]


def session_directory(state_dir: Path, name: str) -> Path:
    """Where the session lives; raises InputError for a name that is not a plain file name."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"session name {name!r}: use 1 to 80 letters, digits, '.', '_' or '-', "
            "a letter or digit first"
        )
    return state_dir / "sessions" / name


class SessionWriter:
    """Records one session; may be used by several threads.

    Raises StoreError naming path and remedy when the session exists already or the disk refuses.
    Once the recording of poses and pictures has failed, those calls raise it again, while samples
    are taken as long as the disk takes them.
    """

    def __init__(
        self, state_dir: Path, name: str, plan: Plan, facts: CellFacts, clock: Clock
    ) -> None:
        self.path = session_directory(state_dir, name)
        created_s = clock.wall()
        offset_s = created_s - clock.monotonic()
        self.header = SessionHeader(name, plan, facts, created_s, offset_s)
        body = encode(self.header, "session")
        with guarded("create", self.path):
            try:
                make_folder(self.path, exist_ok=False)
            except FileExistsError:
                raise StoreError(
                    f"session {name!r} exists already in {self.path.parent}; choose another name"
                ) from None
        self._lock = session_lock(self.path)
        try:
            with guarded("lock", self.path):
                self._lock.acquire(timeout=0)
            write_document(self.path / _HEADER, body, SCHEMA)
            self._samples = Journal(self.path / _SAMPLES)
        except StoreError:
            self._lock.release()
            shutil.rmtree(self.path, ignore_errors=True)
            raise
        self._taught: list[tuple[int, SampleKind]] = []
        self._segments = SegmentWriter(self.path, clock)
        self._teaching, self._recording = threading.Lock(), threading.Lock()

    @property
    def counts(self) -> Mapping[SampleKind, int]:
        """Samples taught so far, undone ones left out."""
        return Counter(kind for _, kind in self._taught)

    @property
    def dropped(self) -> tuple[int, int]:
        """(pictures, other messages) left out since the disk could not follow."""
        return self._segments.dropped_images, self._segments.dropped_messages

    def flange(self, reading: FlangeReading) -> None:
        """Record a pose of the robot; at most the last 100 ms are lost in a kill."""
        data = pose_in_frame(reading, self._time_ns(reading.stamp_s))
        self._write(Topic.FLANGE, reading.stamp_s, data)

    def observation(self, observation: Observation) -> None:
        """Record what was seen in one picture."""
        data = canonical(encode(observation, "observation"))
        self._write(Topic.OBSERVATION, observation.stamp_s, data)

    def image(self, image: CameraImage | EncodedImage) -> bool:
        """Record a picture without loss; False when it was left out since the disk is behind.

        A CameraImage is compressed in the calling thread: call `encode_image` elsewhere before.
        """
        encoded = encode_image(image) if isinstance(image, CameraImage) else image
        return self._write(Topic.IMAGE, encoded.stamp_s, encoded.data)

    def sample(self, kind: SampleKind, value: Observation | Touch) -> int:
        """Write a taught sample to the disk and return its sequence number."""
        if not isinstance(value, kind.value_type):
            raise InputError(
                f"a {kind} is a {kind.value_type.__name__}, not a {type(value).__name__}"
            )
        record = {"kind": kind.value, "value": encode(value, kind.value)}
        with self._teaching:
            sequence = self._samples.append(record)
            self._taught.append((sequence, kind))
        # The sample is safe; what ails the segment is raised by the next pose or picture.
        with self._recording, suppress(StoreError):
            self._segments.sync()
        return sequence

    def undo(self) -> tuple[int, SampleKind]:
        """Take back the last sample; its number and kind. InputError when there is none."""
        with self._teaching:
            if not self._taught:
                raise InputError("nothing to undo: no sample has been taught in this session")
            self._samples.append({"kind": "undo", "value": self._taught[-1][0]})
            return self._taught.pop()

    def tick(self) -> None:
        """Keep the promise of `flange` while nothing is recorded; call every 50 ms or so."""
        with self._recording:
            self._segments.tick()

    def close(self) -> None:
        """Finish the files; may be called more than once."""
        try:
            with self._recording:
                self._segments.close()
            with self._teaching:
                write_document(self.path / _CLOSED, {"lines": self._samples.sequence}, SCHEMA)
        finally:
            self._samples.close()
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, topic: Topic, stamp_s: float, data: bytes) -> bool:
        with self._recording:
            return self._segments.write(topic, self._time_ns(stamp_s), data)

    def _time_ns(self, stamp_s: float) -> int:
        return round((stamp_s + self.header.unix_minus_monotonic_s) * _NS)


def list_sessions(state_dir: Path) -> tuple[str, ...]:
    """Names of all sessions, oldest first."""
    folder = state_dir / "sessions"
    with guarded("list", folder):
        headers = folder.glob(f"*/{_HEADER}")
        named = (path for path in headers if _NAME.fullmatch(path.parent.name))
        dated = sorted((path.stat().st_mtime_ns, path.parent.name) for path in named)
    return tuple(name for _, name in dated)


def load_recording(directory: Path) -> Recording:
    """Read what was taught, undone samples left out; as `load_session`."""
    return load_session(directory).recording


def load_session(directory: Path) -> StoredSession:
    """Read a session, finished, cut short or still being recorded; recovers what a kill left open.

    Raises StoreError (no such session), Corrupt naming file and line, SchemaTooNew.
    """
    header = _read_header(directory)
    content = read_journal(directory / _SAMPLES)
    _check_complete(directory, len(content.records))
    recording = _recording(header, content.records, directory / _SAMPLES)
    warnings = [content.warning] if content.warning else []
    try:
        recover_session(directory)
    except StoreError as error:
        warnings.append(str(error))
    return StoredSession(header, recording, tuple(warnings))


def recover_session(directory: Path) -> tuple[Path, ...]:
    """Recover segments that a kill left open, unless a living process records here."""
    if not any(directory.glob("*.mcap.open")):
        return ()
    lock = session_lock(directory)
    with guarded("lock", directory):
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return ()
    try:
        return recover(directory)
    finally:
        lock.release()


def iterate_flanges(directory: Path) -> Iterator[FlangeReading]:
    """Yield the recorded flange readings as written; damaged chunks are left out.

    Of an arm at rest they are few, and as many as the robot gave around pictures and samples
    (`vgrd.devices.thinning`): judge rest from those within `AROUND_S` of a picture.
    """
    for path, message in _messages(directory, Topic.FLANGE):
        yield decode(
            FlangeReading, migrations.reading(parse(message.data, str(path))["reading"]), str(path)
        )


def iterate_observations(directory: Path) -> Iterator[Observation]:
    """Yield the recorded observations as written; damaged chunks are left out."""
    for path, message in _messages(directory, Topic.OBSERVATION):
        yield decode(
            Observation, migrations.observation(parse(message.data, str(path))), str(path)
        )


def iterate_images(
    directory: Path, stamps: Collection[float] | None = None
) -> Iterator[CameraImage]:
    """Yield the recorded pictures as written, all or those of some stamps; damaged ones are left out."""
    for _, message in _messages(directory, Topic.IMAGE):
        if stamps is None or stamp_of(message.data) in stamps:
            yield decode_image(message.data)


def _messages(directory: Path, topic: Topic) -> Iterator[tuple[Path, StoredMessage]]:
    segments = {path.name.removesuffix(".open"): path for path in directory.glob("*.mcap.open")}
    segments |= {path.name: path for path in directory.glob("*.mcap")}
    for _, path in sorted(segments.items()):
        for message in read_messages(path, frozenset({topic})):
            yield path, message


def session_lock(directory: Path) -> FileLock:
    """Held by the process that records into a session, recovers or removes it."""
    return FileLock(directory / _LOCK, mode=LOCK_MODE, thread_local=False)


def _read_header(directory: Path) -> SessionHeader:
    path = directory / _HEADER
    if not path.exists():
        raise StoreError(f"{directory} is not a session: it has no {_HEADER}; check the name")
    body = migrated(migrations.session_header, read_sealed(path, SCHEMA), str(path))
    return decode(SessionHeader, body, str(path))


def _check_complete(directory: Path, lines: int) -> None:
    """Raise Corrupt when a closed session has fewer samples than when it was closed.

    One more there may be: it was refused, and the disk did not let it be taken back.
    """
    path = directory / _CLOSED
    if not path.exists():
        return
    closed = read_document(path, SCHEMA)["lines"]
    if lines < closed:
        raise Corrupt(
            f"{directory / _SAMPLES} has {lines} lines, the session was closed with {closed}: "
            "samples are lost; restore the file from a backup"
        )


def _recording(header: SessionHeader, records: tuple[Json, ...], path: Path) -> Recording:
    taught: dict[int, tuple[SampleKind, Observation | Touch]] = {}
    for number, record in enumerate(records, 1):
        where = f"{path}, line {number}"
        if record["kind"] == "undo":
            if taught.pop(record["value"], None) is None:
                raise Corrupt(f"{where}: undoes sample {record['value']}, which is not there")
            continue
        kind = SampleKind(record["kind"])
        taught[number] = kind, decode(kind.value_type, migrations.sample(record["value"]), where)

    def of(kind: SampleKind, value_type: type[T]) -> tuple[T, ...]:
        return tuple(
            value for k, value in taught.values() if k is kind and isinstance(value, value_type)
        )

    return Recording(
        session=header.name,
        plan=header.plan,
        facts=header.facts,
        looks=of(SampleKind.LOOK, Observation),
        spins=of(SampleKind.SPIN, Observation),
        touches=of(SampleKind.TOUCH, Touch),
        points=of(SampleKind.POINT, Touch),
        verifications=of(SampleKind.VERIFY, Touch),
    )
