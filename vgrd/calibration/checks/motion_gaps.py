"""Which motion or sample a session still lacks for what it is planned for: in words, and as a pose.

Usable at any time while recording. Everything is judged by numerical rank, with the tolerances of
the methods that will solve the session.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from vgrd.calibration.checks.pose_agreement import Poses, agreement
from vgrd.calibration.checks.proposals import MissingMotion, direction, tilted
from vgrd.calibration.checks.touch_gaps import missing_points, missing_touches
from vgrd.calibration.hand_eye import PoseSample, hand_eye_samples
from vgrd.calibration.observability import Axes, hand_eye_observability, turned_axes
from vgrd.calibration.turntable import find_rotation_center, turned_tags
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, log_rotation
from vgrd.model import Motion, Mount, Policy, Recording, Stability

__all__ = ["MissingMotion", "missing_motion", "missing_motions"]

_FEW_POSES = 3  # the least of a hand-eye calibration
_WEAK_TURN_RAD = np.radians(3.0)  # rms: an arc of 10 degrees about the second axis


def missing_motion(recording: Recording, policy: Policy = Policy.FIXED) -> MissingMotion | None:
    """The most urgent motion or sample that is missing; None when the plan can be solved."""
    gaps = missing_motions(recording, policy)
    return min(gaps, key=lambda gap: not gap.essential, default=None)


def missing_motions(
    recording: Recording, policy: Policy = Policy.FIXED
) -> tuple[MissingMotion, ...]:
    """All that is missing for the recording's plan, under the policy of the job."""
    return (
        *_hand_eye(recording),
        *missing_points(recording),
        *missing_touches(recording, policy),
        *_spins(recording),
    )


def _hand_eye(recording: Recording) -> Iterator[MissingMotion]:
    samples = hand_eye_samples(recording)
    seen, again, in_view = "tag A was seen", "look again", "tag A"
    if recording.facts.camera_stability is Stability.MOVABLE:
        seen, again, in_view = "touches showed both tags", "touch a target", "both tags"
    wrists = [sample.base_from_wrist for sample in samples]
    if len(samples) < _FEW_POSES:
        pose, how = tilted(wrists[-1], np.zeros(3), None) if wrists else (None, "turn the wrist")
        yield MissingMotion(
            "hand_eye_motion",
            f"{seen} from {len(samples)} different robot poses, {_FEW_POSES} are the least: "
            f"{how} and {again} with {in_view} in view, then about another axis",
            rank=6 * max(len(samples) - 1, 0),
            unknowns=12,
            base_from_wrist=pose,
        )
        return
    rank = hand_eye_observability(wrists).rank
    count, axis = turned_axes([wrist.rotation for wrist in wrists])
    if rank == 12 and count is Axes.MANY and _second_turn(wrists) > _WEAK_TURN_RAD:
        return
    target = _tag_a_in_wrist(recording, samples)
    pose, how = tilted(wrists[-1], target, None if count is Axes.NONE else axis)
    status = {
        Axes.NONE: "the wrist kept its orientation in all looks",
        Axes.ONE: f"the wrist turned about one axis only, {direction(axis)} of the base",
        Axes.MANY: f"the wrist hardly turned about a second axis beside {direction(axis)}",
    }[count]
    yield MissingMotion(
        "hand_eye_motion",
        f"hand-eye: {status}, {min(rank, 12)} of 12 unknowns are determined: {how}, keep tag A "
        f"where it is, and {again}",
        rank=rank,
        unknowns=12,
        base_from_wrist=pose,
        essential=count is Axes.NONE,
    )


def _second_turn(wrists: Sequence[Pose]) -> float:
    """Rms turn, rad, about the second most used axis."""
    turns = np.array([log_rotation(w.rotation @ wrists[0].rotation.T) for w in wrists])
    spread = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(turns))
    return float(spread[1])


def _tag_a_in_wrist(recording: Recording, samples: Sequence[PoseSample]) -> Array:
    """Where tag A sits on the flange (3,), as far as it is known; 0 along what is not."""
    if recording.facts.mount is not Mount.EYE_TO_HAND:
        return np.zeros(3)
    wrists = Poses.of([sample.base_from_wrist for sample in samples])
    cameras = Poses.of([sample.camera_from_target for sample in samples])
    return agreement(wrists, cameras, unit_known=True).Y.translation


def _spins(recording: Recording) -> Iterator[MissingMotion]:
    if recording.facts.object.motion is not Motion.TURNTABLE or recording.plan.touches_beside:
        return
    tags = turned_tags(recording)
    rank = min(len(tags), 2) + 1 if tags else 0
    if len(tags) >= _FEW_POSES:
        try:
            find_rotation_center(tags)
        except NotObservable as fault:
            rank = fault.rank
        else:
            return
    yield MissingMotion(
        "object_turn",
        f"rotation centre: {len(tags)} pictures of the turning object do not determine it: turn the "
        "object by 90 degrees and take a picture, at least three different ones, the robot at rest",
        rank=rank,
        unknowns=5,
        essential=False,
    )
