"""Targets without CAD in the paper's plans (section III-C): where each one is, its own touches tell."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.touches import (
    TouchSet,
    arm_touches,
    studentized_residuals,
    touched_orientation,
)
from vgrd.errors import NotObservable
from vgrd.geometry import Array, log_rotation
from vgrd.judging.thresholds import SAME_ORIENTATION_RAD
from vgrd.model import Recording, Target

_MEASURED = 1e-9  # of the best measured direction: below it rounding


@dataclass(frozen=True, slots=True, eq=False)
class TaughtBare:
    """flange: (3,) base, where it is when the work tip is on the target with orientation R_work (3, 3).

    covariance: (3, 3) mm^2 by the touches of the target alone; J_tcp: (3, 3) by the TCP. residuals_mm
    (k, 3), scores (k,): of its touches against each other.
    """

    target: Target
    flange: Array
    R_work: Array
    covariance: Array
    J_tcp: Array
    residuals_mm: Array
    scores: Array


def taught_bare(
    recording: Recording, name: str, tcp_in_wrist: Array | None, common_wrist: Array | None
) -> TaughtBare:
    """The weighted mean of what its touches say.

    tcp_in_wrist: (3,), None where it is not known: then the wrist must stand alike in all of them, and
    as common_wrist (3, 3) where a rotation centre is shared with other targets. Raises NotObservable
    where it does not, or where no touch measured some direction.
    """
    target = recording.facts.object.targets[name]
    own = [touch for touch in recording.touches if touch.target == name]
    touches = arm_touches(own, recording)
    configured = target.base_from_work
    R_work = touched_orientation(own) if configured is None else np.asarray(configured)
    offset = np.asarray(recording.facts.tool.work_from_touch_mm)
    if tcp_in_wrist is None:
        _check_one_wrist(recording, name, R_work, R_work if common_wrist is None else common_wrist)
        tips, by_tcp = touches.translations, np.zeros_like(touches.rotations)
        tip = offset
    else:
        tips = touches.rotations @ tcp_in_wrist + touches.translations
        by_tcp, tip = touches.rotations - R_work, tcp_in_wrist + offset
    covariance, shares = _weighed(name, touches)
    place = np.einsum("kij,kj->i", shares, tips)
    W = touches.base_sqrt_informations()
    residuals_mm = place - tips
    whitened = np.einsum("kij,kj->ki", W, residuals_mm)
    return TaughtBare(
        target=target,
        flange=place - R_work @ tip,
        R_work=R_work,
        covariance=covariance,
        J_tcp=np.einsum("kij,kjl->il", shares, by_tcp),
        residuals_mm=residuals_mm,
        scores=studentized_residuals(whitened, W.reshape(-1, 3)),
    )


def _weighed(name: str, touches: TouchSet) -> tuple[Array, Array]:
    """Covariance (3, 3) of the mean, and the share (k, 3, 3) of each touch in it."""
    W = touches.base_sqrt_informations()
    informations = np.swapaxes(W, 1, 2) @ W
    total = informations.sum(axis=0)
    values = np.linalg.eigvalsh(total)
    if values[0] <= _MEASURED * values[-1]:
        raise NotObservable(
            f"target {name!r} has no point_mm, and its touches measured nothing along the tool: touch it "
            "so that the tip rests on it, or with the wrist tilted",
            rank=int(np.sum(values > _MEASURED * values[-1])),
            unknowns=3,
        )
    covariance = np.linalg.inv(total)
    return covariance, covariance @ informations


def _check_one_wrist(recording: Recording, name: str, R_work: Array, common_wrist: Array) -> None:
    """Without the TCP a flange position holds for one orientation of the wrist."""
    wrists = [t.base_from_wrist.rotation for t in recording.touches if t.target == name]
    turns = log_rotation(np.array([R_work, *wrists]) @ common_wrist.T)
    turn_rad = float(np.linalg.norm(turns, axis=1).max())
    if turn_rad > SAME_ORIENTATION_RAD:
        raise NotObservable(
            f"target {name!r} has no point_mm and is touched or worked on with the wrist turned by "
            f"{np.degrees(turn_rad):.2f} degrees, which needs the TCP: touch it as it is worked on, or "
            "teach with plan joint or conventional",
            rank=3,
            unknowns=6,
        )
