"""What the touches teach: flange positions of all targets, the TCP where the wrists varied."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vgrd.calibration.observability import Axes, check_distinct, turned_axes
from vgrd.calibration.stepwise.bare_targets import taught_bare
from vgrd.calibration.tcp import ContactTcp, contact_tcp
from vgrd.calibration.touches import (
    CadFit,
    TouchSet,
    arm_touches,
    cad_touches,
    fit_cad,
    touched_orientation,
)
from vgrd.calibration.universal import (
    UniversalProblem,
    UniversalResult,
    calibrate_universal,
)
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.judging.thresholds import SAME_ORIENTATION_RAD
from vgrd.model import (
    Recording,
    Target,
    TaughtPoint,
    TcpEstimate,
    frozen_array,
    frozen_copy,
)

Flange = tuple[Target, Array, Array, Array]


@dataclass(frozen=True, slots=True, eq=False)
class FittedTouches:
    """Outcome of the touches.

    tcp: None where the wrist was constant and nothing was touched beside the object (special method).
    pivot_in_base: as in `Pivot`. parameters: (k, k) covariance of what was fitted; per target its flange
    (3,), orientation (3, 3) and (3, k) derivative; residuals_mm (m, 3) and scores (m,) of the touches.
    beside: what the touches beside the object gave, None where the TCP is not theirs. bare_scores: by
    target without CAD, of the touch that belongs least to the others, in sigmas.
    """

    tcp: TcpEstimate | None
    pivot_in_base: Array | None
    parameters: Array
    pivot_jacobian: Array
    flanges: Mapping[str, Flange]
    residuals_mm: Array
    scores: Array
    beside: ContactTcp | None = None
    bare_scores: Mapping[str, float] = field(default_factory=dict)

    @property
    def open_axis(self) -> Array | None:
        """Direction (3,) in the wrist along which the TCP stays open, None where it does not."""
        return None if self.beside is None else self.beside.open_axis

    def points(self, *, has_pivot: bool) -> tuple[dict[str, TaughtPoint], dict[str, Array]]:
        """Taught points, and `touch_covariances` as the solutions have them."""
        pivot = self.pivot_jacobian if has_pivot else np.zeros_like(self.pivot_jacobian)
        points, covariances = {}, {}
        for name, (target, flange, R_work, J) in self.flanges.items():
            rows = [J, pivot]
            if self.tcp is not None:
                rows.append(np.eye(3, len(self.parameters), 6))
            jacobian = np.vstack(rows)
            covariance = jacobian @ self.parameters @ jacobian.T
            points[name] = TaughtPoint(
                target=target,
                flange_in_base=frozen_array(flange, 3),
                base_from_work=frozen_array(R_work, 3, 3),
                covariance=frozen_array(covariance[:3, :3], 3, 3),
            )
            if self.tcp is not None or has_pivot:
                covariances[name] = frozen_copy(covariance)
        return points, covariances


def fit_touches(recording: Recording) -> FittedTouches:
    """Fit the touches: universal method for varied wrists, CAD fit for a constant one.

    Where the wrist was constant, plans conventional, plane and sphere take the TCP from the touches beside the object.

    Raises InputError (unknown target), TooFewObservations, NotObservable or DidNotConverge.
    """
    touches = recording.touches
    if not touches:
        raise TooFewObservations("nothing was touched: touch at least 4 targets of the object")
    indices, points = cad_touches(recording)
    names = [f"touch {i + 1} ({touch.target})" for i, touch in enumerate(touches)]
    check_distinct(names, [touch.base_from_wrist for touch in touches])
    arrays = arm_touches([touches[i] for i in indices], recording)
    if not recording.facts.object.has_cad:
        fitted = _without_cad(recording)
    elif turned_axes(list(arrays.rotations) or [np.eye(3)])[0] is Axes.NONE:
        if recording.plan.touches_beside and recording.points:
            fitted = _conventional(recording, points, arrays)
        else:
            fitted = _special(recording, fit_cad(points, arrays))
    else:
        fitted = _universal(recording, calibrate_universal(UniversalProblem(points, arrays)))
    return _with_bare(fitted, recording)


def _without_cad(recording: Recording) -> FittedTouches:
    """Section III without CAD: the TCP by the touches beside the object where there were some, else none."""
    beside, parameters, tcp = None, np.zeros((6, 6)), None
    if recording.plan.touches_beside and recording.points:
        beside = contact_tcp(recording, allow_open_axis=True)
        parameters = np.zeros((9, 9))
        parameters[6:, 6:] = beside.covariance
        in_wrist = frozen_array(beside.tcp_in_wrist, 3)
        tcp = TcpEstimate(in_wrist, frozen_array(beside.covariance, 3, 3))
    return FittedTouches(
        tcp=tcp,
        pivot_in_base=None,
        parameters=parameters,
        pivot_jacobian=np.zeros((3, len(parameters))),
        flanges={},
        residuals_mm=np.zeros((0, 3)),
        scores=np.zeros(0),
        beside=beside,
    )


def _with_bare(fitted: FittedTouches, recording: Recording) -> FittedTouches:
    """The same with the targets without CAD (III-C): each by its own touches, by the same TCP or wrist."""
    tcp = None if fitted.tcp is None else fitted.tcp.in_wrist
    common_wrist = next((R_work for _, _, R_work, _ in fitted.flanges.values()), None)
    taught = [
        taught_bare(recording, name, tcp, common_wrist)
        for name in recording.facts.object.bare
        if any(touch.target == name for touch in recording.touches)
    ]
    k = len(fitted.parameters)
    n = k + 3 * len(taught)
    parameters = np.zeros((n, n))
    parameters[:k, :k] = fitted.parameters

    def widened(J: Array) -> Array:
        return np.hstack([J, np.zeros((3, n - k))])

    flanges = {
        name: (target, flange, R_work, widened(J))
        for name, (target, flange, R_work, J) in fitted.flanges.items()
    }
    for i, bare in enumerate(taught):
        own = slice(k + 3 * i, k + 3 * i + 3)
        parameters[own, own] = bare.covariance
        J = np.zeros((3, n))
        J[:, own] = np.eye(3)
        if tcp is not None:
            J[:, 6:9] = bare.J_tcp
        flanges[bare.target.name] = (bare.target, bare.flange, bare.R_work, J)
    return replace(
        fitted,
        parameters=parameters,
        pivot_jacobian=widened(fitted.pivot_jacobian),
        flanges=flanges,
        residuals_mm=np.vstack([fitted.residuals_mm, *(bare.residuals_mm for bare in taught)]),
        scores=np.concatenate([fitted.scores, *(bare.scores for bare in taught)]),
        bare_scores={bare.target.name: float(bare.scores.max()) for bare in taught},
    )


def _special(recording: Recording, fit: CadFit) -> FittedTouches:
    offset = recording.facts.tool.work_from_touch_mm
    R_work = recording.touches[int(cad_touches(recording)[0][0])].base_from_wrist.rotation
    flanges = {}
    for name, target in _in_cad(recording):
        _check_same_orientation(target, R_work)
        p = target.cad
        flanges[name] = (target, fit.flange(p) - R_work @ offset, R_work, fit.jacobian(p))
    center = recording.facts.object.center_in_object
    pivot = np.zeros(3) if center is None else center
    return FittedTouches(
        tcp=None,
        pivot_in_base=None if center is None else fit.flange(center) - R_work @ offset,
        parameters=fit.covariance,
        pivot_jacobian=fit.jacobian(pivot),
        flanges=flanges,
        residuals_mm=fit.residuals_mm,
        scores=fit.scores,
    )


def _conventional(recording: Recording, points: Array, touches: TouchSet) -> FittedTouches:
    """Section III: the TCP by the touches beside the object, then the touched points, fitted to CAD.

    Parameters: left tangent of base_from_object, and the TCP, by which the fit shifts.
    """
    if not len(points):
        raise TooFewObservations(
            "only targets without point_mm were touched: touch at least 3 targets that have one"
        )
    beside = contact_tcp(recording, allow_open_axis=True)
    R, tcp = touches.rotations[0], beside.tcp_in_wrist
    fit = fit_cad(points, replace(touches, translations=touches.translations + R @ tcp))
    by_tcp = np.vstack([R, np.zeros((3, 3)), np.eye(3)])
    covariance = by_tcp @ beside.covariance @ by_tcp.T
    covariance[:6, :6] += fit.covariance
    flanges, pivot, J_pivot = _by_tip(recording, fit.base_from_object_flange, fit.jacobian, tcp)
    return FittedTouches(
        tcp=TcpEstimate(frozen_array(tcp, 3), frozen_array(beside.covariance, 3, 3)),
        pivot_in_base=pivot,
        parameters=covariance,
        pivot_jacobian=J_pivot,
        flanges=flanges,
        residuals_mm=fit.residuals_mm,
        scores=fit.scores,
        beside=beside,
    )


def _in_cad(recording: Recording) -> list[tuple[str, Target]]:
    targets = recording.facts.object.targets.items()
    return [(name, target) for name, target in targets if target.point_in_object is not None]


def _check_same_orientation(target: Target, R_work: Array) -> None:
    if target.base_from_work is None:
        return
    turn_rad = float(np.linalg.norm(log_rotation(target.base_from_work @ R_work.T)))
    if turn_rad > SAME_ORIENTATION_RAD:
        raise NotObservable(
            f"target {target.name!r} works with the wrist turned by {np.degrees(turn_rad):.2f} degrees "
            "against all touches, which needs the TCP: touch with varied wrists",
            rank=6,
            unknowns=9,
        )


def _universal(recording: Recording, result: UniversalResult) -> FittedTouches:
    base_from_object = result.object_from_base.inverse()
    R = base_from_object.rotation
    flanges, pivot, J_pivot = _by_tip(
        recording,
        base_from_object,
        lambda p: np.hstack([-R, R @ hat(p)]),
        result.tcp_in_wrist,
    )
    return FittedTouches(
        tcp=TcpEstimate(
            frozen_array(result.tcp_in_wrist, 3), frozen_array(result.covariance[6:, 6:], 3, 3)
        ),
        pivot_in_base=pivot,
        parameters=result.covariance,
        pivot_jacobian=J_pivot,
        flanges=flanges,
        residuals_mm=result.residuals_mm,
        scores=result.scores,
    )


def _by_tip(
    recording: Recording,
    base_from_object: Pose,
    jacobian: Callable[[Array], Array],
    tcp_in_wrist: Array,
) -> tuple[dict[str, Flange], Array | None, Array]:
    """Flanges of all targets, and the pivot (3,) in the base with its derivative (3, 9), by a known TCP.

    jacobian: of a CAD point (3,) in the base by the object's pose, (3, 6); the TCP comes after it.
    """
    tip = tcp_in_wrist + recording.facts.tool.work_from_touch_mm
    flanges = {}
    for name, target in _in_cad(recording):
        R_work = target.base_from_work
        if R_work is None:
            R_work = touched_orientation(recording.touches, name)
        p = target.cad
        J = np.hstack([jacobian(p), -R_work])
        flanges[name] = (target, base_from_object @ p - R_work @ tip, R_work, J)
    center = recording.facts.object.center_in_object
    J_pivot = np.hstack([jacobian(np.zeros(3) if center is None else center), np.zeros((3, 3))])
    return flanges, None if center is None else base_from_object @ center, J_pivot
