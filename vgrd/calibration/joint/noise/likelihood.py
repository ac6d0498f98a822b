"""Restricted likelihood of levels of noise, most of which is a sample's own (`calibration.levels` has the equations).

The covariance of the residuals is S = D + F F^T: D has a block for every sample, F is what all of them share.
What is shared counts as unknowns of variance 1 (Harville 1977): with X = (J, F) and
N = X^T D^-1 X + (0, I) = L L^T, P = D^-1 - U U^T, U = D^-1 X L^-T. Nothing as large as all rows is inverted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from vgrd.calibration.levels import Levels, Slope, ascend
from vgrd.geometry import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One kind of noise at its stated level: rows (k,) move by factor (k, q) times q numbers of variance 1.

    sources: (k,), where the numbers of each row were drawn; None: all rows feel the same ones.
    """

    rows: Rows
    factor: Array
    sources: Rows | None

    @classmethod
    def independent(cls, rows: Rows) -> "Part":
        """Rows of variance 1."""
        return cls(rows, np.ones((len(rows), 1)), rows)


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Samples (m) of b rows each that feel the same kinds of noise.

    rows: where they stand; known: (m, b, b); own: the number of each kind and its covariance (m, b, b);
    roots: factors (m, b, q) of these.
    """

    rows: slice
    known: Array
    own: dict[int, Array]
    roots: dict[int, Array]

    def of(self, columns: Array) -> Array:
        """Their rows (m, b, p) of columns (r, p)."""
        return columns[self.rows].reshape(*self.known.shape[:2], -1)

    def whitener(self, sizes: Array) -> Array:
        """W (m, b, b) with W^T W the inverse of their own covariance."""
        covariance = self.known + sum(sizes[k] * C for k, C in self.own.items())
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


@dataclass(frozen=True, slots=True, eq=False)
class _Noise:
    """At given sizes: W of all samples, D^-1 = W^T W, U (r, p) and L^-1 (p, p)."""

    whiteners: Sequence[Array]
    U: Array
    L_inv: Array


class Restricted:
    """Residuals (r,) and derivative (r, n) of full rank, with their noise in parts.

    samples: (r,), the same number for rows of one sample, beyond which no noise of its own reaches. known:
    noise without a level, as parts with a factor each. At most one part is shared.
    """

    def __init__(
        self,
        residuals: Array,
        jacobian: Array,
        samples: Rows,
        parts: Sequence[Part],
        known: Sequence[tuple[float, Part]],
    ) -> None:
        order, self._samples = _grouped(samples, parts, known)
        self._residuals, self._jacobian = residuals[order], jacobian[order]
        self._count = len(parts)
        shared = [k for k, part in enumerate(parts) if part.sources is None]
        self._shared = shared[0] if shared else None
        self._factor = np.zeros((len(residuals), 0))
        if shared:
            part = parts[shared[0]]
            whole = np.zeros((len(residuals), part.factor.shape[1]))
            whole[part.rows] = part.factor
            self._factor = whole[order]

        self._sums = _Sums.none(self._count, jacobian.shape[1] + self._factor.shape[1])

    def find(self, prior_factors: Array, start: Array | None = None) -> Levels:
        """Most likely levels in the order of the parts; prior_factors, start: as of `find_levels`."""
        return ascend(self._slope, self._count, prior_factors, start)

    def variances(self, J: Array, sizes: Array) -> tuple[Array, Array]:
        """Of answers with derivative (a, 3, n): by every part (a, k), and in all (a,); mm^2."""
        n = self._jacobian.shape[1]
        noise = self._at(sizes)
        by = J @ noise.L_inv[:, :n].T
        gain = by @ noise.U.T
        parts = np.zeros((len(J), self._count))
        for samples in self._samples:
            m, b, _ = samples.known.shape
            own = gain[:, :, samples.rows].reshape(-1, m, b).transpose(1, 0, 2)
            for k, root in samples.roots.items():
                squares = np.sum((own @ root) ** 2, axis=(0, 2))
                parts[:, k] += sizes[k] * squares.reshape(len(J), -1).sum(axis=1)
        if self._shared is not None:
            shared = gain @ self._factor
            parts[:, self._shared] = sizes[self._shared] * np.sum(shared**2, axis=(1, 2))
        return parts, np.asarray(np.sum(by**2, axis=(1, 2)))

    def _at(self, sizes: Array) -> _Noise:
        scale = 1.0 if self._shared is None else np.sqrt(sizes[self._shared])
        X = np.hstack([self._jacobian, scale * self._factor])
        whiteners = [samples.whitener(sizes) for samples in self._samples]
        for samples, W in zip(self._samples, whiteners, strict=True):
            X[samples.rows] = (W @ samples.of(X)).reshape(-1, X.shape[1])
        N = X.T @ X
        ends = np.arange(self._jacobian.shape[1], len(N))
        N[ends, ends] += 1
        L = np.linalg.cholesky(N)
        L_inv = solve_triangular(L, np.eye(len(L)), lower=True, check_finite=False)
        U = X @ L_inv.T
        for samples, W in zip(self._samples, whiteners, strict=True):
            U[samples.rows] = (W.transpose(0, 2, 1) @ samples.of(U)).reshape(-1, U.shape[1])
        return _Noise(whiteners, U, L_inv)

    def _slope(self, log_variances: Array) -> Slope:
        """Of the likelihood: first what D^-1 alone gives, then what the unknowns take of it."""
        sizes = np.exp(log_variances)
        noise = self._at(sizes)
        sums = self._sums
        sums.clear()
        by_unknowns = noise.U.T @ self._residuals
        for samples, W in zip(self._samples, noise.whiteners, strict=True):
            U, r = samples.of(noise.U), samples.of(self._residuals)
            inverse = W.transpose(0, 2, 1) @ W
            pulled = inverse @ r - (U @ by_unknowns)[:, :, None]
            sums.add(samples, sizes, inverse, U, pulled)
        if self._shared is not None:
            sums.share(self._shared, noise.L_inv[:, self._jacobian.shape[1] :], by_unknowns)
        return sums.slope()


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums over samples, by kind (k): with D^-1 for P the terms of r^T P S_k P r, tr P S_k and so on.

    squares, traces: (k,); pulls, alike (k, k): r^T P S_k P S_l P r and tr P S_k P S_l; taken: U^T S_k P r
    (k, p); of_unknowns: U^T S_k U (k, p, p), part (p, p) one of its terms.
    """

    squares: Array
    traces: Array
    pulls: Array
    alike: Array
    taken: Array
    of_unknowns: Array
    part: Array

    @classmethod
    def none(cls, count: int, unknowns: int) -> "_Sums":
        """Nothing yet."""
        return cls(
            squares=np.zeros(count),
            traces=np.zeros(count),
            pulls=np.zeros((count, count)),
            alike=np.zeros((count, count)),
            taken=np.zeros((count, unknowns)),
            of_unknowns=np.zeros((count, unknowns, unknowns)),
            part=np.zeros((unknowns, unknowns)),
        )

    def clear(self) -> None:
        """Nothing again: memory of this size is slow to come by."""
        for sums in (self.squares, self.traces, self.pulls, self.alike, self.taken):
            sums.fill(0.0)
        self.of_unknowns.fill(0.0)

    def add(
        self, samples: _Samples, sizes: Array, inverse: Array, U: Array, pulled: Array
    ) -> None:
        """Samples with D^-1 (m, b, b), U (m, b, p) and P r (m, b, 1)."""
        S = {k: sizes[k] * C for k, C in samples.own.items()}
        moved = {k: S_k @ pulled for k, S_k in S.items()}
        weighed = {k: inverse @ S_k for k, S_k in S.items()}
        flat = U.reshape(-1, U.shape[2])
        outer = U @ U.transpose(0, 2, 1)
        for k, root in samples.roots.items():
            self.squares[k] += np.sum(pulled * moved[k])
            self.traces[k] += np.trace(weighed[k], axis1=1, axis2=2).sum()
            self.taken[k] += moved[k].reshape(-1) @ flat
            seen = (np.sqrt(sizes[k]) * root.transpose(0, 2, 1) @ U).reshape(-1, U.shape[2])
            self.of_unknowns[k] += np.matmul(seen.T, seen, out=self.part)
            pull, both = inverse @ moved[k], weighed[k] - 2 * (outer @ S[k])
            for j in samples.own:
                self.pulls[k, j] += np.sum(pull * moved[j])
                self.alike[k, j] += np.sum(both * np.swapaxes(weighed[j], 1, 2))

    def share(self, k: int, K: Array, by_unknowns: Array) -> None:
        """What all samples share, F F^T: F^T P r = K^T U^T r, F^T P F = I - K^T K, P F = U K."""
        pull = K.T @ by_unknowns
        self.squares[k] = self.pulls[k, k] = pull @ pull
        self.traces[k] = K.shape[1]
        self.taken[k] = -K @ pull
        self.of_unknowns[k] = K @ K.T
        self.alike[k, k] = K.shape[1] - 2 * np.trace(self.of_unknowns[k])

    def slope(self) -> Slope:
        """With what the unknowns take up."""
        traces = self.traces - np.trace(self.of_unknowns, axis1=1, axis2=2)
        pulls = self.pulls - self.taken @ self.taken.T
        flat = self.of_unknowns.reshape(len(traces), -1)
        information = 0.5 * (self.alike + flat @ flat.T)
        score = 0.5 * (self.squares - traces)
        return Slope(score, information, pulls - information - np.diag(score))


def _grouped(
    samples: Rows, parts: Sequence[Part], known: Sequence[tuple[float, Part]]
) -> tuple[Rows, list[_Samples]]:
    """Order of the rows in which samples that feel the same kinds stand together, and these."""
    names, of_row, widths = np.unique(samples, return_inverse=True, return_counts=True)
    own = [(k, part) for k, part in enumerate(parts) if part.sources is not None]
    feels = np.zeros((len(names), len(parts)), dtype=np.intp)
    for k, part in own:
        feels[of_row[part.rows], k] = 1
    alike = np.unique(np.column_stack([widths, feels]), axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((of_row, alike[of_row]))
    covariances = [(k, _OfSamples(part, order)) for k, part in own]
    others = [(sign, _OfSamples(part, order)) for sign, part in known]
    groups, first = [], 0
    for group in range(alike.max() + 1):
        members = np.flatnonzero(alike == group)
        width = widths[members[0]]
        rows = slice(first, first + width * len(members))
        first = rows.stop
        known_own = sum((sign * C.of(rows, width) for sign, C in others), np.zeros((1, 1, 1)))
        felt = {k: C for k, C in covariances if feels[members[0], k]}
        its = {k: C.of(rows, width) for k, C in felt.items()}
        roots = {k: C.root(rows, width) for k, C in felt.items()}
        groups.append(_Samples(rows, known_own, its, roots))
    return order, groups


class _OfSamples:
    """Covariance of a part, sample by sample; rows in the order given."""

    def __init__(self, part: Part, order: Rows) -> None:
        factor = np.zeros((len(order), part.factor.shape[1]))
        sources = np.full(len(order), -1, dtype=np.intp)
        factor[part.rows] = part.factor
        sources[part.rows] = part.rows if part.sources is None else part.sources
        self._factor, self._sources = factor[order], sources[order]

    def of(self, rows: slice, width: int) -> Array:
        """(m, b, b) of samples of b = `width` rows."""
        F, same = self._factor_of(rows, width)
        return np.asarray(F @ np.swapaxes(F, 1, 2) * same)

    def root(self, rows: slice, width: int) -> Array:
        """Factors (m, b, q) of the same."""
        F, same = self._factor_of(rows, width)
        if same.all():
            return F
        if F.shape[2] == 1 and np.array_equal(same, np.broadcast_to(np.eye(width), same.shape)):
            return F * np.eye(width)
        values, vectors = np.linalg.eigh(F @ np.swapaxes(F, 1, 2) * same)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])

    def _factor_of(self, rows: slice, width: int) -> tuple[Array, NDArray[np.bool_]]:
        """Factors (m, b, q) as if of one source, and which rows (m, b, b) have the same."""
        F = self._factor[rows].reshape(-1, width, self._factor.shape[1])
        sources = self._sources[rows].reshape(-1, width)
        return F, sources[:, :, None] == sources[:, None, :]
