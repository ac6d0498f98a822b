"""Recording of one session."""

import shutil
import threading
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import InputError, StoreError
from vgrd.model import CellFacts, MovingSight, Observation, Plan, Touch
from vgrd.permissions import make_folder
from vgrd.store.encoding import canonical, encode
from vgrd.store.files import guarded, write_document
from vgrd.store.images import EncodedImage, encode_image
from vgrd.store.journal import Journal
from vgrd.store.segments import SegmentWriter
from vgrd.store.session_files import (
    CLOSED,
    HEADER,
    RETAG,
    SAMPLES,
    SCHEMA,
    UNDO,
    SampleKind,
    SessionHeader,
    session_directory,
    session_lock,
)
from vgrd.store.topics import Topic, pose_in_frame

_NS = 1_000_000_000  # in a second


class Taught(NamedTuple):
    """A sample of the session being recorded; harvested: nobody asked for it."""

    sequence: int
    kind: SampleKind
    value: Observation | Touch
    harvested: bool


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
            write_document(self.path / HEADER, body, SCHEMA)
            self._samples = Journal(self.path / SAMPLES)
        except StoreError:
            self._lock.release()
            shutil.rmtree(self.path, ignore_errors=True)
            raise
        self._taught: list[Taught] = []
        self._segments = SegmentWriter(self.path, clock)
        self._teaching, self._recording = threading.Lock(), threading.Lock()

    @property
    def counts(self) -> Mapping[SampleKind, int]:
        """Samples so far, harvested ones too, undone ones left out."""
        return Counter(sample.kind for sample in self._taught)

    @property
    def harvested(self) -> Mapping[SampleKind, int]:
        """Those that nobody asked for."""
        return Counter(sample.kind for sample in self._taught if sample.harvested)

    @property
    def touched(self) -> Counter[str]:
        """Touches so far by target."""
        touches = [sample.value for sample in self._taught if sample.kind is SampleKind.TOUCH]
        return Counter(touch.target for touch in touches if isinstance(touch, Touch))

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

    def moving(self, sight: MovingSight) -> None:
        """Record what was seen in a picture that no sample can be of."""
        self._write(Topic.MOVING, sight.stamp_s, canonical(encode(sight, "moving")))

    def image(self, image: CameraImage | EncodedImage) -> bool:
        """Record a picture without loss; False when it was left out since the disk is behind.

        A CameraImage is compressed in the calling thread: call `encode_image` elsewhere before.
        """
        encoded = encode_image(image) if isinstance(image, CameraImage) else image
        return self._write(Topic.IMAGE, encoded.stamp_s, encoded.data)

    def sample(
        self,
        kind: SampleKind,
        value: Observation | Touch,
        *,
        harvested: bool = False,
        by_foot: bool = False,
    ) -> int:
        """Write a sample to the disk and return its sequence number.

        harvested: nobody asked for it; by_foot: nobody named its target.
        """
        if not isinstance(value, kind.value_type):
            raise InputError(
                f"a {kind} is a {kind.value_type.__name__}, not a {type(value).__name__}"
            )
        record = {"kind": kind.value, "value": encode(value, kind.value)}
        if harvested:  # readers that know no mark take it for a sample that was asked for
            record["harvested"] = True
        if by_foot:
            record["by_foot"] = True
        with self._teaching:
            sequence = self._samples.append(record)
            self._taught.append(Taught(sequence, kind, value, harvested))
        # The sample is safe; what ails the segment is raised by the next pose or picture.
        with self._recording, suppress(StoreError):
            self._segments.sync()
        return sequence

    def undo(self, kind: SampleKind | None = None, *, harvested: bool | None = None) -> Taught:
        """Take back the last sample of a kind, asked for or harvested; None: either.

        InputError when there is none.
        """
        with self._teaching:
            for sample in reversed(self._taught):
                if kind in (None, sample.kind) and harvested in (None, sample.harvested):
                    self._take_back(sample)
                    return sample
            what = "sample" if kind is None else kind.value
            how = "has been harvested" if harvested else "has been taught"
            raise InputError(f"nothing to undo: no {what} {how} in this session")

    def undo_sample(self, number: int) -> Taught:
        """Take back the sample of a number, whoever asked for it. InputError names those that there are."""
        with self._teaching:
            sample = self._numbered(number)
            self._take_back(sample)
            return sample

    def retag(self, number: int, target: str) -> Taught:
        """Give a touch another target's name, said by somebody; its number and its place stay.

        InputError where the sample is no touch of the object, or there is none of that number.
        """
        with self._teaching:
            sample = self._numbered(number)
            if sample.kind not in (SampleKind.TOUCH, SampleKind.VERIFY):
                raise InputError(
                    f"sample {number} is a {sample.kind.value}: only a touch or verify has a target"
                )
            if not isinstance(sample.value, Touch) or sample.value.target == target:
                raise InputError(f"sample {number} is of {target} already")
            self._samples.append({"kind": RETAG, "value": number, "target": target})
            renamed = sample._replace(value=replace(sample.value, target=target))
            self._taught[self._taught.index(sample)] = renamed
            return renamed

    @property
    def version(self) -> int:
        """Another number with every sample, and with everything done to one."""
        return self._samples.sequence

    @property
    def taught(self) -> tuple[Taught, ...]:
        """Samples so far in the order of their numbers, undone ones left out."""
        return tuple(self._taught)

    def _numbered(self, number: int) -> Taught:
        for sample in self._taught:
            if sample.sequence == number:
                return sample
        there = numbers_in_words([sample.sequence for sample in self._taught])
        what = f"has {there}" if there else "has none yet"
        raise InputError(f"there is no sample {number}: this session {what}")

    def give_back(self, values: Collection[Observation]) -> None:
        """Take back harvested samples that others make superfluous; those undone before are left."""
        with self._teaching:
            for sample in [s for s in self._taught if any(s.value is value for value in values)]:
                self._take_back(sample)

    def _take_back(self, sample: Taught) -> None:
        self._samples.append({"kind": UNDO, "value": sample.sequence})
        self._taught.remove(sample)

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
                write_document(self.path / CLOSED, {"lines": self._samples.sequence}, SCHEMA)
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


def numbers_in_words(numbers: Sequence[int]) -> str:
    """Ascending numbers as "1 to 3, 7"; "" for none."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
