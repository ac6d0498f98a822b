"""Which motion or sample a session still lacks for what it is planned for: in words, and as a pose.

Usable at any time while recording. Everything is judged by numerical rank, with the tolerances of
the methods that will solve the session.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.cad_fit import fit_cad
from vgrd.calibration.checks.agreement import Poses, agreement
from vgrd.calibration.expected import SAME_ORIENTATION_RAD
from vgrd.calibration.hand_eye_samples import hand_eye_samples
from vgrd.calibration.motion import Axes, hand_eye_observability, turned_axes
from vgrd.calibration.rotation_center import find_rotation_center
from vgrd.calibration.tcp import calibrate_fixed_point
from vgrd.calibration.teaching import arm_touches
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.errors import CalibrationError, InputError, NotObservable
from vgrd.geometry import Array, Pose, exp_rotation, log_rotation
from vgrd.model import Motion, Mount, Plan, Policy, Recording, Target, Touch

_TILT_DEG = 25.0
_LINE = 1e-2
_FEW_POSES = 3
_WEAK_TURN_RAD = np.radians(3.0)
_FLANGE = "xyz"


@dataclass(frozen=True, slots=True, eq=False)
class MissingMotion:
    """What to do next, because without it `rank` of `unknowns` are determined.

    code: hand_eye_motion, wrist_tilt, targets_in_line, few_touches, fixed_point_motion or
    object_turn. base_from_wrist: where to go, None where no motion of the robot is missing or its
    place is not known; target: what to touch there. essential: expected coordinates need it.
    """

    code: str
    sentence: str
    rank: int
    unknowns: int
    base_from_wrist: Pose | None = None
    target: str | None = None
    essential: bool = True


def missing_motion(recording: Recording, policy: Policy = Policy.FIXED) -> MissingMotion | None:
    """The most urgent motion or sample that is missing; None when the plan can be solved."""
    every = missing_motions(recording, policy)
    return min(every, key=lambda one: not one.essential, default=None)


def missing_motions(
    recording: Recording, policy: Policy = Policy.FIXED
) -> tuple[MissingMotion, ...]:
    """All that is missing for the recording's plan, under the policy of the job."""
    return (
        *_hand_eye(recording),
        *_fixed_point(recording),
        *_touches(recording, policy),
        *_spins(recording),
    )


def _hand_eye(recording: Recording) -> Iterator[MissingMotion]:
    samples = hand_eye_samples(recording)
    wrists = [sample.base_from_wrist for sample in samples]
    if len(samples) < _FEW_POSES:
        pose, how = _tilted(wrists[-1], np.zeros(3), None) if wrists else (None, "turn the wrist")
        yield MissingMotion(
            "hand_eye_motion",
            f"tag A was seen from {len(samples)} different robot poses, {_FEW_POSES} are the least: "
            f"{how} and look again with tag A in view, then about another axis",
            rank=6 * max(len(samples) - 1, 0),
            unknowns=12,
            base_from_wrist=pose,
        )
        return
    rank = hand_eye_observability(wrists).rank
    count, axis = turned_axes([wrist.rotation for wrist in wrists])
    if rank == 12 and count is Axes.MANY and _second_turn(wrists) > _WEAK_TURN_RAD:
        return
    target = _tag_a_in_wrist(
        recording, samples_as_poses=(wrists, [s.camera_from_target for s in samples])
    )
    pose, how = _tilted(wrists[-1], target, None if count is Axes.NONE else axis)
    so_far = {
        Axes.NONE: "the wrist kept its orientation in all looks",
        Axes.ONE: f"the wrist turned about one axis only, {_direction(axis)} of the base",
        Axes.MANY: f"the wrist hardly turned about a second axis beside {_direction(axis)}",
    }[count]
    yield MissingMotion(
        "hand_eye_motion",
        f"hand-eye: {so_far}, {min(rank, 12)} of 12 unknowns are determined: {how}, keep tag A "
        "where it is, and look again",
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


def _tag_a_in_wrist(
    recording: Recording, samples_as_poses: tuple[Sequence[Pose], Sequence[Pose]]
) -> Array:
    """Where tag A sits on the flange (3,), as far as it is known; 0 along what is not."""
    wrists, seen = (Poses.of(poses) for poses in samples_as_poses)
    if recording.facts.mount is not Mount.EYE_TO_HAND:
        return np.zeros(3)
    return agreement(wrists, seen, unit_known=True).Y.translation


def _tilted(pose: Pose, kept_in_wrist: Array, used_axis: Array | None) -> tuple[Pose, str]:
    """The pose turned about a flange axis across `used_axis` (3,) of the base, a point kept; words."""
    k = 0 if used_axis is None else int(np.argmin(np.abs(pose.rotation.T @ used_axis)))
    R = pose.rotation @ exp_rotation(np.radians(_TILT_DEG) * np.eye(3)[k])
    t = pose @ kept_in_wrist - R @ kept_in_wrist
    return Pose(
        R, t
    ), f"tilt the wrist by about {_TILT_DEG:.0f} degrees about the flange's {_FLANGE[k]}"


def _fixed_point(recording: Recording) -> Iterator[MissingMotion]:
    if recording.plan is not Plan.CONVENTIONAL:
        return
    points = recording.points
    if len(points) >= _FEW_POSES:
        try:
            calibrate_fixed_point(arm_touches(points, recording))
        except NotObservable as fault:
            rank, unknowns = fault.rank, fault.unknowns
        else:
            return
    else:
        rank, unknowns = 3 * len(points), 6
    yield (
        _tilt_again("fixed_point_motion", recording, points, rank, unknowns, essential=True)
        if points
        else MissingMotion(
            "fixed_point_motion",
            "no fixed point was touched: touch one point at least three times, the wrist turned by 25 "
            "degrees and more about two axes",
            rank=0,
            unknowns=6,
        )
    )


def _touches(recording: Recording, policy: Policy) -> Iterator[MissingMotion]:
    touches = recording.touches
    if recording.plan is Plan.CONVENTIONAL and touches:
        return
    count, _ = turned_axes([t.base_from_wrist.rotation for t in touches] or [np.eye(3)])
    needed = 4 if recording.plan is Plan.UNIVERSAL or count is not Axes.NONE else _FEW_POSES
    points = _points(recording, touches)
    beside = _beside(recording, points)
    if len(touches) < needed:
        yield MissingMotion(
            "few_touches",
            f"{len(touches)} touches, at least {needed} are needed: touch {beside.name} next",
            rank=3 * len(touches),
            unknowns=6 if needed == _FEW_POSES else 9,
            target=beside.name,
        )
        return
    if _in_line(points):
        yield MissingMotion(
            "targets_in_line",
            "all touched points lie on one line, the object can turn about it: touch "
            f"{beside.name}, which lies beside it",
            rank=5 if count is Axes.NONE else 8,
            unknowns=6 if count is Axes.NONE else 9,
            target=beside.name,
        )
    yield from _tilts(recording, policy, points, count)


def _tilts(
    recording: Recording, policy: Policy, points: Array, count: Axes
) -> Iterator[MissingMotion]:
    """Turns of the wrist that the TCP needs, as far as plan and policy need the TCP."""
    touches = recording.touches
    universal = recording.plan is Plan.UNIVERSAL
    needs_tcp = policy is not Policy.FIXED or _other_orientations(recording)
    if count is Axes.NONE:
        if universal or needs_tcp:
            yield _tilt_again(
                "wrist_tilt", recording, touches, rank=6, unknowns=9, essential=needs_tcp
            )
        elif not _in_line(points):
            yield from _unmeasured(recording, points)
        return
    if _in_line(points):
        return
    try:
        calibrate_universal(UniversalProblem(points, arm_touches(touches, recording)))
    except NotObservable as fault:
        if universal or count is Axes.MANY:
            yield _tilt_again(
                "wrist_tilt", recording, touches, fault.rank, fault.unknowns, essential=False
            )


def _unmeasured(recording: Recording, points: Array) -> Iterator[MissingMotion]:
    try:
        fit_cad(points, arm_touches(recording.touches, recording))
    except NotObservable as fault:
        yield MissingMotion("targets_in_line", str(fault), fault.rank, fault.unknowns)


def _other_orientations(recording: Recording) -> bool:
    """Whether some target is worked on with the wrist turned against all touches."""
    R = recording.touches[0].base_from_wrist.rotation
    works = [target.base_from_work for target in recording.facts.object.targets.values()]
    return any(
        work is not None and np.linalg.norm(log_rotation(work @ R.T)) > SAME_ORIENTATION_RAD
        for work in works
    )


def _tilt_again(
    code: str,
    recording: Recording,
    touches: Sequence[Touch],
    rank: int,
    unknowns: int,
    *,
    essential: bool,
) -> MissingMotion:
    """Repeat a touch with the wrist tilted, the tip kept where it is."""
    rotations = [touch.base_from_wrist.rotation for touch in touches]
    count, axis = turned_axes(rotations)
    tip, known = _tip(recording, touches)
    again = touches[0]
    pose, how = _tilted(again.base_from_wrist, tip, None if count is Axes.NONE else axis)
    so_far = (
        "the wrist kept its orientation in all touches"
        if count is Axes.NONE
        else f"the wrist turned only about {_direction(axis)} of the base"
    )
    care = "" if known else " (the tip is not known yet: approach with care)"
    return MissingMotion(
        code,
        f"TCP: {so_far}, {rank} of {unknowns} unknowns are determined: {how} and touch "
        f"{again.target} again{care}",
        rank=rank,
        unknowns=unknowns,
        base_from_wrist=pose,
        target=again.target,
        essential=essential,
    )


def _tip(recording: Recording, touches: Sequence[Touch]) -> tuple[Array, bool]:
    """TCP in the wrist (3,) as far as anything tells it, and whether all of it is known."""
    if len(recording.points) >= _FEW_POSES:
        try:
            fixed = calibrate_fixed_point(arm_touches(recording.points, recording))
        except CalibrationError:
            pass
        else:
            return fixed.tcp_in_wrist, True
    active = recording.facts.wrist_from_tcp
    if active is not None and np.linalg.norm(active.translation) > 1:
        return active.translation, True
    if len({touch.target for touch in touches}) == 1:
        R = np.array([touch.base_from_wrist.rotation for touch in touches])
        t = np.array([touch.base_from_wrist.translation for touch in touches])
        rows = (R - R.mean(axis=0)).reshape(-1, 3)
        tip = np.linalg.lstsq(rows, -(t - t.mean(axis=0)).ravel(), rcond=_LINE)[0]
        return np.asarray(tip), False
    return np.zeros(3), False


def _points(recording: Recording, touches: Sequence[Touch]) -> Array:
    targets = recording.facts.object.targets
    unknown = sorted({touch.target for touch in touches} - set(targets))
    if unknown:
        raise InputError(
            f"touched target {unknown[0]!r} is not in CAD; there are: {sorted(targets)}"
        )
    return np.array([targets[t.target].point_in_object for t in touches]).reshape(-1, 3)


def _in_line(points: Array) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= _LINE * max(spread[0], 1e-9))


def _beside(recording: Recording, points: Array) -> Target:
    """The target farthest from the line, or the point, of those that were touched."""
    targets = list(recording.facts.object.targets.values())
    if not len(points):
        return targets[0]
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle)[2][0] * (np.ptp(points, axis=0).max() > _LINE)
    off = [target.point_in_object - middle for target in targets]
    return targets[int(np.argmax([np.linalg.norm(d - along * (along @ d)) for d in off]))]


def _spins(recording: Recording) -> Iterator[MissingMotion]:
    if (
        recording.facts.object.motion is not Motion.TURNTABLE
        or recording.plan is Plan.CONVENTIONAL
    ):
        return
    tags = [seen.tag_b.camera_from_tag for seen in recording.spins if seen.tag_b]
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


def _direction(axis: Array) -> str:
    x, y, z = axis
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
