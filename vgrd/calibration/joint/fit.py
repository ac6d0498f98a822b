"""Least squares of the joint estimate: the noise of the arm, null directions, scores of samples.

Corrections of the robot's poses are eliminated in closed form: with a prior S and derivative G they
widen the noise to I + G S G^T. It is renewed, as the refined tag sizes are, until nothing moves.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import solve_triangular

from vgrd.calibration.joint.camera_corrections import RefinedCorrections
from vgrd.calibration.joint.problem import JointData
from vgrd.calibration.joint.rows import ArmRows, arm_rows, as_refined, linearize
from vgrd.calibration.joint.state import JointState, StepLayout
from vgrd.calibration.levels import Level
from vgrd.errors import DidNotConverge
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.least_squares import Convergence, check_convergence, minimize
from vgrd.model import Finding, Recording

_UNDETERMINED_MM = 500.0  # an arm's reach: what is less sure tells nothing
_UNDETERMINED_RAD = 1.0  # the same for a turn
_ROUNDS = 8  # of renewing the arm's noise, a bound only
_ANCHORED = 2  # rounds after which derivatives by a stretch, which change with the pose, are kept
_SETTLED_MM = 2e-2  # mm, a tenth of what the best session is sure of
_SETTLED_SIGMA = 1e-2  # of a refined number, in what was known of it before
_TOLERANCE = 1e-6  # of the cost: below it steps follow rounding
_FAR = 1e-6  # damping, of unit columns, where the start is a guess
_NEAR = 1e-12  # the same near the end: more would hold what is hardly known for some steps
_ROUGH = 1e-2  # the same where everything is weighed anew afterwards
_ROUNDING = 1e-6  # of a direction of length 1
_NONE = np.zeros((0, 0))  # rows that feel an exact arm
_NOISE_CONFIDENCE = 0.999  # a good session is called noisy once in a thousand


@dataclass(frozen=True, slots=True)
class JointSample:
    """One sample of one kind: name as recorded ("touch 3 (P1)"), kind of what it measured.

    score: sigmas it is off what all others say. reason: why it was left out, "" where it was used.
    """

    name: str
    kind: str
    used: bool
    score: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """Estimates (`state`), their uncertainty, and how well the samples agree.

    data: the samples in use, as seen with the refined numbers; raw: as gathered; samples: all of them, the
    bad ones named. covariance: (n, n) of a step in `layout`, undetermined directions left out, enlarged by
    `variance_scale`: `variance_inflation` where the residuals are larger than chance, and `spread` for
    levels of noise that are not known exactly. levels: those found, none where they were taken as stated.
    freed: what the cell file says and the samples contradict, left out.
    undetermined: (n, z),
    the step that 500 mm or 1 rad along each of them is. whitened (r,), jacobian (r, n): residuals and
    derivative at the optimum, in sigmas, noise of the arm included by `arm_factor` (lower triangle
    of I + G S G^T, G being `deviation_jacobian`), of `arm_rows`.
    """

    data: JointData
    raw: JointData
    layout: StepLayout
    state: JointState
    covariance: Array
    undetermined: Array
    whitened: Array
    jacobian: Array
    arm_rows: ArmRows | None
    arm_factor: Array
    report: Convergence
    samples: tuple[JointSample, ...] = ()
    levels: tuple[Level, ...] = ()
    freed: tuple[Finding, ...] = ()
    spread: float = 1.0

    def widened(self, factor: float) -> "JointFit":
        """The same with sigmas larger by a factor."""
        return replace(
            self, covariance=self.covariance * factor**2, spread=self.spread * factor**2
        )

    @property
    def deviation_jacobian(self) -> Array:
        """Derivative (k, 6 s) of the rows that feel the arm by its deviation at every stand; none if it is exact."""
        return _NONE if self.arm_rows is None else self.arm_rows.jacobian(len(self.data.flange_at))

    @property
    def recording(self) -> Recording:
        """What was fitted."""
        return self.data.recording

    @property
    def cost(self) -> float:
        """Half the sum of squares, in sigmas."""
        return self.report.cost

    @property
    def degrees_of_freedom(self) -> int:
        """Measured rows minus determined unknowns."""
        return _degrees_of_freedom(self.data, self.layout, self.undetermined)

    @property
    def noise_scale(self) -> float:
        """Residuals over what the sigmas promise."""
        freedom = self.degrees_of_freedom
        return float(np.sqrt(2 * self.cost / freedom)) if freedom else 1.0

    @property
    def stated_scale(self) -> float:
        """The same over what was stated: the largest of all kinds where their levels were found."""
        return max([self.noise_scale, *(level.ratio for level in self.levels)])

    @property
    def variance_scale(self) -> float:
        """What the covariance was multiplied by."""
        return self.spread * variance_inflation(2 * self.cost, self.degrees_of_freedom)

    @property
    def open_directions(self) -> Array:
        """`undetermined` (n, z) as far as anything depends on it: not the frame of an object without CAD."""
        if self.recording.facts.object.has_cad:
            return self.undetermined
        scales = units(self.layout)[:, None]
        N = self.undetermined / scales
        N[self.layout.OBJECT] = 0
        U, s, _ = np.linalg.svd(N, full_matrices=False)
        return np.asarray(scales * (U * s)[:, s > _ROUNDING])

    @property
    def refined(self) -> RefinedCorrections:
        """Refined tag sizes and intrinsics: what corrects a new picture."""
        return RefinedCorrections(self.data.corrections, self.state.refined)

    def unknown_in_words(self) -> str:
        """Which unknowns the data leave undetermined."""
        return unknown_in_words(self.layout, self.undetermined)


def fit_joint(
    raw: JointData,
    layout: StepLayout,
    state: JointState,
    *,
    is_near: bool = False,
    is_rough: bool = False,
) -> JointFit:
    """Most likely state near the one given, which keeps what nothing determines as it was.

    is_near: the start is that of nearly the same evidence. is_rough: only until derivatives by a stretch are
    near the end, for a fit that another one follows. Raises DidNotConverge.
    """
    anchor = state
    for rounds in range(_ROUNDS):
        anchor = state if rounds < _ANCHORED else anchor
        weighed = _Weighed(raw, layout, state, anchor)
        is_last = is_rough and rounds + 1 == _ANCHORED
        is_passing = is_rough or (not rounds and not weighed.is_for_good)
        minimum = minimize(
            weighed.held,
            partial(_retract, layout=layout),
            state,
            tolerance=_ROUGH if is_passing else _TOLERANCE,
            damping=_NEAR if rounds or is_near else _FAR,
        )
        before, state = state, minimum.state
        if is_last or (not is_passing and weighed.is_settled(before, state)):
            break
    else:
        raise DidNotConverge(
            f"joint estimate: not settled after {_ROUNDS} rounds of weighing; the samples contradict "
            "each other or belong to different set-ups"
        )
    check_convergence(minimum.report, "joint estimate")
    return fit_at(raw, layout, state, minimum.report, anchor)


class _Weighed:
    """Rows with the noise of the arm and the derivatives of refined numbers kept as they are at one state."""

    def __init__(
        self, raw: JointData, layout: StepLayout, state: JointState, anchor: JointState
    ) -> None:
        self.data = as_refined(state, raw, layout, anchor)
        self._layout, self._state = layout, state
        self._factor = arm_noise(state, self.data)
        self._rows = _whitened(state, self.data, layout, self._factor)
        # No step is taken along these directions (z, n): costs would lead nowhere there.
        self._frozen = _open(self._rows[1], layout)

    def held(self, state: JointState) -> tuple[Array, Array]:
        """Residuals and derivative across what is frozen, which rows of zero residual hold."""
        r, J = self._at(state)
        if not len(self._frozen):
            return r, J
        scales, frozen = units(self._layout), self._frozen
        J = J * scales
        J = np.vstack([J - J @ frozen.T @ frozen, frozen]) / scales
        return np.concatenate([r, np.zeros(len(frozen))]), J

    @property
    def is_for_good(self) -> bool:
        """Whether nothing is to be weighed anew."""
        return self.data.arm.is_exact and not self.data.corrections.count

    def is_settled(self, before: JointState, after: JointState) -> bool:
        """Whether the weights hold after a round, and as much is frozen as is undetermined then."""
        count = len(self._frozen)
        if not _is_settled(before, after, self.data):
            return False
        return not count or len(_open(self._at(after)[1], self._layout)) == count

    def _at(self, state: JointState) -> tuple[Array, Array]:
        if state is not self._state:
            self._rows = _whitened(state, self.data, self._layout, self._factor)
            self._state = state
        return self._rows


def fit_at(
    raw: JointData,
    layout: StepLayout,
    state: JointState,
    report: Convergence,
    anchor: JointState | None = None,
) -> JointFit:
    """The fit as it looks at a state; anchor: as of `as_refined`."""
    data = as_refined(state, raw, layout, anchor)
    rows = None if data.arm.is_exact else arm_rows(state, data)
    factor = _NONE if rows is None else arm_factor(rows, data)
    r, J = _whitened(state, data, layout, factor)
    covariance, undetermined = information_inverse(J, layout)
    freedom = _degrees_of_freedom(data, layout, undetermined)
    return JointFit(
        data=data,
        raw=raw,
        layout=layout,
        state=state,
        covariance=covariance * variance_inflation(2 * report.cost, freedom),
        undetermined=undetermined,
        whitened=r,
        jacobian=J,
        arm_rows=rows,
        arm_factor=factor,
        report=report,
    )


def variance_inflation(squares: float, degrees_of_freedom: int) -> float:
    """1, or squares / degrees_of_freedom where that is beyond chance."""
    if degrees_of_freedom <= 0 or squares <= chi2_quantile(_NOISE_CONFIDENCE, degrees_of_freedom):
        return 1.0
    return squares / degrees_of_freedom


def _degrees_of_freedom(data: JointData, layout: StepLayout, undetermined: Array) -> int:
    determined = layout.size - int(undetermined.shape[1])
    return max(data.measured() - determined, 0)


def arm_factor(rows: ArmRows, data: JointData) -> Array:
    """Cholesky factor of I + G S G^T, the noise of the rows that feel the arm."""
    noise = rows.covariance(data.arm, data.flange_at)
    noise[np.diag_indices_from(noise)] += 1
    return np.asarray(np.linalg.cholesky(noise), dtype=np.float64)


def arm_noise(state: JointState, data: JointData) -> Array:
    """The same at a state; empty for an exact arm."""
    return _NONE if data.arm.is_exact else arm_factor(arm_rows(state, data), data)


def whiten_arm(factor: Array, rows: Array) -> Array:
    """Rows (r,) or (r, n) with the noise of the arm taken into account."""
    k = len(factor)
    if not k:
        return rows
    if rows.ndim == 1:
        first = solve_triangular(factor, rows[:k], lower=True, check_finite=False)
        return np.concatenate([first, rows[k:]])
    out = rows.copy()
    # Columns that touches alone move begin late, and nothing comes before their first row.
    moved = rows[:k] != 0
    begins, is_moved = np.argmax(moved, axis=0), moved.any(axis=0)
    early = begins < k // 2
    for columns in (np.flatnonzero(is_moved & early), np.flatnonzero(is_moved & ~early)):
        start = int(begins[columns].min(initial=k))
        own = np.ix_(np.arange(start, k), columns)
        corner = factor[start:, start:]
        out[own] = solve_triangular(corner, rows[own], lower=True, check_finite=False)
    return out


def information_inverse(jacobian: Array, layout: StepLayout) -> tuple[Array, Array]:
    """Covariance (n, n) from a whitened Jacobian (r, n), and what it leaves undetermined (n, z).

    A direction is undetermined when the data leave it uncertain by more than 500 mm or 1 rad.
    """
    half, undetermined = _determined(jacobian, layout)
    return half @ half.T, units(layout)[:, None] * undetermined.T


def determined_half(jacobian: Array, layout: StepLayout) -> Array:
    """Factor (n, k) of the covariance from a whitened Jacobian (r, n): what is determined, in its sigmas."""
    return _determined(jacobian, layout)[0]


def determined_span(jacobian: Array, layout: StepLayout) -> Array:
    """Orthonormal columns (r, k) of what the unknowns that are determined take up of the rows."""
    Q, R = np.linalg.qr(jacobian * units(layout))
    if _inverse(R) is not None:
        return np.asarray(Q)
    U, s, _ = np.linalg.svd(R)
    return np.asarray(Q @ U[:, s > 1.0])


def units(layout: StepLayout) -> Array:
    """(n,): a step of every unknown beyond which it counts as undetermined."""
    return np.where(layout.is_length(), _UNDETERMINED_MM, _UNDETERMINED_RAD)


def unknown_in_words(layout: StepLayout, undetermined: Array) -> str:
    """Which unknowns the directions (n, z) that the data leave undetermined touch."""
    names = {
        "base_from_camera": layout.CAMERA,
        "wrist_from_tag_a": layout.TAG_A,
        "the TCP": layout.TCP,
        "base_from_object": layout.OBJECT,
    }
    size = np.linalg.norm(undetermined / units(layout)[:, None], axis=1)
    concerned = [name for name, part in names.items() if (size[part] > 0.05).any()]
    if (size[layout.bare_columns()] > 0.05).any():
        concerned.append("targets without CAD")
    return ", ".join(concerned)


def _whitened(
    state: JointState, data: JointData, layout: StepLayout, factor: Array
) -> tuple[Array, Array]:
    """Residuals (r,) and derivative (r, n) in sigmas, noise of the arm included."""
    r, J = linearize(state, data, layout)
    return whiten_arm(factor, r), whiten_arm(factor, J)


def _determined(jacobian: Array, layout: StepLayout) -> tuple[Array, Array]:
    """Factor (n, k) of the covariance and, in `units`, directions (z, n) that are undetermined."""
    scales = units(layout)[:, None]
    R = np.asarray(np.linalg.qr(jacobian * scales.T, mode="r"), dtype=np.float64)
    if (R_inv := _inverse(R)) is not None:
        return scales * R_inv, R[:0]
    _, s, Vt = np.linalg.svd(R, full_matrices=True)
    s = s[s > 1.0]
    return scales * Vt[: len(s)].T / s, Vt[len(s) :]


def _inverse(R: Array) -> Array | None:
    """Of a triangle (k, n) that leaves nothing undetermined; else None."""
    if R.shape[0] < R.shape[1] or not np.diag(R).all():
        return None
    R_inv = solve_triangular(R, np.eye(len(R)), check_finite=False)
    # The largest singular value of the inverse is at most its Frobenius norm.
    is_determined = np.sum(R_inv**2) < 1 or np.linalg.svd(R, compute_uv=False).min() > 1.0
    return np.asarray(R_inv) if is_determined else None


def _open(jacobian: Array, layout: StepLayout) -> Array:
    """Directions (z, n) in `units` that are undetermined."""
    return _determined(jacobian, layout)[1]


def _retract(state: JointState, step: Array, layout: StepLayout) -> JointState:
    return state.retract(step, layout)


def _is_settled(before: JointState, after: JointState, data: JointData) -> bool:
    refined = np.abs(after.refined - before.refined).max(initial=0)
    still = data.arm.is_exact or _moved_mm(before, after) < _SETTLED_MM
    return bool(still and refined < _SETTLED_SIGMA)


def _moved_mm(before: JointState, after: JointState) -> float:
    """How far the levers of the arm moved (1 mrad counts as 1 mm)."""
    mm, rad = before.base_from_camera.distance(after.base_from_camera)
    tip = float(np.linalg.norm(before.tcp_in_wrist - after.tcp_in_wrist))
    return max(mm, 1e3 * rad, tip)
