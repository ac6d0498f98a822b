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

    by_lens: (2n, k + 2) intrinsics and stretch; by_point: (n, 2, 3), of each pixel's own point,
    whose unknowns are `columns` (3n,) of the shared ones; by_pose: (2n, 6).
    """

    residuals: Array
    by_lens: Array
    by_point: Array
    by_pose: Array
    columns: NDArray[np.intp]

    def by_shared(self, step: Array) -> Array:
        """Change (2n,) of the residuals with a step of all shared unknowns."""
        moved = step[self.columns].reshape(-1, 3)
        change = self.by_lens @ step[: self.by_lens.shape[1]]
        return np.asarray(change + np.einsum("nij,nj->ni", self.by_point, moved).ravel())

    def reduce_into(self, S: Array, g: Array, damping: float = 0.0) -> Array:
        """Add this picture, its pose eliminated, to the normal equations; returns g."""
        lens = slice(0, self.by_lens.shape[1])
        n = len(self.by_point)
        blocks = np.einsum("nki,nkj->nij", self.by_point, self.by_point)
        mixed = self._points_times(self.by_lens).reshape(3 * n, -1)
        own = self.by_lens.T @ self.by_lens
        own[np.diag_indices_from(own)] *= 1 + damping
        blocks[:, range(3), range(3)] *= 1 + damping
        S[lens, lens] += own
        S[self.columns, lens] += mixed
        S[lens, self.columns] += mixed.T
        places = self.columns.reshape(n, 3)
        S[places[:, :, None], places[:, None, :]] += blocks
        W = np.zeros((len(S), 6))
        W[lens] = self.by_lens.T @ self.by_pose
        W[self.columns] = self._points_times(self.by_pose).reshape(3 * n, 6)
        V = self._information(damping)
        eliminated = np.linalg.solve(V, np.column_stack([W.T, self.by_pose.T @ self.residuals]))
        S -= W @ eliminated[:, :-1]
        g[lens] += self.by_lens.T @ self.residuals
        g[self.columns] += self._points_times(self.residuals[:, None]).ravel()
        g -= W @ eliminated[:, -1]
        return g

    def pose_step(self, step: Array, damping: float) -> Array:
        """Step (6,) of the pose, left tangent, that goes with a step of the shared unknowns."""
        off = self.residuals + self.by_shared(step)
        return np.asarray(-np.linalg.solve(self._information(damping), self.by_pose.T @ off))

    def _information(self, damping: float) -> Array:
        V = self.by_pose.T @ self.by_pose
        V[np.diag_indices_from(V)] *= 1 + damping
        return np.asarray(V)

    def _points_times(self, rows: Array) -> Array:
        """Derivative by the points, transposed, times rows (2n, c): (n, 3, c)."""
        mine = rows.reshape(len(self.by_point), 2, -1)
        return np.asarray(np.einsum("nki,nkc->nic", self.by_point, mine))


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
