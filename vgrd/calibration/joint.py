"""Joint estimate: one maximum-likelihood problem over everything that a session tells.

Unknowns: base_from_camera, wrist_from_tag_a, TCP, base_from_object, tag B on the object, the axis of
turning and every turn. Corrections of the robot's poses are eliminated in closed form: with a
prior S and derivative G they widen the noise to I + G S G^T. What the data leave undetermined is
reported, and refused only by the expected coordinate that depends on it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaincinv

from vgrd.calibration.joint_problem import ArmModel, JointData, Sighting, Turntable, gather
from vgrd.calibration.joint_rows import arm_jacobian, linearize, predicted_tag_a
from vgrd.calibration.joint_state import JointState, Layout, guess, layout_of
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.least_squares import Report, minimize, require_convergence
from vgrd.model import Recording

__all__ = ["ArmModel", "JointResult", "Sighting", "Turntable", "calibrate_joint"]

_UNDETERMINED_MM = 500.0
_UNDETERMINED_RAD = 1.0
_ROUNDS = 5
_HOLD = 1e-2
_SETTLED_MM = 1e-3
_TOLERANCE = 1e-8
_NOISE_CONFIDENCE = 0.999


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """Estimates (`state`), their uncertainty, and how well the samples agree.

    covariance: (n, n) of a step in `layout`, undetermined directions left out; undetermined:
    (n, z), the step that 500 mm or 1 rad along each of them is. noise_scale: residuals over what the
    sigmas promise; where that is more than chance the covariance was enlarged by its square.
    cost: half the sum of squares. residuals: rms per kind, in mm, deg and sigmas. whitened,
    jacobian: residuals (r,) and derivative (r, n) at the optimum, in sigmas, noise of the arm
    included by `arm_factor` (lower triangle of I + G S G^T) of `arm_by`: G.
    """

    recording: Recording
    data: JointData
    layout: Layout
    state: JointState
    covariance: Array
    undetermined: Array
    cost: float
    freedom: int
    noise_scale: float
    residuals: Mapping[str, float]
    whitened: Array
    jacobian: Array
    arm_by: Array
    arm_factor: Array
    report: Report

    @property
    def variance_scale(self) -> float:
        """What the covariance was multiplied by."""
        return enlargement(2 * self.cost, self.freedom)

    def unknown_in_words(self) -> str:
        """Which unknowns the data leave undetermined."""
        names = {
            "base_from_camera": self.layout.CAMERA,
            "wrist_from_tag_a": self.layout.TAG_A,
            "the TCP": self.layout.TCP,
            "base_from_object": self.layout.OBJECT,
        }
        size = np.linalg.norm(self.undetermined / _units(self.layout)[:, None], axis=1)
        return ", ".join(name for name, part in names.items() if (size[part] > 0.05).any())


def calibrate_joint(
    recording: Recording,
    sightings: Sequence[Sighting] = (),
    *,
    arm: ArmModel | None = None,
    turntable: Turntable | None = None,
) -> JointResult:
    """Most likely values of all unknowns; verifications are held out.

    sightings: holes that the camera saw. arm: None takes `ArmModel.of(facts.robot_sigma_mm)`.
    turntable: how well CAD knows the axis of turning. Raises InputError,
    TooFewObservations, NotObservable or DidNotConverge.
    """
    data = gather(recording, sightings, arm, turntable)
    layout = layout_of(data)
    return _finish(recording, data, layout, _settle(data, layout, guess(data)))


def enlargement(squares: float, freedom: int) -> float:
    """1, or squares / freedom where that is beyond chance."""
    if freedom <= 0 or squares <= 2 * gammaincinv(freedom / 2, _NOISE_CONFIDENCE):
        return 1.0
    return squares / freedom


def information_inverse(jacobian: Array, layout: Layout) -> tuple[Array, Array]:
    """Covariance (n, n) from a whitened Jacobian (r, n), and what it leaves undetermined (n, z).

    A direction is undetermined when the data leave it uncertain by more than 500 mm or 1 rad.
    """
    units = _units(layout)
    R = np.linalg.qr(jacobian * units, mode="r")
    _, s, Vt = np.linalg.svd(R, full_matrices=True)
    rank = int(np.sum(s > 1.0))
    half = units[:, None] * Vt[:rank].T / s[:rank]
    return half @ half.T, units[:, None] * Vt[rank:].T


def whiten_arm(factor: Array, rows: Array) -> Array:
    """Rows (r,) or (r, n) with the noise of the arm taken into account."""
    k = len(factor)
    if not k:
        return rows
    first = solve_triangular(factor, rows[:k], lower=True, check_finite=False)
    return np.concatenate([first, rows[k:]])


def _units(layout: Layout) -> Array:
    return np.where(layout.is_length(), _UNDETERMINED_MM, _UNDETERMINED_RAD)


def _arm_factor(state: JointState, data: JointData) -> tuple[Array, Array]:
    """G and the Cholesky factor of I + G S G^T; both empty for an exact arm."""
    if data.arm.is_exact:
        return np.zeros((0, 0)), np.zeros((0, 0))
    G = arm_jacobian(state, data)
    own = np.linalg.cholesky(data.arm.prior(data.flange_at) + 1e-12 * np.eye(len(data.flange_at)))
    F = G @ np.kron(own, np.diag(data.arm.scales()))
    return G, np.asarray(np.linalg.cholesky(np.eye(len(G)) + F @ F.T), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Optimum:
    state: JointState
    whitened: Array
    jacobian: Array
    arm_by: Array
    arm_factor: Array
    report: Report


def _settle(data: JointData, layout: Layout, state: JointState) -> _Optimum:
    """Minimise, renew the noise of the arm, until the estimate stays."""
    for _ in range(_ROUNDS):
        G, factor = _arm_factor(state, data)
        minimum = minimize(
            partial(_held, data=data, layout=layout, factor=factor),
            partial(_retract, layout=layout),
            state,
            tolerance=_TOLERANCE,
        )
        before, state = state, minimum.state
        if not len(G) or _moved_mm(before, state) < _SETTLED_MM:
            break
    require_convergence(minimum.report, "joint estimate")
    state = _polished(state, minimum.residuals, minimum.jacobian, layout)
    r, J = _held(state, data, layout, factor)
    rows = sum(data.counts.values())
    return _Optimum(state, r[:rows], J[:rows], G, factor, minimum.report)


def _polished(state: JointState, r: Array, J: Array, layout: Layout) -> JointState:
    """One step more: costs cannot tell steps below the root of the machine's precision apart."""
    scale = np.linalg.norm(J, axis=0)
    Q, R = np.linalg.qr(J / scale)
    return state.retract(solve_triangular(R, -(Q.T @ r)) / scale, layout)


def _held(
    state: JointState, data: JointData, layout: Layout, factor: Array
) -> tuple[Array, Array]:
    """Whitened residuals and derivative; rows of zero residual hold what nothing determines."""
    r, J = linearize(state, data, layout)
    hold = np.diag(_HOLD / _units(layout))
    return (
        np.concatenate([whiten_arm(factor, r), np.zeros(layout.size)]),
        np.vstack([whiten_arm(factor, J), hold]),
    )


def _retract(state: JointState, step: Array, layout: Layout) -> JointState:
    return state.retract(step, layout)


def _moved_mm(before: JointState, after: JointState) -> float:
    """How far the levers of the arm moved (1 mrad counts as 1 mm)."""
    mm, rad = before.base_from_camera.distance(after.base_from_camera)
    tip = float(np.linalg.norm(before.tcp_in_wrist - after.tcp_in_wrist))
    return max(mm, 1e3 * rad, tip)


def _finish(
    recording: Recording, data: JointData, layout: Layout, optimum: _Optimum
) -> JointResult:
    covariance, undetermined = information_inverse(optimum.jacobian, layout)
    squares = 2 * optimum.report.cost
    freedom = max(data.measured() - (layout.size - undetermined.shape[1]), 0)
    return JointResult(
        recording=recording,
        data=data,
        layout=layout,
        state=optimum.state,
        covariance=covariance * enlargement(squares, freedom),
        undetermined=undetermined,
        cost=optimum.report.cost,
        freedom=freedom,
        noise_scale=float(np.sqrt(squares / freedom)) if freedom else 1.0,
        residuals=_residuals(data, optimum),
        whitened=optimum.whitened,
        jacobian=optimum.jacobian,
        arm_by=optimum.arm_by,
        arm_factor=optimum.arm_factor,
        report=optimum.report,
    )


def _residuals(data: JointData, optimum: _Optimum) -> dict[str, float]:
    state = optimum.state
    out = {
        f"{link.name.lower()}_rms_sigma": _rms(optimum.whitened[data.rows_of(link)])
        for link, rows in data.counts.items()
        if rows
    }
    touches = data.touches
    tips = touches.rotations @ state.tcp_in_wrist + touches.translations
    out["touches_rms_mm"] = _rms(np.linalg.norm(tips - state.base_from_object @ data.cad, axis=1))
    R, t = predicted_tag_a(state, data)
    seen = data.looks.tags
    turns = log_rotation(R @ np.swapaxes(seen.rotations, 1, 2)).reshape(-1, 3)
    out["hand_eye_rms_mm"] = _rms(np.linalg.norm(t - seen.translations, axis=1))
    out["hand_eye_rms_deg"] = float(np.degrees(_rms(np.linalg.norm(turns, axis=1))))
    return out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
