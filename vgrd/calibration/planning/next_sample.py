"""Coaching: the sample that would lower the expected coordinate's 95 % error the most.

What counts is the job: its policy and the orientation in which the tool works, not the TCP. Only
what the arm may do is proposed (`Reach`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from vgrd.calibration.joint import JointFit, calibrate_joint
from vgrd.calibration.planning.predicted_error import Job, PredictedError
from vgrd.calibration.planning.reach import (
    Candidate,
    Looking,
    Reach,
    Spinning,
    Touching,
    flange_of,
    samples_within,
    spins_within,
    touches_within,
    usual_wrist,
)
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, log_rotation
from vgrd.model import Recording

__all__ = [
    "Advice",
    "Candidate",
    "Job",
    "Looking",
    "Reach",
    "Spinning",
    "Touching",
    "in_words",
    "next_best",
    "plan_samples",
    "plan_touches",
    "rank_samples",
    "without_pose",
]

_EXCHANGES = 4  # passes of Fedorov's exchange at most; it stops when nothing changes

InView = Callable[[Pose], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Advice:
    """A candidate, the mean 95 % error (mm) of the job without and with it, and a sentence.

    base_from_wrist: where the flange stands for it, by the present estimate; None for a spin, and where
    it may not be named (`without_pose`).
    """

    candidate: Candidate
    base_from_wrist: Pose | None
    before_mm: float
    after_mm: float
    sentence: str


def next_best(
    taught: Recording | JointFit,
    job: Job | None = None,
    reach: Reach | None = None,
    *,
    tag_a_in_view: InView | None = None,
) -> tuple[Advice, ...]:
    """Samples within reach ranked, the best first, with the error predicted after each one.

    tag_a_in_view: whether the camera can see tag A at a camera_from_tag_a; None: it always can.
    Raises InputError where nothing is within reach, and what `calibrate_joint` raises where too
    little was recorded for a first estimate.
    """
    result = _solved(taught)
    candidates = samples_within(result, reach or Reach())
    return rank_samples(result, candidates, job, tag_a_in_view=tag_a_in_view)


def rank_samples(
    taught: Recording | JointFit,
    candidates: Sequence[Candidate],
    job: Job | None = None,
    *,
    tag_a_in_view: InView | None = None,
) -> tuple[Advice, ...]:
    """The same for candidates of one's own."""
    _require(candidates)
    result = _solved(taught)
    foresight = PredictedError(result, job or Job(), tag_a_in_view)
    before_mm = foresight.error_mm(foresight.covariance)
    errors = foresight.errors_after(foresight.covariance, foresight.rows(candidates))
    order = np.argsort(np.round(errors, 9), kind="stable")
    usual = cache(partial(usual_wrist, result.recording))
    advice = []
    for i in order:
        task = in_words(result, candidates[i], usual)
        flange = flange_of(result, candidates[i])
        words = _with_error(task, before_mm, errors[i])
        advice.append(Advice(candidates[i], flange, before_mm, float(errors[i]), words))
    return tuple(advice)


def without_pose(result: JointFit, advice: Advice) -> Advice:
    """The same in words alone: no place to drive to."""
    task = in_words(result, advice.candidate, names_place=False)
    sentence = _with_error(task, advice.before_mm, advice.after_mm)
    return replace(advice, base_from_wrist=None, sentence=sentence)


def _with_error(task: str, before_mm: float, after_mm: float) -> str:
    return f"{task}: 95 % error {before_mm:.3f} -> {after_mm:.3f} mm"


def plan_touches(
    nominal: JointFit,
    count: int,
    job: Job | None = None,
    reach: Reach | None = None,
    *,
    tag_a_in_view: InView | None = None,
) -> tuple[Touching, ...]:
    """The `count` touches within reach that serve the job best, beside the looks and spins.

    nominal: any estimate of a cell like this one, an earlier session's or a drawing's; its touches
    do not count. Greedy, then exchanged one by one until none improves (Fedorov 1972).
    """
    foresight = PredictedError(nominal, job or Job(), tag_a_in_view)
    candidates = touches_within(nominal, reach or Reach())
    start = foresight.without(looks=True, spins=True)
    return tuple(candidates[i] for i in _planned(foresight, start, candidates, count))


def plan_samples(
    nominal: JointFit,
    count: int,
    job: Job | None = None,
    reach: Reach | None = None,
    *,
    tag_a_in_view: InView | None = None,
) -> tuple[Touching | Spinning, ...]:
    """The same for a whole session of `count` touches and spins, which looks are no match for.

    A spin can be planned only where `nominal` knows the axis of turning.
    """
    foresight = PredictedError(nominal, job or Job(), tag_a_in_view)
    reach = reach or Reach()
    candidates: list[Touching | Spinning] = [*touches_within(nominal, reach)]
    candidates += spins_within(nominal, reach)
    start = foresight.without(looks=False, spins=False)
    return tuple(candidates[i] for i in _planned(foresight, start, candidates, count))


def in_words(
    result: JointFit,
    candidate: Candidate,
    usual: Callable[[str | None], Array] | None = None,
    *,
    names_place: bool = True,
) -> str:
    """What the operator is to do; usual: as `usual_wrist` of the recording.

    names_place: whether a look tells where the flange stands for it.
    """
    usual = usual or partial(usual_wrist, result.recording)
    if isinstance(candidate, Spinning):
        return (
            f"turn the object to {np.degrees(candidate.angle_rad):.0f} degrees and take a picture"
        )
    if isinstance(candidate, Looking):
        x, y, z = candidate.base_from_wrist.translation
        tilt = _tilt_in_words(result, usual(None), candidate.base_from_wrist.rotation)
        place = f"with the flange at ({x:.0f}, {y:.0f}, {z:.0f}) mm" if names_place else "at tag A"
        return f"look {place}, {tilt}"
    tilt = _tilt_in_words(result, usual(candidate.target), candidate.base_from_wrist)
    turn = f"turn the object to {np.degrees(candidate.turn_rad):.0f} degrees and "
    return f"{turn if candidate.turn_rad else ''}touch {candidate.target} {tilt}"


def _tilt_in_words(result: JointFit, straight: Array, R: Array) -> str:
    axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
    now, then = straight @ axis, R @ axis
    tilt = float(np.arctan2(np.linalg.norm(np.cross(now, then)), now @ then))
    turn = np.degrees(np.linalg.norm(log_rotation(straight.T @ R)))
    if turn < 0.5:
        return "with the wrist as usual"
    if tilt < np.radians(0.5):
        return f"with the wrist turned by {turn:.0f} degrees about the tool"
    x, y = (then - now * (now @ then))[:2]
    side = np.degrees(np.arctan2(y, x))
    return (
        f"with the tip tilted by {np.degrees(tilt):.0f} degrees towards "
        f"{side:.0f} degrees of the base ({turn:.0f} degrees of turn in all)"
    )


def _planned(
    foresight: PredictedError, start: Array, candidates: Sequence[Candidate], count: int
) -> list[int]:
    _require(candidates)
    rows = foresight.rows(candidates)
    chosen: list[int] = []

    def best(indices: Sequence[int]) -> int:
        P = start
        for i in indices:
            P = foresight.with_rows(P, rows[i])
        return int(np.argmin(np.round(foresight.errors_after(P, rows), 9)))

    for _ in range(count):
        chosen.append(best(chosen))
    for _ in range(_EXCHANGES):
        previous = list(chosen)
        for k in range(count):
            chosen[k] = best(chosen[:k] + chosen[k + 1 :])
        if chosen == previous:
            break
    return chosen


def _solved(taught: Recording | JointFit) -> JointFit:
    return taught if isinstance(taught, JointFit) else calibrate_joint(taught)


def _require(candidates: Sequence[Candidate]) -> None:
    if not candidates:
        raise InputError(
            "no sample is within reach: allow more tilt, larger boxes or wider joint limits"
        )
