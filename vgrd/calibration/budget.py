"""Error budget: which link of the chain the expected coordinate's variance comes from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import solve_triangular

from vgrd.calibration.joint import JointResult
from vgrd.calibration.joint_expected import Prediction, predict
from vgrd.calibration.joint_problem import Link
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import radius95
from vgrd.geometry.point_pose import linearize_points
from vgrd.model import Policy, TagObservation, TagSpec

ARM = "arm"
PICTURE = "tag B now"
UNKNOWN = "left undetermined"
INTRINSICS = "intrinsics"
PRINT_A, PRINT_B = "size of tag A", "size of tag B"
TIME = "time"

_CORNERS = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])


@dataclass(frozen=True, slots=True, eq=False)
class Systematic:
    """Errors that all pictures share, and those of time; None or 0 where they do not count.

    intrinsics: (6, 6) covariance of fx, fy, cx, cy, k1, k2. tag_size_sigma_mm: of the print.
    drift_mm: sigma per axis of what moved since the calibration, or while the answer was used.
    """

    intrinsics: Array | None = None
    tag_size_sigma_mm: float = 0.0
    drift_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Shares (t, l) of the links in the variance of every target, rows summing to 1.

    u95_mm: (t,) 95 % radii, systematic errors included.
    """

    targets: tuple[str, ...]
    links: tuple[str, ...]
    shares: Array
    u95_mm: Array

    def rows(self) -> list[dict[str, str | float]]:
        """The table: one dictionary per target with its name, u95_mm and every share."""
        shares = [dict(zip(self.links, map(float, row), strict=True)) for row in self.shares]
        return [
            {"target": name, "u95_mm": float(radius), **row}
            for name, radius, row in zip(self.targets, self.u95_mm, shares, strict=True)
        ]


def error_budget(
    result: JointResult,
    now: TagObservation,
    policy: Policy = Policy.FIXED,
    base_from_work: Array | None = None,
    systematic: Systematic | None = None,
) -> Budget:
    """Where the variance of every target's expected coordinate comes from, for a picture.

    Shares are of the trace of the position's covariance. Raises what `expected_by_joint` raises.
    """
    names = tuple(sorted(result.recording.facts.object.targets))
    per_target = []
    for name in names:
        made = predict(result, name, now, policy, base_from_work)
        per_target.append(_parts(result, made, now, systematic or Systematic()))
    links = tuple(per_target[0])
    traces = np.array([[np.trace(parts[link]) for link in links] for parts in per_target])
    radii = np.array([radius95(np.sum(list(parts.values()), axis=0)) for parts in per_target])
    return Budget(names, links, traces / traces.sum(axis=1, keepdims=True), radii)


def _parts(
    result: JointResult, made: Prediction, now: TagObservation, systematic: Systematic
) -> Mapping[str, Array]:
    """Covariance (3, 3) that every link causes; of the sensors, the tags' and touches' noise."""
    data, scale = result.data, result.variance_scale
    gain = _gain(result, made.by_unknowns)
    parts: dict[str, Array] = {}
    for link, count in data.counts.items():
        if count:
            K = gain[:, data.rows_of(link)]
            parts[link.value] = scale * K @ K.T
    unknown = made.by_unknowns @ result.undetermined
    parts[ARM] = _by_arm(result, made, gain)
    parts[PICTURE] = made.by_picture @ now.covariance @ made.by_picture.T
    parts[UNKNOWN] = unknown @ unknown.T
    parts.update(_systematic(result, made, gain, now, systematic))
    return parts


def _systematic(
    result: JointResult,
    made: Prediction,
    gain: Array,
    now: TagObservation,
    systematic: Systematic,
) -> dict[str, Array]:
    """Covariances of what all pictures share, and of time."""
    camera, facts = result.data.holes.camera, result.recording.facts
    a, b = facts.tag_a or facts.tag_b, facts.tag_b
    parts: dict[str, Array] = {}
    if systematic.intrinsics is not None:
        of_a, of_b = partial(_by_intrinsics, camera, a), partial(_by_intrinsics, camera, b)
        J = _by_pictures(result, made, gain, now, of_a, of_b)
        parts[INTRINSICS] = J @ systematic.intrinsics @ J.T
    if systematic.tag_size_sigma_mm > 0:
        variance = systematic.tag_size_sigma_mm**2
        J = _by_pictures(result, made, gain, now, partial(_by_size, a), _not_at_all)
        parts[PRINT_A] = variance * J @ J.T
        J = _by_pictures(result, made, gain, now, _not_at_all, partial(_by_size, b))
        parts[PRINT_B] = variance * J @ J.T
    if systematic.drift_mm > 0:
        parts[TIME] = systematic.drift_mm**2 * np.eye(3)
    return parts


def _gain(result: JointResult, by_unknowns: Array) -> Array:
    """How the answer moves, (3, r), with the residual of every measurement, sensors' sigmas."""
    scale = result.variance_scale
    gain = -by_unknowns @ (result.covariance / scale) @ result.jacobian.T
    k = len(result.arm_factor)
    if k:
        first = solve_triangular(result.arm_factor, gain[:, :k].T, lower=True, trans="T")
        gain = np.hstack([first.T, gain[:, k:]])
    return gain


def _by_arm(result: JointResult, made: Prediction, gain: Array) -> Array:
    out = made.by_arm @ made.arm_covariance @ made.by_arm.T
    k = len(result.arm_factor)
    if k:
        L = gain[:, :k] @ result.arm_factor
        out = out + result.variance_scale * (L @ L.T - gain[:, :k] @ gain[:, :k].T)
    return np.asarray(out)


Shift = Callable[[Pose], Array]


def _by_intrinsics(camera: CameraModel, spec: TagSpec, camera_from_tag: Pose) -> Array:
    """Tangent (6, 6) by which a tag is seen elsewhere when the intrinsics are off."""
    corners = _CORNERS * spec.size_mm
    by_pose = linearize_points(camera, camera_from_tag, corners)[1].reshape(-1, 6)
    by_intrinsics = camera.intrinsics_jacobian(camera_from_tag @ corners).reshape(-1, 6)
    return np.asarray(-np.linalg.pinv(by_pose) @ by_intrinsics)


def _by_size(spec: TagSpec, camera_from_tag: Pose) -> Array:
    """Tangent (6, 1) by which a tag is seen nearer when it is printed 1 mm larger."""
    return np.append(-camera_from_tag.translation / spec.size_mm, np.zeros(3))[:, None]


def _not_at_all(camera_from_tag: Pose) -> Array:
    del camera_from_tag
    return np.zeros((6, 1))


def _by_pictures(
    result: JointResult,
    made: Prediction,
    gain: Array,
    now: TagObservation,
    of_a: Shift,
    of_b: Shift,
) -> Array:
    """How the answer moves, (3, p), when every picture of a tag is shifted by `of_*` of its pose."""
    data = result.data
    total = made.by_picture @ of_b(now.camera_from_tag)
    for link, tags, shift in (
        (Link.HAND_EYE, data.looks.tags, of_a),
        (Link.REFERENCE, data.reference, of_b),
        (Link.SPINS, data.spins, of_b),
    ):
        if len(tags):
            shifts = np.array([shift(pose) for pose in tags.poses()])
            rows = (tags.whiteners @ shifts).reshape(6 * len(tags), -1)
            total = total - gain[:, data.rows_of(link)] @ rows
    return np.asarray(total)
