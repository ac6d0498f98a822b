"""How many samples a session has, and how many it lacks: what tells the same as an earlier one does not count."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from vgrd.calibration.first_samples import wanted
from vgrd.cell.recording.recorder import SAME_PLACE_MM, SAME_PLACE_RAD
from vgrd.geometry.coincidence import Difference, equal_poses
from vgrd.model import Observation, Recording, TagObservation, Touch
from vgrd.store.sessions import SampleKind, SessionWriter, Taught

_TURNED = Difference(
    squared=40.0, mm=0.1, rad=2e-3
)  # 1 in 2 million by noise; less is no other turn
HARVESTED = "harvested"  # instead of a kind of sample


def counts(writer: SessionWriter) -> dict[str, object]:
    """What is there, what of it nobody asked for, and what the plan lacks, by kind."""
    repeated = repeats(writer.taught)
    have = Counter(s.kind.value for s in writer.taught if s.sequence not in repeated)
    lacks = wanted(writer.header.plan, writer.header.facts)
    missing = {kind: n - have[kind] for kind, n in lacks.items() if have[kind] < n}
    harvested = {kind.value: count for kind, count in writer.harvested.items()}
    return {"have": dict(have), HARVESTED: harvested, "missing": missing}


def recording_of(writer: SessionWriter) -> Recording:
    """What was taught so far, what tells the same as an earlier sample left out."""
    header, repeated = writer.header, repeats(writer.taught)
    values = [(s.kind, s.value) for s in writer.taught if s.sequence not in repeated]

    def seen(kind: SampleKind) -> tuple[Observation, ...]:
        return tuple(v for k, v in values if k is kind and isinstance(v, Observation))

    def touched(kind: SampleKind) -> tuple[Touch, ...]:
        return tuple(v for k, v in values if k is kind and isinstance(v, Touch))

    return Recording(
        header.name,
        header.plan,
        header.facts,
        seen(SampleKind.LOOK),
        seen(SampleKind.SPIN),
        touched(SampleKind.TOUCH),
        touched(SampleKind.POINT),
    )


def repeats(taught: Sequence[Taught]) -> dict[int, int]:
    """By number of each sample that tells the same as an earlier one, the number of the first such."""
    found: dict[int, int] = {}
    for kind in SampleKind:
        samples = [sample for sample in taught if sample.kind is kind]
        for k, first in enumerate(_first_of_same(kind, samples)):
            if first != k:
                found[samples[k].sequence] = samples[first].sequence
    return found


def repeat_in_words(taught: Sequence[Taught], number: int) -> str:
    """That a sample is not counted, and why; "" where it is."""
    first = repeats(taught).get(number)
    if first is None:
        return ""
    (sample,) = (s for s in taught if s.sequence == number)
    what = (
        "the object did not turn" if sample.kind is SampleKind.SPIN else "the flange did not move"
    )
    return f"{what} since sample {first}: not counted"


def _first_of_same(kind: SampleKind, samples: Sequence[Taught]) -> list[int]:
    """For every sample of a kind the index of the first one that tells the same."""
    if not samples:
        return []
    alike = equal_poses(
        [sample.value.base_from_wrist for sample in samples], SAME_PLACE_MM, SAME_PLACE_RAD
    )
    if kind is SampleKind.SPIN:
        alike = np.array([[_is_same_turn(a, b) for b in samples] for a in samples])
    elif kind in (SampleKind.TOUCH, SampleKind.VERIFY):
        alike &= np.array([[_is_same_touch(a, b) for b in samples] for a in samples])
    return [int(i) for i in np.argmax(alike, axis=1)]


def _is_same_turn(one: Taught, other: Taught) -> bool:
    """Whether both tags stand alike in the pictures of two spins."""
    a, b = one.value, other.value
    if not isinstance(a, Observation) or not isinstance(b, Observation):
        return False
    return _is_same_place(a.tag_a, b.tag_a) and _is_same_place(a.tag_b, b.tag_b)


def _is_same_place(one: TagObservation | None, other: TagObservation | None) -> bool:
    """Whether noise explains how two pictures differ in a tag; what is unseen in one differs in nothing."""
    if one is None or other is None:
        return True
    covariance = one.covariance + other.covariance
    return not _TURNED.is_between(one.camera_from_tag, other.camera_from_tag, covariance)


def _is_same_touch(one: Taught, other: Taught) -> bool:
    """Whether two touches are of one target and of one rest of the arm, as far as that is known."""
    a, b = one.value, other.value
    if not isinstance(a, Touch) or not isinstance(b, Touch) or a.target != b.target:
        return False
    since = [None if t.observation is None else t.observation.rest_since_s for t in (a, b)]
    return since[0] == since[1]
