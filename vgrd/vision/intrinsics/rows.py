"""One picture of the bundle adjustment, linearized, and how its pose is eliminated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from vgrd.errors import NotObservable
from vgrd.geometry import Array


@dataclass(frozen=True, slots=True, eq=False)
class PictureRows:
    """One picture linearized, in sigmas: residuals (2n,) and their derivatives.

    J_lens: (2n, k + 2) intrinsics and stretch; J_point: (n, 2, 3), of each pixel's own point,
    whose unknowns are `columns` (3n,) of the shared ones; J_pose: (2n, 6).
    """

    residuals: Array
    J_lens: Array
    J_point: Array
    J_pose: Array
    columns: NDArray[np.intp]

    def residual_change(self, step: Array) -> Array:
        """Change (2n,) of the residuals with a step of all shared unknowns."""
        shifts = step[self.columns].reshape(-1, 3)
        change = self.J_lens @ step[: self.J_lens.shape[1]]
        return np.asarray(change + np.einsum("nij,nj->ni", self.J_point, shifts).ravel())

    def reduce_into(self, S: Array, g: Array, damping: float = 0.0) -> Array:
        """Add this picture, its pose eliminated, to the normal equations; returns g."""
        lens = slice(0, self.J_lens.shape[1])
        n = len(self.J_point)
        blocks = np.einsum("nki,nkj->nij", self.J_point, self.J_point)
        mixed = self._points_times(self.J_lens).reshape(3 * n, -1)
        information = self.J_lens.T @ self.J_lens
        information[np.diag_indices_from(information)] *= 1 + damping
        blocks[:, range(3), range(3)] *= 1 + damping
        S[lens, lens] += information
        S[self.columns, lens] += mixed
        S[lens, self.columns] += mixed.T
        places = self.columns.reshape(n, 3)
        S[places[:, :, None], places[:, None, :]] += blocks
        W = np.zeros((len(S), 6))
        W[lens] = self.J_lens.T @ self.J_pose
        W[self.columns] = self._points_times(self.J_pose).reshape(3 * n, 6)
        V = self._information(damping)
        eliminated = np.linalg.solve(V, np.column_stack([W.T, self.J_pose.T @ self.residuals]))
        S -= W @ eliminated[:, :-1]
        g[lens] += self.J_lens.T @ self.residuals
        g[self.columns] += self._points_times(self.residuals[:, None]).ravel()
        g -= W @ eliminated[:, -1]
        return g

    def pose_step(self, step: Array, damping: float) -> Array:
        """Step (6,) of the pose, left tangent, that goes with a step of the shared unknowns."""
        residuals = self.residuals + self.residual_change(step)
        return np.asarray(-np.linalg.solve(self._information(damping), self.J_pose.T @ residuals))

    def _information(self, damping: float) -> Array:
        V = self.J_pose.T @ self.J_pose
        V[np.diag_indices_from(V)] *= 1 + damping
        return np.asarray(V)

    def _points_times(self, rows: Array) -> Array:
        """Derivative by the points, transposed, times rows (2n, c): (n, 3, c)."""
        blocks = rows.reshape(len(self.J_point), 2, -1)
        return np.asarray(np.einsum("nki,nkc->nic", self.J_point, blocks))


def solved(S: Array, g: Array) -> Array:
    """Solution (n,) or (n, m) of symmetric normal equations; NotObservable when they are singular."""
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    try:
        factor = cho_factor(S * np.outer(scale, scale), check_finite=False)
    except np.linalg.LinAlgError as error:
        raise NotObservable(
            "the pictures leave the intrinsics undetermined: tilt the board by 20 to 40 degrees "
            "in several directions",
            rank=0,
            unknowns=len(S),
        ) from error
    columns = g if g.ndim == 2 else g[:, None]
    x = scale[:, None] * cho_solve(factor, scale[:, None] * columns, check_finite=False)
    return np.asarray(x.reshape(g.shape))


def inverse(S: Array) -> Array:
    """Covariance of the unknowns of normal equations."""
    return solved(S, np.eye(len(S)))
