"""Certified start of hand-eye calibration: the best of all rotations, with proof.

Cost: `sum |M_i^-1 X C_i - Y|^2` over rotation and translation, each in units of its sigma, with
C_i = camera_from_target and M_i as in `vgrd.calibration.hand_eye.pose_pairs`. With Y any 3 x 4 matrix, Y and
t_X are linear; eliminated, they leave a quadratic in the nine numbers of R_X, which Shor's
relaxation solves (`vgrd.geometry.rotation_relaxation`). The only thing given up is that the
rotation of Y is orthonormal, which the data say anyway.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose, exp_rotation, hat, nearest_rotation
from vgrd.geometry.least_squares import minimize
from vgrd.geometry.rotation_relaxation import Certificate, prove, relax

_GENERATORS = hat(np.eye(3))
_RANK = 1e-9  # of the largest singular value: rounding
_NOTHING = np.zeros((0, 6))


@dataclass(frozen=True, slots=True, eq=False)
class CertifiedStart:
    """X and Y of `cameras[i] ~ X^-1 moves[i] Y` at the lowest cost; chi2 of that cost."""

    X: Pose
    Y: Pose
    certificate: Certificate
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class RotationCost:
    """Cost of a rotation X: `|root @ (vec R_X, 1)|^2`, rows of R_X one after the other.

    null_space: (k, 6), as of `certified_start`.
    """

    root: Array
    flange_motions: Sequence[Pose]
    cameras: Sequence[Pose]
    null_space: Array

    def __call__(self, R: Array) -> float:
        """Cost of a rotation (3, 3)."""
        r = self.root @ np.append(R.ravel(), 1.0)
        return float(r @ r)

    def descend(self, R: Array) -> Array:
        """The local minimum (3, 3) near a rotation."""

        def linearize(R: Array) -> tuple[Array, Array]:
            r = self.root @ np.append(R.ravel(), 1.0)
            return r, self.root[:, :9] @ (_GENERATORS @ R).reshape(3, 9).T

        minimum = minimize(linearize, lambda R, step: exp_rotation(step) @ R, R)
        return nearest_rotation(minimum.state)

    def poses(self, R_X: Array) -> tuple[Pose, Pose]:
        """X, Y for a rotation of X."""
        R_Mt = np.array([move.rotation.T for move in self.flange_motions])
        t_M = np.array([move.translation for move in self.flange_motions])
        R_C = np.array([camera.rotation for camera in self.cameras])
        t_C = np.array([camera.translation for camera in self.cameras])
        R_Y = nearest_rotation((R_Mt @ R_X @ R_C).mean(axis=0), tolerance=np.inf)
        rows = _without(translation_rows(R_Mt), self.null_space)
        right = np.einsum("nij,nj->ni", R_Mt, t_M - t_C @ R_X.T).ravel()
        t = np.linalg.lstsq(rows, right, rcond=_RANK)[0]
        return Pose(R_X, t[:3]), Pose(R_Y, t[3:])


def rotation_cost(
    flange_motions: Sequence[Pose],
    cameras: Sequence[Pose],
    *,
    sigma_mm: float,
    sigma_rad: float,
    null_space: Array = _NOTHING,
) -> RotationCost:
    """The cost of a rotation with all that is linear eliminated; sigmas of one camera pose."""
    n = len(flange_motions)
    R_Mt = np.array([move.rotation.T for move in flange_motions])
    t_M = np.array([move.translation for move in flange_motions])
    R_C = np.array([camera.rotation for camera in cameras])
    t_C = np.array([camera.translation for camera in cameras])
    products = np.einsum("nij,nkl->niljk", R_Mt, R_C).reshape(n, 9, 9)
    products = (products - products.mean(axis=0)) / (np.sqrt(2) * sigma_rad)
    carried = np.einsum("nij,nk->nijk", R_Mt, t_C).reshape(n, 3, 9)
    offset = -np.einsum("nij,nj->ni", R_Mt, t_M)[:, :, None]
    shifted = np.concatenate([carried, offset], axis=2).reshape(3 * n, 10)
    U, s, _ = np.linalg.svd(_without(translation_rows(R_Mt), null_space), full_matrices=False)
    U = U[:, s > _RANK * s[0]]
    shifted = (shifted - U @ (U.T @ shifted)) / sigma_mm
    rotated = np.concatenate([products.reshape(9 * n, 9), np.zeros((9 * n, 1))], axis=1)
    root = np.linalg.qr(np.concatenate([rotated, shifted]), mode="r")
    return RotationCost(np.asarray(root), flange_motions, cameras, null_space)


def translation_rows(R_Mt: Array) -> Array:
    """Rows (3 n, 6) of (t_X, t_Y) in `R_M^T t_X - t_Y`."""
    return np.concatenate([R_Mt, np.broadcast_to(-np.eye(3), R_Mt.shape)], axis=2).reshape(-1, 6)


def _without(rows: Array, null_space: Array) -> Array:
    """The rows with no part along orthonormal directions (k, 6)."""
    return np.asarray(rows - rows @ null_space.T @ null_space)


def certified_start(
    flange_motions: Sequence[Pose],
    cameras: Sequence[Pose],
    *,
    sigma_mm: float,
    sigma_rad: float,
    null_space: Array = _NOTHING,
) -> CertifiedStart:
    """The best rotation of all and the poses that go with it; works for one axis of rotation too.

    sigma_mm, sigma_rad: of one camera pose, per axis; only their ratio matters for the poses. free:
    (k, 6), what the motion leaves open of (t_X, t_Y), orthonormal rows; X and Y have no part along
    it. The caller makes sure that the motion determines a rotation.
    """
    cost = rotation_cost(
        flange_motions, cameras, sigma_mm=sigma_mm, sigma_rad=sigma_rad, null_space=null_space
    )
    C = cost.root.T @ cost.root
    relaxed = relax(C)
    R_X = cost.descend(relaxed.rotation)
    return CertifiedStart(*cost.poses(R_X), prove(C, R_X, relaxed.slack), cost(R_X))
