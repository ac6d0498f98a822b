"""Teaching sessions on the disk: this module reads them, and is the door to their files and writer."""

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from filelock import Timeout

from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import Corrupt, StoreError
from vgrd.model import MovingSight, Observation, Recording, Touch
from vgrd.store import migrations
from vgrd.store.encoding import Json, decode, parse
from vgrd.store.files import guarded, migrated, read_document, read_sealed
from vgrd.store.images import decode_image, stamp_of
from vgrd.store.journal import read_journal
from vgrd.store.recovery import StoredMessage, read_messages, recover
from vgrd.store.session_files import (
    CLOSED,
    HEADER,
    RETAG,
    SAMPLES,
    SCHEMA,
    UNDO,
    SampleKind,
    SessionHeader,
    StoredSession,
    list_sessions,
    session_directory,
    session_lock,
)
from vgrd.store.session_writer import SessionWriter, Taught
from vgrd.store.topics import Topic

__all__ = [
    "SCHEMA",
    "SampleKind",
    "SessionHeader",
    "SessionWriter",
    "StoredSession",
    "Taught",
    "iterate_flanges",
    "iterate_images",
    "iterate_moving",
    "iterate_observations",
    "list_sessions",
    "load_recording",
    "load_session",
    "recover_session",
    "session_directory",
    "session_lock",
]

T = TypeVar("T")


def load_recording(directory: Path) -> Recording:
    """Read what was taught, undone samples left out; as `load_session`."""
    return load_session(directory).recording


def load_session(directory: Path) -> StoredSession:
    """Read a session, finished, cut short or still being recorded; recovers what a kill left open.

    Raises StoreError (no such session), Corrupt naming file and line, SchemaTooNew.
    """
    header = _read_header(directory)
    content = read_journal(directory / SAMPLES)
    _check_complete(directory, len(content.records))
    samples = _samples(content.records, directory / SAMPLES)
    warnings = [content.warning] if content.warning else []
    try:
        recover_session(directory)
    except StoreError as error:
        warnings.append(str(error))
    return StoredSession(
        header,
        _recording(header, samples),
        tuple(warnings),
        Counter(sample.kind for sample in samples if sample.harvested),
        _last_by_foot(samples),
        {kind: tuple(s.number for s in samples if s.kind is kind) for kind in SampleKind},
    )


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


def iterate_moving(directory: Path) -> Iterator[MovingSight]:
    """Yield what was seen while the arm moved, as written; damaged chunks are left out."""
    for path, message in _messages(directory, Topic.MOVING):
        yield decode(MovingSight, parse(message.data, str(path)), str(path))


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


def _read_header(directory: Path) -> SessionHeader:
    path = directory / HEADER
    if not path.exists():
        raise StoreError(f"{directory} is not a session: it has no {HEADER}; check the name")
    body = migrated(migrations.session_header, read_sealed(path, SCHEMA), str(path))
    return decode(SessionHeader, body, str(path))


def _check_complete(directory: Path, lines: int) -> None:
    """Raise Corrupt when a closed session has fewer samples than when it was closed.

    One more there may be: it was refused, and the disk did not let it be taken back.
    """
    path = directory / CLOSED
    if not path.exists():
        return
    closed = read_document(path, SCHEMA)["lines"]
    if lines < closed:
        raise Corrupt(
            f"{directory / SAMPLES} has {lines} lines, the session was closed with {closed}: "
            "samples are lost; restore the file from a backup"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """A line of samples.jsonl as later lines left it; number: of the line, which people call it by."""

    number: int
    kind: SampleKind
    value: Observation | Touch
    harvested: bool
    by_foot: bool

    def renamed(self, target: str, where: str) -> "_Sample":
        """With the name that somebody said."""
        if not isinstance(self.value, Touch):
            raise Corrupt(f"{where}: names the target of sample {self.number}, which is no touch")
        return replace(self, value=replace(self.value, target=target), by_foot=False)


def _samples(records: tuple[Json, ...], path: Path) -> tuple[_Sample, ...]:
    """What was taught, undone samples left out, with the names given last."""
    taught: dict[int, _Sample] = {}
    for number, record in enumerate(records, 1):
        where = f"{path}, line {number}"
        if record["kind"] in (UNDO, RETAG):
            changed = taught.pop(record["value"], None)
            if changed is None:
                raise Corrupt(f"{where}: changes sample {record['value']}, which is not there")
            if record["kind"] == RETAG:
                taught[changed.number] = changed.renamed(record["target"], where)
            continue
        kind = SampleKind(record["kind"])
        value = decode(kind.value_type, migrations.sample(record["value"]), where)
        marks = (bool(record.get("harvested")), bool(record.get("by_foot")))
        taught[number] = _Sample(number, kind, value, *marks)
    return tuple(taught[number] for number in sorted(taught))


def _recording(header: SessionHeader, samples: tuple[_Sample, ...]) -> Recording:
    def of(kind: SampleKind, value_type: type[T]) -> tuple[T, ...]:
        return tuple(
            s.value for s in samples if s.kind is kind and isinstance(s.value, value_type)
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


def _last_by_foot(samples: tuple[_Sample, ...]) -> str | None:
    """Target of the last touch whose name nobody said."""
    by_foot = [s.value.target for s in samples if s.by_foot and isinstance(s.value, Touch)]
    return by_foot[-1] if by_foot else None
