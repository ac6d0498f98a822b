"""Recording of one session."""

import shutil
import threading
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
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
    SAMPLES,
    SCHEMA,
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

    def give_back(self, values: Collection[Observation]) -> None:
        """Take back harvested samples that others make superfluous; those undone before are left."""
        with self._teaching:
            for sample in [s for s in self._taught if any(s.value is value for value in values)]:
                self._take_back(sample)

    def _take_back(self, sample: Taught) -> None:
        self._samples.append({"kind": "undo", "value": sample.sequence})
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
