"""Which touches a session still lacks: of the object, and of a fixed point."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vgrd.calibration.checks.proposals import MissingMotion, direction, tilted
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.tcp import contact_tcp
from vgrd.calibration.touches import arm_touches, cad_touches, fit_cad
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.errors import CalibrationError, NotObservable, TooFewObservations
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.coincidence import are_in_line
from vgrd.judging.thresholds import LINE, SAME_ORIENTATION_RAD
from vgrd.model import Plan, Policy, Recording, Target, Touch

_FEW = 3  # the least of a rigid fit
_SURFACES: Mapping[Plan, tuple[str, int, int]] = MappingProxyType(
    {  # where, touches at the least, unknowns: as docs/touch-files.md
        Plan.PLANE: ("of the plane, far apart on it", 7, 6),
        Plan.SPHERE: ("of the ball, on several sides of it", 8, 7),
    }
)


def missing_points(recording: Recording) -> Iterator[MissingMotion]:
    """What the TCP of the conventional plans lacks: touches beside the object with the wrist turned."""
    points = recording.points
    if recording.plan.touches_surface:
        yield from _surface_gaps(recording)
    if recording.plan is not Plan.CONVENTIONAL:
        return
    if not points:
        yield MissingMotion(
            "fixed_point_motion",
            "no fixed point was touched: touch one point at least three times, the wrist turned "
            "by 25 degrees and more about two axes",
            rank=0,
            unknowns=6,
        )
        return
    try:
        contact_tcp(recording)
    except TooFewObservations:
        rank, unknowns = 3, 6
    except NotObservable as fault:
        rank, unknowns = fault.rank, fault.unknowns
    else:
        return
    count, _ = turned_axes([point.base_from_wrist.rotation for point in points])
    yield _tilt_again(
        "fixed_point_motion",
        recording,
        points,
        rank,
        unknowns,
        essential=count is not Axes.ONE or rank < 5,
    )


def _surface_gaps(recording: Recording) -> Iterator[MissingMotion]:
    """What touches of a plane or a ball lack, in the words of the method that refuses them."""
    where, least, unknowns = _SURFACES[recording.plan]
    if len(recording.points) < least:
        yield MissingMotion(
            "surface_motion",
            f"TCP: {len(recording.points)} touches {where}: touch it at least {least} times, the wrist "
            "turned by 25 degrees and more about two axes",
            rank=min(len(recording.points), unknowns - 1),
            unknowns=unknowns,
        )
        return
    try:
        contact_tcp(recording)
    except NotObservable as fault:
        yield MissingMotion("surface_motion", f"TCP: {fault}", fault.rank, fault.unknowns)
    except CalibrationError as fault:
        yield MissingMotion("surface_motion", f"TCP: {fault}", unknowns - 1, unknowns)


def missing_touches(recording: Recording, policy: Policy) -> Iterator[MissingMotion]:
    """What object and TCP lack: targets beside a line, and tilts where plan or policy need the TCP.

    A target without CAD lacks a touch of its own.
    """
    indices, points = cad_touches(recording)
    yield from _untouched(recording)
    if recording.plan.touches_beside and recording.touches:
        return
    target = _beside(recording, points)
    if target is None:
        yield from _tilts_without_cad(recording, policy)
        return
    touches = [recording.touches[i] for i in indices]
    count, _ = turned_axes([t.base_from_wrist.rotation for t in touches] or [np.eye(3)])
    needed = 4 if recording.plan is Plan.UNIVERSAL or count is not Axes.NONE else _FEW
    if len(touches) < needed:
        yield MissingMotion(
            "few_touches",
            f"{len(touches)} touches{_of_cad(recording)}, at least {needed} are needed: "
            f"touch {target.name} next",
            rank=3 * len(touches),
            unknowns=6 if needed == _FEW else 9,
            target=target.name,
        )
        return
    if are_in_line(points, LINE):
        yield MissingMotion(
            "targets_in_line",
            "all touched points lie on one line, the object can turn about it: touch "
            f"{target.name}, which lies beside it",
            rank=5 if count is Axes.NONE else 8,
            unknowns=6 if count is Axes.NONE else 9,
            target=target.name,
        )
    yield from _tilts(recording, policy, touches, points, count)


def _untouched(recording: Recording) -> Iterator[MissingMotion]:
    """Targets without CAD that cannot be served, because no touch tells where they are."""
    touched = {touch.target for touch in recording.touches}
    for name in recording.facts.object.bare:
        if name not in touched:
            yield MissingMotion(
                "target_untouched",
                f"target {name} has no point_mm and was not touched, so that it cannot be served: "
                f"touch {name}",
                rank=0,
                unknowns=3,
                target=name,
                essential=False,
            )


def _of_cad(recording: Recording) -> str:
    return " of targets in CAD" if recording.facts.object.bare else ""


def _tilts_without_cad(recording: Recording, policy: Policy) -> Iterator[MissingMotion]:
    """Touches of one target with the wrist turned: nothing else tells the TCP where no target is in CAD.

    A wrist that follows the object needs no TCP, and a wrist that only yaws tells what it needs of it.
    """
    touches = recording.touches
    groups = [[t for t in touches if t.target == name] for name in {t.target for t in touches}]
    turned = [
        turned_axes([touch.base_from_wrist.rotation for touch in group])[0]
        for group in (*groups, recording.points)
        if len(group) > 1
    ]
    if not touches or Axes.MANY in turned:
        return
    most = max(groups, key=lambda group: (len(group), group[0].target))
    known = 5 if Axes.ONE in turned else 3
    essential = policy is not Policy.FOLLOW and Axes.ONE not in turned
    yield _tilt_again("wrist_tilt", recording, most, known, 6, essential=essential)


def _tilts(
    recording: Recording,
    policy: Policy,
    touches: Sequence[Touch],
    points: Array,
    count: Axes,
) -> Iterator[MissingMotion]:
    """Turns of the wrist that the TCP needs, as far as plan and policy need the TCP."""
    universal = recording.plan is Plan.UNIVERSAL
    needs_tcp = policy is not Policy.FIXED or _other_orientations(recording)
    if count is Axes.NONE:
        if universal or needs_tcp:
            yield _tilt_again(
                "wrist_tilt", recording, touches, rank=6, unknowns=9, essential=needs_tcp
            )
        elif not are_in_line(points, LINE):
            yield from _unmeasured(recording, touches, points)
        return
    if are_in_line(points, LINE):
        return
    try:
        calibrate_universal(UniversalProblem(points, arm_touches(touches, recording)))
    except NotObservable as fault:
        if universal or count is Axes.MANY:
            yield _tilt_again(
                "wrist_tilt", recording, touches, fault.rank, fault.unknowns, essential=False
            )


def _unmeasured(
    recording: Recording, touches: Sequence[Touch], points: Array
) -> Iterator[MissingMotion]:
    try:
        fit_cad(points, arm_touches(touches, recording))
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
    tip, is_tip_known = _tip(recording, touches)
    again = touches[0]
    pose, how = tilted(again.base_from_wrist, tip, None if count is Axes.NONE else axis)
    status = (
        "the wrist kept its orientation in all touches"
        if count is Axes.NONE
        else f"the wrist turned only about {direction(axis)} of the base"
    )
    care = "" if is_tip_known else " (the tip is not known yet: approach with care)"
    return MissingMotion(
        code,
        f"TCP: {status}, {rank} of {unknowns} unknowns are determined: {how} and touch "
        f"{again.target} again{care}",
        rank=rank,
        unknowns=unknowns,
        base_from_wrist=pose,
        target=again.target,
        essential=essential,
    )


def _tip(recording: Recording, touches: Sequence[Touch]) -> tuple[Array, bool]:
    """TCP in the wrist (3,) as far as anything tells it, and whether all of it is known."""
    if len(recording.points) >= _FEW:
        try:
            beside = contact_tcp(recording)
        except CalibrationError:
            pass
        else:
            return beside.tcp_in_wrist, True
    active = recording.facts.wrist_from_tcp
    if active is not None and np.linalg.norm(active.translation) > 1:
        return active.translation, True
    if len({touch.target for touch in touches}) == 1:
        R = np.array([touch.base_from_wrist.rotation for touch in touches])
        t = np.array([touch.base_from_wrist.translation for touch in touches])
        rows = (R - R.mean(axis=0)).reshape(-1, 3)
        tip = np.linalg.lstsq(rows, -(t - t.mean(axis=0)).ravel(), rcond=LINE)[0]
        return np.asarray(tip), False
    return np.zeros(3), False


def _beside(recording: Recording, points: Array) -> Target | None:
    """The target in CAD farthest from the line, or the point, of those that were touched; None without CAD."""
    every = recording.facts.object.targets.values()
    targets = [target for target in every if target.point_in_object is not None]
    if not len(points):
        return targets[0] if targets else None
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle)[2][0] * (np.ptp(points, axis=0).max() > LINE)
    offsets = [target.cad - middle for target in targets]
    return targets[int(np.argmax([np.linalg.norm(d - along * (along @ d)) for d in offsets]))]
