"""What samples say of the pose of their target, in few rows each: poses as they are, pixels condensed.

A sample's rows are `D u + E x + r` in units of one pixel or of (mm, rad): u = (t - t_0, log R R_0^T) tells the
predicted pose of the target from a reference near its own, x are the unknowns beside the two poses. Pixels
are turned by an orthogonal matrix (QR), so that the first six rows hold all that is said of the pose.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from vgrd.calibration.hand_eye.state import HandEye
from vgrd.errors import DidNotConverge, InputError
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel

_ON_DIAGONAL = 1 + 1e-9 * np.eye(6)  # keeps four points that hardly tell a pose from singularity
_OWN_STEPS = (
    2  # of Gauss-Newton towards the own pose under a new camera: any reference near it will do
)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """All samples at one state: rotations (n, 3, 3) and translations (n, 3) of the reference poses.

    D: (n, q, 6), whose rows beyond six are zero; r: (n, q); E: (n, q, k). white_squares: sum of the squares,
    px^2, that every picture's own pose leaves, of `white_freedom` degrees of freedom; 0 for poses.
    """

    rotations: Array
    translations: Array
    D: Array
    r: Array
    E: Array
    white_squares: float = 0.0
    white_freedom: float = 0.0


class Evidence(ABC):
    """The samples of a fit."""

    @abstractmethod
    def at(self, state: HandEye) -> Rows:
        """Rows for the camera, scale and points of a state."""

    def rms_px(self, state: HandEye, predicted: Sequence[Pose]) -> list[float]:
        """Reprojection error of every sample at predicted poses; NaN where it holds no pixels."""
        del state
        return [float("nan")] * len(predicted)

    @abstractmethod
    def chosen(self, indices: Sequence[int]) -> "Evidence":
        """Some of the samples."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseEvidence(Evidence):
    """Poses of the target as somebody measured them, camera_from_target."""

    cameras: Sequence[Pose]

    def at(self, state: HandEye) -> Rows:
        """A target that is larger than assumed was measured too near by the same factor."""
        n = len(self.cameras)
        t = np.array([pose.translation for pose in self.cameras]) * state.scale
        E = np.zeros((n, 6, state.extra))
        if state.refines_scale:
            E[:, :3, -1] = -t
        D = np.broadcast_to(np.eye(6), (n, 6, 6))
        return Rows(np.array([p.rotation for p in self.cameras]), t, D, np.zeros((n, 6)), E)

    def chosen(self, indices: Sequence[int]) -> "PoseEvidence":
        """Some of the samples."""
        return PoseEvidence([self.cameras[i] for i in indices])


@dataclass(frozen=True, eq=False)
class PointEvidence(Evidence):
    """Pictures of known points: (m, 3) mm and pixels (m, 2) of each, and its own pose under `camera`.

    features: pixels (2,) by name, of the points that the state holds in the order of `places`.
    """

    camera: CameraModel
    points: Sequence[Array]
    pixels: Sequence[Array]
    cameras: Sequence[Pose]
    features: Sequence[Mapping[str, Array]]
    places: Sequence[str] = ()

    def chosen(self, indices: Sequence[int]) -> "PointEvidence":
        """Some of the samples."""
        return PointEvidence(
            self.camera,
            [self.points[i] for i in indices],
            [self.pixels[i] for i in indices],
            [self.cameras[i] for i in indices],
            [self.features[i] for i in indices],
            self.places,
        )

    def at(self, state: HandEye) -> Rows:
        """The rows of every picture; references follow the camera and the size of the target."""
        if not state.extra and state.camera is self.camera and state.scale == 1:
            return self._as_given
        return self._at(state)

    @cached_property
    def _as_given(self) -> Rows:
        return self._at(HandEye(camera=self.camera))

    def _at(self, state: HandEye) -> Rows:
        R = np.array([pose.rotation for pose in self.cameras])
        t = np.array([pose.translation for pose in self.cameras]) * state.scale
        for _ in range(_OWN_STEPS * state.refines_camera):
            r, D, _ = self._linearized(R, t, state, places=())
            if not np.isfinite(D).all():
                raise DidNotConverge("hand-eye: no camera or pose near by shows the target")
            normal = np.einsum("nmi,nmj->nij", D, D) * _ON_DIAGONAL
            step = -np.linalg.solve(normal, np.einsum("nmi,nm->ni", D, r)[:, :, None])[:, :, 0]
            t = t + step[:, :3]
            R = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ R
        r, D, E = self._linearized(R, t, state, places=self.places)
        if not (np.isfinite(D).all() and np.isfinite(E).all()):
            raise DidNotConverge("hand-eye: no camera or pose near by shows the target")
        D, r, E, squares = _condensed(r, D, E)
        freedom = sum(pixels.size - 6 for pixels in self.pixels) - 6 * state.refines_camera
        return Rows(R, t, D, r, E, squares, max(float(freedom), 1.0))

    def rms_px(self, state: HandEye, predicted: Sequence[Pose]) -> list[float]:
        """Reprojection error of the target's points, of one coordinate."""
        if state.camera is None:
            raise InputError("points need a camera model")
        errors = []
        for points, pixels, pose in zip(self.points, self.pixels, predicted, strict=True):
            off = state.camera.project(pose @ (points * state.scale)) - pixels
            errors.append(float(np.sqrt(np.mean(off**2))))
        return errors

    @cached_property
    def _padded(self) -> tuple[Array, Array, Array]:
        """Points (n, m, 3), pixels (n, m, 2), is there (n, m): features last, one column each."""
        n, m = len(self.points), max(len(points) for points in self.points)
        points, pixels = np.zeros((n, m, 3)), np.zeros((n, m + len(self.places), 2))
        there = np.zeros((n, m + len(self.places)))
        for i, (own, seen) in enumerate(zip(self.points, self.pixels, strict=True)):
            points[i, : len(own)], points[i, len(own) :] = own, own[0]
            pixels[i, : len(own)], there[i, : len(own)] = seen, 1.0
            for k, name in enumerate(self.places, m):
                if name in self.features[i]:
                    pixels[i, k], there[i, k] = self.features[i][name], 1.0
        return points, pixels, there

    def _linearized(
        self, R: Array, t: Array, state: HandEye, *, places: Sequence[str]
    ) -> tuple[Array, Array, Array]:
        """Residuals (n, 2 m), derivatives (n, 2 m, 6) and (n, 2 m, extra) of every picture."""
        if state.camera is None:
            raise InputError("points need a camera model")
        points, pixels, there = self._padded
        n, own = points.shape[:2]
        m = own + len(places)
        features = np.broadcast_to(state.points[: len(places)], (n, len(places), 3))
        everything = np.concatenate([points * state.scale, features], axis=1)
        arms = np.einsum("nmj,nij->nmi", everything, R)
        q = (arms + t[:, None]).reshape(-1, 3)
        predicted, by_point = state.camera.linearize(q)
        J = by_point.reshape(n, m, 2, 3)
        D = np.concatenate([J, -J @ hat(arms)], axis=3)
        E = np.zeros((n, m, 2, state.extra))
        if state.refines_camera:
            E[..., :6] = state.camera.intrinsics_jacobian(q).reshape(n, m, 2, 6)
        if state.refines_scale:
            E[:, :own, :, -1] = np.einsum("nmij,nmj->nmi", J[:, :own], arms[:, :own])
        for k in range(len(places)):
            column = state.point_columns.start - 12 + 3 * k
            E[:, own + k, :, column : column + 3] = J[:, own + k] @ R
        there = there[:, :m, None]
        r = (predicted.reshape(n, m, 2) - pixels[:, :m]) * there
        D, E = D * there[..., None], E * there[..., None]
        return r.reshape(n, 2 * m), D.reshape(n, 2 * m, 6), E.reshape(n, 2 * m, state.extra)


def _condensed(r: Array, D: Array, E: Array) -> tuple[Array, Array, Array, float]:
    """D (n, q, 6), r (n, q), E (n, q, extra) by orthogonal turns of the rows, and what own poses leave.

    Turning rows changes no least squares; what is left of r beyond q rows depends on no unknown.
    """
    n, extra = len(r), E.shape[2]
    q = 6 + extra
    R = np.asarray(np.linalg.qr(np.concatenate([D, E, r[:, :, None]], axis=2), mode="r"))
    full = np.zeros((n, q + 1, q + 1))
    full[:, : R.shape[1]] = R
    left = float(np.sum(full[:, 6:, -1] ** 2))
    return full[:, :q, :6], full[:, :q, -1], full[:, :q, 6:q], left
