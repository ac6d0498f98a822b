"""Rigid fit of touched flange positions to CAD points: constant wrist, no TCP (special method)."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.touches.equations import TouchSet, studentized_residuals
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, hat, nearest_rotation
from vgrd.geometry.coincidence import are_in_line
from vgrd.geometry.covariance import covariance_from, observability
from vgrd.geometry.least_squares import check_convergence, minimize
from vgrd.judging.thresholds import LINE

_TOLERANCE = 2.5e-3  # mm per mm and touch, as in `tcp.surface`


@dataclass(frozen=True, slots=True, eq=False)
class CadFit:
    """base_from_object_flange: maps a CAD point to where the flange stands when the tip is on it.

    covariance: (6, 6), left tangent. residuals_mm: (m, 3), base frame; scores: (m,) sigmas each
    touch is off.
    """

    base_from_object_flange: Pose
    covariance: Array
    residuals_mm: Array
    scores: Array

    def flange(self, point_in_object: Array) -> Array:
        """Flange position (3,) in the base for a CAD point, mm."""
        return self.base_from_object_flange @ point_in_object

    def jacobian(self, point_in_object: Array) -> Array:
        """How that position changes, (3, 6), with the left tangent of the fit."""
        return np.hstack([np.eye(3), -hat(self.flange(point_in_object))])


def kabsch(source: Array, target: Array, weights: Array | None = None) -> Pose:
    """Rigid motion that maps points (m, 3) to points (m, 3) with the least weighted squares."""
    w = np.ones(len(source)) if weights is None else weights
    w = w / w.sum()
    a, b = w @ source, w @ target
    R = nearest_rotation((target - b).T @ ((source - a) * w[:, None]), tolerance=np.inf)
    return Pose(R, b - R @ a)


def fit_cad(points_in_object: Array, touches: TouchSet) -> CadFit:
    """Weighted rigid fit; the wrist's orientation must be the same in all touches.

    Raises TooFewObservations below 3 touches and NotObservable, with the reason, for points on
    one line or directions nobody measured.
    """
    p = np.array(points_in_object, dtype=np.float64)
    if p.shape != (len(touches), 3) or not np.isfinite(p).all():
        raise InputError(f"{len(touches)} touches need as many finite points, got {p.shape}")
    if len(touches) < 3:
        raise TooFewObservations(f"a CAD fit needs at least 3 touches, got {len(touches)}")
    start = kabsch(p, touches.translations)
    _check_rank(p, touches.measured(), start)
    minimum = minimize(
        lambda fit: _linearize(fit, p, touches), lambda fit, step: Pose.exp(step) @ fit, start
    )
    check_convergence(minimum.report, "fit of the touches to the CAD points")
    return CadFit(
        base_from_object_flange=minimum.state,
        covariance=covariance_from(minimum.jacobian),
        residuals_mm=minimum.state @ p - touches.translations,
        scores=studentized_residuals(minimum.residuals.reshape(-1, 3), minimum.jacobian),
    )


def _linearize(fit: Pose, p: Array, touches: TouchSet) -> tuple[Array, Array]:
    W = touches.base_sqrt_informations()
    q = fit @ p
    J = np.concatenate([np.broadcast_to(np.eye(3), W.shape), -hat(q)], axis=2)
    r = np.einsum("mij,mj->mi", W, q - touches.translations)
    return r.ravel(), (W @ J).reshape(-1, 6)


def _check_rank(p: Array, measured: TouchSet, fit: Pose) -> None:
    about_center = np.eye(6)
    about_center[:3, 3:] = hat(fit @ p.mean(axis=0))
    lever = max(float(np.std(p, axis=0).max()), 1.0)
    scales = np.array([1.0] * 3 + [1 / lever] * 3)
    rank = observability(_linearize(fit, p, measured)[1] @ about_center, scales, _TOLERANCE).rank
    if rank == 6:
        return
    reason = "some touches measure nothing along the tool; add touches that do"
    if are_in_line(p, LINE):
        reason = "the touched points lie on one line; touch a point beside it"
    raise NotObservable(
        f"CAD fit: {rank} of 6 unknowns are determined: {reason}", rank=rank, unknowns=6
    )
