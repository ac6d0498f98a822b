"""Engine of hand-eye from poses: whitening with robot noise, robust weights, least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.hand_eye.certificate import certified_start
from vgrd.calibration.hand_eye.null_space import (
    determined_steps,
    open_translations,
    without_part_along,
)
from vgrd.calibration.hand_eye.state import HandEye, flange_motion_of
from vgrd.calibration.observability import check_distinct
from vgrd.errors import DidNotConverge, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.covariance import covariance_from, sqrt_information
from vgrd.geometry.least_squares import Minimum, check_convergence, minimize
from vgrd.model import Mount

Mask = NDArray[np.bool_]

_START_SIGMA_MM = 1.0  # of the start only, where their ratio says how to weigh: alike at 500 mm
_START_SIGMA_RAD = 2e-3  # see above
_UNKNOWNS = 12  # of two poses
_ROUNDS = 20  # of reweighing, a bound only: contradictions cycle
_SETTLED = 1e-3  # sigmas: further rounds change no figure that is printed
_NEARLY_SETTLED = 1e-2  # the robust rounds only choose samples
_TOLERANCE = 1e-6  # of the cost: below it steps follow rounding
_CHI2_6_MEDIAN = 5.348  # median of chi-square with 6 degrees of freedom
_CHI2_6_95 = 12.592  # 95 % quantile of the same: Cauchy's scale for a misfit of 6 numbers
_CHI2_6_REJECT = chi2_quantile(1 - 1e-5, 6)  # a good picture in 100,000


@dataclass(frozen=True, eq=False)
class PoseSample:
    """One look: a flange pose and the pose of the target in the picture.

    covariance: (6, 6), left tangent of camera_from_target, mm and rad.
    """

    name: str
    base_from_wrist: Pose
    camera_from_target: Pose
    covariance: Array

    @cached_property
    def _measured(self) -> tuple[Pose, Array]:
        return self.camera_from_target.inverse(), sqrt_information(self.covariance)

    def linearize(self, predicted: Pose) -> tuple[Array, Array]:
        """log(predicted measured^-1), whitened (6,); its derivative (6, 6) by a left perturbation."""
        inverse, W = self._measured
        e = (predicted @ inverse).log()
        return W @ e, W @ np.linalg.inv(Pose.left_jacobian(e))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """covariance: of all unknowns, enlarged by noise_scale^2 where that is above 1.

    null_space: (k, 6), as of `open_translations`: the state and the covariance have no part along it.
    """

    state: HandEye
    covariance: Array
    noise_scale: float
    used: tuple[bool, ...]
    reasons: tuple[str, ...]
    null_space: Array


def fit_hand_eye(
    mount: Mount,
    samples: Sequence[PoseSample],
    *,
    robot_sigma_mm: float,
    robot_sigma_rad: float,
    robust: bool,
    start: HandEye | None = None,
    allow_unobservable: int = 0,
) -> Fit:
    """Maximum likelihood; robust: samples that fit no common pose are left out with the reason.

    start: of the two poses; None: the certified optimum of a simpler cost. allow_unobservable: how many
    translations may stay open.
    """
    check_distinct([s.name for s in samples], [s.base_from_wrist for s in samples])
    engine = _Engine(mount, samples, robot_sigma_mm, robot_sigma_rad)
    null_space = engine.block(np.ones(len(samples), dtype=np.bool_), allow_unobservable)
    if start is None:
        best = certified_start(
            engine.flange_motions,
            [s.camera_from_target for s in samples],
            sigma_mm=_START_SIGMA_MM,
            sigma_rad=_START_SIGMA_RAD,
            null_space=null_space,
        )
        start = HandEye(X=best.X, Y=best.Y, certificate=best.certificate)
    if 6 * len(samples) < _UNKNOWNS + 1:
        raise TooFewObservations(
            f"{len(samples)} samples cannot determine {_UNKNOWNS} unknowns: add samples"
        )
    everything = np.ones(len(samples), dtype=np.bool_)
    if not robust:
        return engine.finish(engine.fit_weighted(start, everything, robust=False), everything)
    weighted = engine.fit_weighted(start, everything, robust=True)
    misfits = engine.misfits(weighted.state)
    limit = _CHI2_6_REJECT * engine.variance_of(misfits)
    inliers = misfits <= limit
    engine.block(inliers, allow_unobservable)
    return engine.finish(engine.fit_weighted(weighted.state, inliers, robust=False), inliers)


def observed_covariance(jacobian: Array, remedy: str) -> Array:
    """As `covariance_from`; remedy: what to do about unknowns that the samples leave open."""
    try:
        return covariance_from(jacobian)
    except NotObservable as fault:
        raise NotObservable(
            f"hand-eye: {fault}; {remedy}", rank=fault.rank, unknowns=fault.unknowns
        ) from fault


class _Engine:
    def __init__(
        self, mount: Mount, samples: Sequence[PoseSample], sigma_mm: float, sigma_rad: float
    ) -> None:
        self.mount = mount
        self.samples = samples
        self.flange_motions = [flange_motion_of(mount, s.base_from_wrist) for s in samples]
        self.robot_sigmas = np.array([sigma_mm] * 3 + [sigma_rad] * 3)

    def block(self, inliers: Mask, allow_unobservable: int) -> Array:
        """Take no steps along what the samples kept leave open, which is returned."""
        chosen = [i for i, is_inlier in enumerate(inliers) if is_inlier]
        wrists = [self.samples[i].base_from_wrist for i in chosen]
        self.null_space = open_translations(
            wrists, [self.flange_motions[i] for i in chosen], allow_unobservable
        )
        self.basis = determined_steps(self.null_space, 0)
        return self.null_space

    def fit_weighted(self, state: HandEye, inliers: Mask, *, robust: bool) -> Minimum[HandEye]:
        """Minimise, renew whitening and weights, until neither changes."""
        weights: Array = inliers.astype(np.float64)
        state = self._on_zero(state)
        for _ in range(_ROUNDS):
            sqrt_informations, misfits = self._weigh(state)
            if robust:
                ratio = misfits / (self.variance_of(misfits) * _CHI2_6_95)
                weights = 1 / (1 + ratio)
            linearize = partial(
                self._linearize, sqrt_informations=sqrt_informations, weights=weights
            )
            minimum = minimize(
                linearize,
                lambda estimate, step: estimate.retract(self.basis @ step),
                state,
                tolerance=_TOLERANCE,
                max_steps=2 if robust else 50,
            )
            previous, state = state, minimum.state
            if _moved(previous, state) < (_NEARLY_SETTLED if robust else _SETTLED):
                break
        else:
            if not robust:
                raise DidNotConverge(
                    f"hand-eye: not settled after {_ROUNDS} rounds of weighing; the samples "
                    "contradict each other or belong to different set-ups"
                )
        if not robust:
            check_convergence(minimum.report, "hand-eye")
        return minimum

    def misfits(self, state: HandEye) -> Array:
        """Squared Mahalanobis distance (n,), 6 degrees of freedom, of every sample's own pose."""
        return self._weigh(state)[1]

    def variance_of(self, misfits: Array) -> float:
        """Noise variance over the promised one, from the median; at least 1."""
        return max(1.0, float(np.median(misfits)) / _CHI2_6_MEDIAN)

    def finish(self, minimum: Minimum[HandEye], inliers: Mask) -> Fit:
        state = self._on_zero(minimum.state)
        misfits = self.misfits(state)
        degrees_of_freedom = 6 * int(inliers.sum()) - self.basis.shape[1]
        variance = (
            float(misfits[inliers].sum()) / degrees_of_freedom if degrees_of_freedom > 0 else 1.0
        )
        covariance = observed_covariance(minimum.jacobian, "look from more distances and tilts")
        return Fit(
            state,
            self.basis @ covariance @ self.basis.T * max(1.0, variance),
            float(np.sqrt(variance)),
            tuple(bool(is_inlier) for is_inlier in inliers),
            tuple("" if inliers[i] else self._reason(i, state) for i in range(len(inliers))),
            self.null_space,
        )

    def _on_zero(self, state: HandEye) -> HandEye:
        X, Y = without_part_along(state.X, state.Y, self.null_space)
        return replace(state, X=X, Y=Y)

    def _reason(self, i: int, state: HandEye) -> str:
        predicted = state.X.inverse() @ self.flange_motions[i] @ state.Y
        mm, rad = predicted.distance(self.samples[i].camera_from_target)
        return f"{mm:.1f} mm and {np.degrees(rad):.2f} deg off what the others say"

    def _linearize(
        self, state: HandEye, sqrt_informations: Sequence[tuple[Array, Array]], weights: Array
    ) -> tuple[Array, Array]:
        camera_from_mount = state.X.inverse()
        J_X = -camera_from_mount.adjoint()
        residuals, jacobians = [], []
        for sample, move, W, weight in zip(
            self.samples, self.flange_motions, sqrt_informations, weights, strict=True
        ):
            if weight == 0:
                continue
            turn = camera_from_mount @ move
            r, D = sample.linearize(turn @ state.Y)
            J = np.hstack([D @ J_X, D @ turn.adjoint()])
            residuals.append(np.sqrt(weight) * _apply(W, r))
            jacobians.append(np.sqrt(weight) * _apply(W, J))
        return np.concatenate(residuals), np.vstack(jacobians) @ self.basis

    def _weigh(self, state: HandEye) -> tuple[list[tuple[Array, Array]], Array]:
        """Whiteners of all samples, and their squared misfits (n,).

        A whitener is the low-rank form of (I + G S G^T)^-1/2, G S G^T being what robot noise adds.
        """
        camera_from_mount = state.X.inverse()
        sqrt_informations, misfits = [], np.empty(len(self.samples))
        for i, (sample, move) in enumerate(zip(self.samples, self.flange_motions, strict=True)):
            turn = camera_from_mount @ move
            r, D = sample.linearize(turn @ state.Y)
            lever = turn if self.mount is Mount.EYE_TO_HAND else camera_from_mount
            G = D @ lever.adjoint() * self.robot_sigmas
            U, s, _ = np.linalg.svd(G, full_matrices=False)
            scales = 1 / np.sqrt(1 + s * s)
            sqrt_informations.append((U, 1 - scales))
            misfits[i] = np.sum((scales * (U.T @ r)) ** 2)
        return sqrt_informations, misfits


def _apply(sqrt_information: tuple[Array, Array], rows: Array) -> Array:
    U, shrink = sqrt_information
    weighted = (U * shrink) @ (U.T @ rows)
    return np.asarray(rows - weighted)


def _moved(previous: HandEye, state: HandEye) -> float:
    """How far the estimate moved, in mm (1 mrad counts as 1 mm)."""
    distances = np.array([previous.X.distance(state.X), previous.Y.distance(state.Y)])
    return float((distances * [1, 1e3]).max())
