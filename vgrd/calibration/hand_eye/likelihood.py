"""Hand-eye by restricted maximum likelihood: the two poses and the levels of noise, from the same samples.

`camera_from_target_i = X^-1 M_i Y` as in `vgrd.calibration.hand_eye.pose_pairs`. The residual of a sample
(`vgrd.calibration.hand_eye.rows`) has the covariance sum_k exp(xi_k) Q_k of its kinds of noise; for given
levels X and Y come from weighted least squares, the levels from `vgrd.calibration.levels`. A sample weighs as
in Student's t distribution where the data say so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import gammaln

from vgrd.calibration.hand_eye.rows import Evidence
from vgrd.calibration.hand_eye.state import HandEye, flange_motion_of
from vgrd.calibration.levels import Levels, Whitened, find_levels
from vgrd.errors import DidNotConverge, InputError
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.model import Mount

_STEPS = 40  # of Gauss-Newton, a bound only
_SETTLED = 1e-4  # of the norm of the whitened residuals: no printed figure changes
_LEVELS_SETTLED = 3e-2  # of a log variance, 1.5 % of a sigma: far below its spread
_SHORTER = 8  # trials of a step, each a third of the one before
_ROUNDING = 1e-9  # of the cost
_FIRST_STEPS = 3  # before the levels are sought: each round makes one more
_RANK = 1e-12  # of the largest singular value: rounding
HEAVY = 5.0  # degrees of freedom of a t distribution with some samples far off


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of noise and its nominal level, within `factor` of which it is in two of three cases.

    what: "pixels" (each by itself), "pictures" (all points of a picture alike), "places", "turns" (of
    measured poses), "arm places", "arm turns".
    """

    what: str
    name: str
    unit: str
    nominal: float
    factor: float


@dataclass(frozen=True, slots=True, eq=False)
class Linearized:
    """r (n, q), J (n, q, 12 + extra) and arm (n, q, 6): by a small motion of the flange, in its frame."""

    r: Array
    J: Array
    arm: Array


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Samples with flange poses, kinds of noise, steps allowed (`basis`: (12 + extra, p)).

    freedom: of the t distribution, inf for a normal one.
    """

    mount: Mount
    wrists: Sequence[Pose]
    evidence: Evidence
    kinds: Sequence[Kind]
    basis: Array
    freedom: float = np.inf

    def with_freedom(self, freedom: float) -> "Likelihood":
        """The same with another distribution."""
        return replace(self, freedom=freedom)

    def of_samples(self, wrists: Sequence[Pose], evidence: Evidence) -> "Likelihood":
        """The same of other samples."""
        return replace(self, wrists=wrists, evidence=evidence)

    @cached_property
    def _moves(self) -> tuple[Array, Array]:
        moves = [flange_motion_of(self.mount, wrist) for wrist in self.wrists]
        return np.array([m.rotation for m in moves]), np.array([m.translation for m in moves])

    def linearize(self, state: HandEye) -> Linearized:
        """Rows of all samples at a state."""
        rows = self.evidence.at(state)
        inverse = state.X.inverse()
        R, t = self._moves
        R_turn = inverse.rotation @ R
        t_turn = t @ inverse.rotation.T + inverse.translation
        R_p = R_turn @ state.Y.rotation
        t_p = R_turn @ state.Y.translation + t_turn
        w = log_rotation(R_p @ np.swapaxes(rows.rotations, 1, 2))
        u = np.concatenate([t_p - rows.translations, w], axis=1)
        at_target = _at_target(t_p, w)
        by_X = at_target @ -inverse.adjoint()
        by_Y = at_target @ _adjoints(R_turn, t_turn)
        arm = by_Y if self.mount is Mount.EYE_TO_HAND else -by_X
        r = np.einsum("nij,nj->ni", rows.D, u) + rows.r
        J = np.concatenate([rows.D @ by_X, rows.D @ by_Y, rows.E], axis=2)
        return Linearized(r, J, rows.D @ arm)

    def factors(self, here: Linearized) -> list[Array]:
        """(n, q, b) of every kind at its nominal level."""
        n, q = here.r.shape
        top = np.zeros((q, 6))
        top[:6] = np.eye(6)
        of = {
            "pixels": np.eye(q),
            "pictures": top,
            "places": top[:, :3],
            "turns": top[:, 3:],
            "arm places": here.arm[:, :, :3],
            "arm turns": here.arm[:, :, 3:],
        }
        made = [of[kind.what] * kind.nominal for kind in self.kinds]
        return [np.broadcast_to(F, (n, *F.shape[-2:])) for F in made]

    def whiten(self, here: Linearized, levels: Array) -> tuple[Array, list[Array], float]:
        """W (n, q, q), the whitened factors, and sum log |S|."""
        factors = [F * np.exp(x / 2) for F, x in zip(self.factors(here), levels, strict=True)]
        S = sum((F @ np.swapaxes(F, 1, 2) for F in factors), np.zeros(1))
        L = np.linalg.cholesky(S)
        W = np.linalg.inv(L)
        log_det = 2 * float(np.log(np.diagonal(L, axis1=1, axis2=2)).sum())
        return W, [W @ F for F in factors], log_det

    def weighted(self, state: HandEye, levels: Array) -> "Weighted":
        """Whitened rows at a state, each sample with its weight."""
        here = self.linearize(state)
        W, factors, log_det = self.whiten(here, levels)
        r = np.einsum("nij,nj->ni", W, here.r)
        d2 = np.sum(r[:, :6] ** 2, axis=1)
        weights = np.ones(len(d2))
        misfit = float(np.sum(r * r))
        if np.isfinite(self.freedom):
            weights = (self.freedom + 6) / (self.freedom + d2)
            heavy = float(np.sum((self.freedom + 6) * np.log1p(d2 / self.freedom)))
            misfit += heavy - float(d2.sum())
        roots = np.ones(r.shape)
        roots[:, :6] = np.sqrt(weights)[:, None]
        anchor_r, anchor_J = state.anchors()
        J = (roots[:, :, None] * (W @ here.J)).reshape(-1, here.J.shape[2]) @ self.basis
        return Weighted(
            np.concatenate([(roots * r).ravel(), anchor_r]),
            np.vstack([J, anchor_J @ self.basis]),
            r.size,
            factors,
            d2,
            weights,
            misfit + float(anchor_r @ anchor_r) + log_det,
        )

    def descend(self, state: HandEye, levels: Array, steps: int = _STEPS) -> HandEye:
        """The best state for given levels, or after some steps."""
        here = self.weighted(state, levels)
        for _ in range(steps):
            step = np.asarray(np.linalg.lstsq(here.J, -here.r, rcond=_RANK)[0])
            better = self._shortened(state, here, levels, step)
            if better is None:
                break
            state, there = better
            enough = _SETTLED * (1 + np.linalg.norm(here.r))
            is_settled = np.linalg.norm(here.J @ step) < enough
            gained = here.cost - there.cost  # the determinant moves too, and may undo the step
            here = there
            if is_settled or gained < enough**2:
                break
        return state

    def _shortened(
        self, state: HandEye, here: "Weighted", levels: Array, step: Array
    ) -> "tuple[HandEye, Weighted] | None":
        """The state after the step, or after as much of it as does not raise the cost."""
        for shrink in 3.0 ** -np.arange(_SHORTER):
            trial = state.retract(self.basis @ (shrink * step))
            there = self._weighted_or_none(trial, levels)
            if there is not None and there.cost <= here.cost + _ROUNDING * (1 + abs(here.cost)):
                return trial, there
        return None

    def _weighted_or_none(self, state: HandEye, levels: Array) -> "Weighted | None":
        """None where the step led to a camera that shows nothing."""
        try:
            return self.weighted(state, levels)
        except (DidNotConverge, InputError):
            return None

    def objective(self, state: HandEye, levels: Array) -> float:
        """Minus twice the restricted log-likelihood and the log of the prior of the levels."""
        here = self.weighted(state, levels)
        s = np.linalg.svd(here.J, compute_uv=False)
        normal = 0.0
        if np.isfinite(
            self.freedom
        ):  # constants of the t distribution over those of the normal one
            nu, n = self.freedom, len(here.d2)
            normal = -2 * n * float(gammaln((nu + 6) / 2) - gammaln(nu / 2) - 3 * np.log(nu / 2))
        prior = float(np.sum(self.prior_information * levels**2))
        return here.cost + normal + 2 * float(np.log(s[s > 0]).sum()) + prior

    @property
    def prior_factors(self) -> Array:
        """(k,) of the kinds."""
        return np.array([kind.factor for kind in self.kinds])

    @property
    def prior_information(self) -> Array:
        """(k,) of the log variances."""
        return np.asarray(1 / (2 * np.log(self.prior_factors)) ** 2)

    def search(self, state: HandEye, start: Array) -> tuple[HandEye, Levels]:
        """Levels near a start, and the state for them."""
        current = [state]

        def whiten(levels: Array) -> Whitened:
            here = self.weighted(current[0], levels)
            if state.extra:
                current[0] = self.descend(current[0], levels, 1)
            else:
                step = np.linalg.lstsq(here.J, -here.r, rcond=_RANK)[0]
                current[0] = current[0].retract(self.basis @ step)
            return Whitened(here.r[: here.size], here.J[: here.size], here.factors)

        current[0] = self.descend(state, start, _FIRST_STEPS)
        levels = find_levels(
            whiten,
            len(self.kinds),
            prior_factors=self.prior_factors,
            start=start,
            settled=_LEVELS_SETTLED,
        )
        return self.descend(current[0], levels.log_variances), levels


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """r, J: whitened, weighted rows, those of priors of points after the first `size`.

    d2: (n,) squared distance of every sample, weights (n,); cost: minus twice the log-likelihood.
    """

    r: Array
    J: Array
    size: int
    factors: Sequence[Array]
    d2: Array
    weights: Array
    cost: float


def _adjoints(R: Array, t: Array) -> Array:
    A = np.zeros((len(R), 6, 6))
    A[:, :3, :3] = A[:, 3:, 3:] = R
    A[:, :3, 3:] = hat(t) @ R
    return A


def _at_target(t: Array, w: Array) -> Array:
    """(n, 6, 6): derivative of (t, log R R_0^T = w) by a left perturbation of the pose."""
    A = np.broadcast_to(np.eye(6), (len(t), 6, 6)).copy()
    A[:, :3, 3:] = -hat(t)
    H = hat(w)
    A[:, 3:, 3:] = np.eye(3) - H / 2 + H @ H / 12
    return A
