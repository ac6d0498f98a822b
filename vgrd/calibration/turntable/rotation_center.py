"""Rotation centre of a turning object from pictures of its tag (paper section V, Eq. 20-25).

Eq. 25 is rank deficient for every real turntable: all turns share the axis, so the point is free
along it and noise decides. Here the axis is found, and the point on it is chosen: nearest to the
tag, or at a given height. The constant of Eq. 20 is estimated too instead of taking picture 1 as
free of error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import sqrt_information

_ROUNDS = 3  # weights depend on the centre a little
_NOT_TURNED = np.radians(2.0)  # rms about a second axis: a tag's own noise


@dataclass(frozen=True, slots=True, eq=False)
class RotationCenter:
    """A point of the axis and the axis, in the tag's frame and in the camera's; mm.

    covariance: (6, 6) of (center_in_tag, center_in_camera), across the axis only. residuals_mm:
    (n, 3), camera frame. spread_rad: rms turn about the axis; wobble_rad: rms tilt of the axis.
    """

    center_in_tag: Array
    axis_in_tag: Array
    center_in_camera: Array
    axis_in_camera: Array
    covariance: Array
    residuals_mm: Array
    scores: Array
    spread_rad: float
    wobble_rad: float

    def at_height(self, center_in_camera: Array) -> tuple[Array, Array]:
        """(center_in_tag, center_in_camera) of the point of the axis nearest to the given one."""
        height = float(self.axis_in_camera @ (center_in_camera - self.center_in_camera))
        return (
            self.center_in_tag + height * self.axis_in_tag,
            self.center_in_camera + height * self.axis_in_camera,
        )


def find_rotation_center(
    camera_from_tag: Sequence[Pose], covariances: Sequence[Array] | None = None
) -> RotationCenter:
    """Axis and centre from pictures of the tag while the object turns, the camera at rest.

    covariances: (6, 6) each, left tangents; None weighs all pictures and directions alike. Raises
    TooFewObservations below 3 pictures and NotObservable when the object was not turned.
    """
    R, t = _arrays(camera_from_tag)
    if covariances is not None and len(covariances) != len(R):
        raise InputError("as many covariances as pictures are needed")
    axis_tag, axis_camera, spread, wobble = _axis(R)
    A = np.concatenate([R, np.broadcast_to(-np.eye(3), R.shape)], axis=2)
    free = np.concatenate([axis_tag, axis_camera])
    x = np.zeros(6)
    for _ in range(_ROUNDS if covariances is not None else 1):
        W = _whiteners(R, x, covariances)
        rows = (W @ A).reshape(-1, 6)
        right = -np.einsum("nij,nj->ni", W, t).ravel()
        x, C = _solve_across(rows, right, free)
        to_tag = np.eye(6) - np.outer(free, np.concatenate([axis_tag, np.zeros(3)]))
        x, C = to_tag @ x, to_tag @ C @ to_tag.T
    e = R @ x[:3] + t - x[3:]
    whitened = np.einsum("nij,nj->ni", W, e)
    if covariances is None:
        C = C * float(np.sum(e * e)) / max(e.size - 5, 1)
    return RotationCenter(
        center_in_tag=x[:3],
        axis_in_tag=axis_tag,
        center_in_camera=x[3:],
        axis_in_camera=axis_camera,
        covariance=C,
        residuals_mm=e,
        scores=np.linalg.norm(whitened, axis=1),
        spread_rad=spread,
        wobble_rad=wobble,
    )


def _arrays(poses: Sequence[Pose]) -> tuple[Array, Array]:
    if len(poses) < 3:
        raise TooFewObservations(
            f"a rotation centre needs at least 3 pictures of the turned object, got {len(poses)}"
        )
    return (
        np.array([pose.rotation for pose in poses]),
        np.array([pose.translation for pose in poses]),
    )


def _axis(R: Array) -> tuple[Array, Array, float, float]:
    """Axis in tag and camera, rms turn and rms tilt, rad; NotObservable when nothing turned."""
    mean = R.mean(axis=0)
    deviations = (R - mean).reshape(-1, 3)
    _, s, Vt = np.linalg.svd(deviations)
    spread = s / np.sqrt(len(R))
    if spread[1] < _NOT_TURNED:
        raise NotObservable(
            f"the object was turned by {np.degrees(spread[0]):.1f} degrees rms only: "
            "turn it by a third of a turn or more between the pictures",
            rank=3,
            unknowns=5,
        )
    axis = Vt[2]
    in_camera = mean @ axis
    return axis, in_camera / np.linalg.norm(in_camera), float(spread[1]), float(spread[2])


def _whiteners(R: Array, x: Array, covariances: Sequence[Array] | None) -> Array:
    """Whiteners (n, 3, 3) of where each picture sees the centre."""
    if covariances is None:
        return np.broadcast_to(np.eye(3), R.shape)
    lever = hat(np.broadcast_to(x[3:], (len(R), 3)))
    G = np.concatenate([np.broadcast_to(np.eye(3), R.shape), -lever], axis=2)
    return sqrt_information(G @ np.asarray(covariances) @ np.swapaxes(G, 1, 2))


def _solve_across(rows: Array, right: Array, free: Array) -> tuple[Array, Array]:
    """Least squares without the direction `free`, truncated; solution (6,) and covariance (6, 6)."""
    direction = free / np.linalg.norm(free)
    basis = np.linalg.svd(direction[None])[2][1:].T
    U, s, Vt = np.linalg.svd(rows @ basis, full_matrices=False)
    half = basis @ (Vt.T / s)
    return half @ (U.T @ right), half @ half.T
