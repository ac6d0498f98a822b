"""Poses that were recorded twice or not read again, and an object that moved between touches."""

from collections.abc import Iterator, Sequence

from vgrd.calibration.hand_eye import first_of_same, sightings_of_tag_a
from vgrd.calibration.touches import moved_touches, turned_touches
from vgrd.geometry.coincidence import Difference
from vgrd.judging.findings import finding
from vgrd.model import Finding, Recording, Stability

_MOVED = Difference(squared=60.0, mm=0.5, rad=5e-3)  # 1 in 2e10 by noise; far below a jog


def repeated_poses(recording: Recording) -> Iterator[Finding]:
    """Samples that hold one robot pose: recorded twice, or the robot moved and was not read again."""
    samples = sightings_of_tag_a(recording)
    first = first_of_same([sample.base_from_wrist for sample in samples])
    stale: list[tuple[str, str]] = []
    twice: list[tuple[str, str]] = []
    for i, k in enumerate(first):
        if i == k:
            continue
        is_stale = _MOVED.is_between(
            samples[i].camera_from_target,
            samples[k].camera_from_target,
            samples[i].covariance + samples[k].covariance,
        )
        (stale if is_stale else twice).append((samples[k].name, samples[i].name))
    if stale:
        yield finding(
            "pose_not_read_again",
            f"tag A moved between {_pairs(stale)}, but the robot's pose is the same to the last "
            "digit, so it was not read again",
            fatal=True,
        )
    if twice:
        yield finding(
            "pose_repeated",
            f"one robot pose was recorded twice, {_pairs(twice)}, and counts once",
        )
    yield from _repeated_touches(recording)


def _repeated_touches(recording: Recording) -> Iterator[Finding]:
    touches = [
        t for t in recording.touches if t.observation is None or t.observation.tag_a is None
    ]
    first = first_of_same([touch.base_from_wrist for touch in touches])
    pairs = [(touches[k].target, touches[i].target) for i, k in enumerate(first) if i != k]
    if pairs:
        yield finding(
            "pose_repeated", f"one robot pose was recorded for two touches, {_pairs(pairs)}"
        )


def moved_object(recording: Recording) -> Finding | None:
    """Names the touches in which tag B stood elsewhere; None where there are none.

    A camera that people move sees it elsewhere all the time, and an object on its table may be turned.
    """
    if recording.facts.camera_stability is Stability.MOVABLE:
        return None
    turned = turned_touches(recording)
    indices = [i for i in moved_touches(recording.touches) if i not in turned]
    if not indices:
        return None
    names = ", ".join(f"{i + 1} ({recording.touches[i].target})" for i in indices)
    return finding("object_moved", f"the object stood elsewhere in touch {names}", fatal=True)


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{a} and {b}" for a, b in pairs)
