"""Bad samples of the joint estimate: found by robust weights, confirmed by leaving them out.

Every kind of sample is searched by itself, worst kind first, so that an operator who touches less
precisely than told does not lend tolerance to the pictures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.linalg import solve_triangular

from vgrd.calibration.joint.fit import JointFit, JointSample, determined_span, fit_joint
from vgrd.calibration.joint.problem import SAMPLED, EvidenceKind, JointData, renumbered
from vgrd.calibration.joint.rows import touched_places
from vgrd.calibration.joint.state import JointState, layout_of
from vgrd.calibration.observability import fit_without_outliers
from vgrd.calibration.touches import TouchSet, equivalent_sigmas
from vgrd.geometry import Array
from vgrd.judging.thresholds import OUTLIER_SIGMA, PICTURE_SIGMA

_SWEEPS = 3  # over the kinds: the second one confirms the first
_LEVERAGE_FLOOR = 1e-9  # of a share between 0 and 1: rounding
_TOLD = 0.02  # what is told to people: below it the touch is alone, and its miss would be 50 times its residual

Weights = Mapping[EvidenceKind, Array]


@dataclass(frozen=True, slots=True, eq=False)
class KindFit:
    """How the n samples of one kind fit: whitened (n, k), scores (n,), redundancy of the kind."""

    whitened: Array
    scores: Array
    degrees_of_freedom: int


@dataclass(frozen=True, slots=True)
class TouchMiss:
    """One touch, mm: off_mm from what it touched by the fit, left_out_mm from where the others put it.

    Both are along what it measured, None for one that was left out; reason: why it was, else "".
    """

    name: str
    off_mm: float | None
    left_out_mm: float | None
    reason: str


def screen(data: JointData, optimum: JointFit) -> JointFit:
    """The fit without what the other samples contradict, with a verdict on every sample.

    optimum: of all of `data`, as gathered. At most a third of each kind is left out.
    """
    search = _Screening(data, optimum)
    search.run()
    return replace(search.optimum, samples=search.samples())


def touches_left_out(optimum: JointFit, told: float = _LEVERAGE_FLOOR) -> Array:
    """How far each touch (m,) was from where the others put it, mm, in the directions that it measured.

    told: a direction of which the others tell a smaller share is left out.
    """
    _, residual_precision, residuals = _Deleted(optimum).of(EvidenceKind.TOUCHES)
    off = np.linalg.pinv(residual_precision, rcond=told, hermitian=True)
    W_inv = np.linalg.pinv(optimum.data.touches.base_sqrt_informations())
    misses = np.einsum("nij,njk,nk->ni", W_inv, off, residuals)
    return np.asarray(np.linalg.norm(misses, axis=1))


def touch_misses(optimum: JointFit) -> tuple[TouchMiss, ...]:
    """Every touch of the object, those that were left out too."""
    rows = optimum.data.rows_of(EvidenceKind.TOUCHES)
    whitened = optimum.whitened[rows].reshape(-1, SAMPLED[EvidenceKind.TOUCHES])
    W_inv = np.linalg.pinv(optimum.data.touches.base_sqrt_informations())
    off_mm = np.linalg.norm(np.einsum("nij,nj->ni", W_inv, whitened), axis=1)
    names = optimum.data.names[EvidenceKind.TOUCHES]
    off = dict(zip(names, off_mm.tolist(), strict=True))
    left_out = dict(zip(names, touches_left_out(optimum, _TOLD).tolist(), strict=True))
    return tuple(
        TouchMiss(sample.name, off.get(sample.name), left_out.get(sample.name), sample.reason)
        for sample in optimum.samples
        if sample.kind == EvidenceKind.TOUCHES.value
    )


def leave_one_out(optimum: JointFit) -> dict[EvidenceKind, KindFit]:
    """Every sample against all others: squared deleted residuals, noise of the arm included."""
    deleted = _Deleted(optimum)
    return {link: _kind_fit(*deleted.of(link), _blind(optimum.data, link)) for link in SAMPLED}


class _Deleted:
    """Residuals of a fit, weighted by the noise, and what of it the unknowns take up."""

    def __init__(self, optimum: JointFit) -> None:
        self._data = optimum.data
        factor, k = optimum.arm_factor, len(optimum.arm_factor)
        U = determined_span(optimum.jacobian, optimum.layout)
        residuals = optimum.whitened - U @ (U.T @ optimum.whitened)
        self._by_arm = np.zeros((0, 0))
        if k:
            self._by_arm = solve_triangular(factor, np.eye(k), lower=True)
            U = np.vstack([self._by_arm.T @ U[:k], U[k:]])
            residuals = np.concatenate([self._by_arm.T @ residuals[:k], residuals[k:]])
        self._U, self._residuals = U, residuals

    def of(self, link: EvidenceKind) -> tuple[Array, Array, Array]:
        """Precision (n, k, k) of every sample's rows, what the fit leaves of it, residuals (n, k)."""
        rows = np.arange(len(self._U))[self._data.rows_of(link)].reshape(-1, SAMPLED[link])
        block = np.broadcast_to(np.eye(SAMPLED[link]), (len(rows), SAMPLED[link], SAMPLED[link]))
        if rows.size and rows.max() < len(self._by_arm):
            columns = self._by_arm.T[rows]
            block = columns @ columns.transpose(0, 2, 1)
        taken_up = self._U[rows] @ self._U[rows].transpose(0, 2, 1)
        return block, block - taken_up, self._residuals[rows]


def _kind_fit(block: Array, residual_precision: Array, residuals: Array, blind: Array) -> KindFit:
    """block, residual_precision (n, k, k): of the rows, and what the fit leaves; blind (n,) rows."""
    C_inv = np.linalg.inv(np.linalg.cholesky(block))
    whitened = np.einsum("nij,nj->ni", C_inv, residuals)
    values, vectors = np.linalg.eigh(C_inv @ residual_precision @ C_inv.transpose(0, 2, 1))
    parts = np.einsum("nji,nj->ni", vectors, whitened)
    measured = values > _LEVERAGE_FLOOR
    squares = np.sum(parts**2 / np.where(measured, values, np.inf), axis=1)
    scores = equivalent_sigmas(squares, measured.sum(axis=1) - blind)
    return KindFit(whitened, scores, round(float(values.sum() - blind.sum())))


def _blind(data: JointData, link: EvidenceKind) -> Array:
    """Rows of every sample that measure nothing."""
    touch_sets: Mapping[EvidenceKind, TouchSet] = {
        EvidenceKind.TOUCHES: data.touches,
        EvidenceKind.POINTS: data.points,
    }
    if link not in touch_sets:
        return np.zeros(len(data.names[link]), dtype=np.intp)
    lateral = np.isinf(touch_sets[link].lateral_sigma_mm)
    return np.asarray(2 * lateral + np.isinf(touch_sets[link].axial_sigma_mm))


class _Screening:
    """Which samples are in use, and the fit of these."""

    def __init__(self, data: JointData, optimum: JointFit) -> None:
        self._data = data
        self._all = optimum
        self.optimum = optimum
        self._weights = {link: np.ones(len(data.names[link])) for link in SAMPLED}
        fits = leave_one_out(optimum)
        self._scores = {link: fit.scores.copy() for link, fit in fits.items()}
        self._solved = {_key(self._weights): (optimum, fits)}

    def run(self) -> None:
        for _ in range(_SWEEPS):
            previous = dict(self._weights)
            for link in sorted(SAMPLED, key=self._worst):
                if -self._worst(link) > _limit(link):
                    self._search(link)
            if all(np.array_equal(previous[link], self._weights[link]) for link in SAMPLED):
                return

    def samples(self) -> tuple[JointSample, ...]:
        samples = []
        misses_mm, weights = (
            _misses_mm(self._data, self.optimum.state, self._weights[EvidenceKind.SPINS]),
            self._data.in_use(self._weights),
        )
        for link in SAMPLED:
            for i, name in enumerate(self._data.names[link]):
                used, score = bool(weights[link][i]), float(self._scores[link][i])
                mm = f"{misses_mm[link][i]:.2f} mm, " if link in misses_mm else ""
                reason = "" if used else f"{mm}{score:.1f} sigma off what the others say"
                if self._weights[link][i] > weights[link][i]:
                    reason = "as the turn of the object in its picture was"
                samples.append(JointSample(name, link.value, used, score, reason))
        return tuple(samples)

    def _worst(self, link: EvidenceKind) -> float:
        return -float(self._scores[link].max(initial=0))

    def _search(self, link: EvidenceKind) -> None:
        count = len(self._weights[link])
        fit = fit_without_outliers(partial(self._fit, link), count, _limit(link))
        self._weights[link] = fit.used.astype(np.float64)
        self.optimum, fits = self._solve(self._weights)
        weights = self._data.in_use(self._weights)
        for other in SAMPLED:
            used = weights[other] > 0
            self._scores[other][used] = fits[other].scores
        self._scores[link] = fit.scores.copy()

    def _fit(self, link: EvidenceKind, weights: Array) -> KindFit:
        fit = self._solve({**self._weights, link: weights})[1][link]
        weights = self._data.in_use({**self._weights, link: weights})[link]
        whitened = _spread(fit.whitened, weights)
        return KindFit(whitened, _spread(fit.scores, weights), fit.degrees_of_freedom)

    def _solve(self, weights: Weights) -> tuple[JointFit, Mapping[EvidenceKind, KindFit]]:
        """Fit with these weights, and its samples against all others; solved once."""
        key = _key(weights)
        if key not in self._solved:
            data, start = self._data.weighted(weights), self._all.state
            start = replace(
                start, table_motion=start.table_motion[weights[EvidenceKind.SPINS] > 0]
            )
            optimum = fit_joint(data, layout_of(data), start)
            self._solved[key] = optimum, leave_one_out(optimum)
        return self._solved[key]


def _key(weights: Weights) -> bytes:
    return np.concatenate([weights[link] for link in SAMPLED]).tobytes()


def _limit(link: EvidenceKind) -> float:
    """Pictures are many, and their noise is known: a good one is never as far off as this."""
    return OUTLIER_SIGMA if link in (EvidenceKind.TOUCHES, EvidenceKind.POINTS) else PICTURE_SIGMA


def _spread(values: Array, weights: Array) -> Array:
    """Values of the samples in use in the places of all, 0 elsewhere."""
    spread = np.zeros((len(weights), *values.shape[1:]))
    spread[weights > 0] = values
    return spread


def _misses_mm(data: JointData, state: JointState, spun: Array) -> Mapping[EvidenceKind, Array]:
    """How far the tips were from what they touched; spun (s,): weights of the spins, 0 for one left out."""
    misses_mm = {}
    data = replace(data, touch_spins=renumbered(data.touch_spins, spun))
    for link, touches, points in (
        (EvidenceKind.TOUCHES, data.touches, touched_places(state, data)),
        (EvidenceKind.POINTS, data.points, state.fixed_point_in_base),
    ):
        tips = touches.rotations @ state.tcp_in_wrist + touches.translations
        misses_mm[link] = np.linalg.norm(tips - points, axis=1)
    return MappingProxyType(misses_mm)
