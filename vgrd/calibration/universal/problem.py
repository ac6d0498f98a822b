"""The universal method's equations (paper section IV, Eq. 7-15) in units of sigma."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.observability import Axes, missing_rotation, turned_axes
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal.start import solve_linear_part
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Array, exp_rotation, hat
from vgrd.geometry.coincidence import are_in_line
from vgrd.geometry.covariance import observability
from vgrd.geometry.pose import left_jacobian_rotation
from vgrd.judging.thresholds import LINE

_TOLERANCE = 2.5e-3  # mm per mm and touch, as in `tcp.surface`
_MIN_TOUCHES = 4  # 9 unknowns, 3 numbers each, and one touch to contradict

State = tuple[Array, Array, Array]


@dataclass(frozen=True, slots=True, eq=False)
class UniversalProblem:
    """m touches of CAD points: points_in_object (m, 3) mm, one per touch."""

    points_in_object: Array
    touches: TouchSet


def checked_points(problem: UniversalProblem) -> Array:
    """Points (m, 3); raises InputError or TooFewObservations."""
    p = np.array(problem.points_in_object, dtype=np.float64)
    m = len(problem.touches)
    if p.shape != (m, 3) or not np.isfinite(p).all():
        raise InputError(f"{m} touches need as many finite points (m, 3), got shape {p.shape}")
    if m < _MIN_TOUCHES or problem.touches.equations() < 9:
        raise TooFewObservations(
            f"the universal method needs at least {_MIN_TOUCHES} touches and 9 measured "
            f"directions, got {m} touches and {problem.touches.equations()} directions"
        )
    return p


def retract(state: State, step: Array) -> State:
    """Left perturbation of X, addition to the TCP."""
    R, t, tcp = state
    turn = exp_rotation(step[3:6])
    shift = left_jacobian_rotation(step[3:6]) @ step[:3]
    return turn @ R, turn @ t + shift, tcp + step[6:]


class Equations:
    """Eq. 11-15, whitened."""

    def __init__(self, points_in_object: Array, touches: TouchSet) -> None:
        self._p = points_in_object
        self._touches = touches
        self._R, self._t = touches.rotations, touches.translations
        self._W = touches.base_sqrt_informations()
        self._isotropic = touches.is_isotropic
        self._weights = 1 / touches.lateral_sigma_mm[:, None]

    def start(self, R_X: Array) -> State:
        """State with the best translation and TCP for a rotation of X."""
        return solve_linear_part(self._p, self._touches, R_X)

    def residuals_mm(self, state: State) -> Array:
        """e_i (m, 3) of Eq. 12."""
        R, t, tcp = state
        return self._p - ((self._R @ tcp + self._t) @ R.T + t)

    def linearize(self, state: State) -> tuple[Array, Array]:
        """f(x) of Eq. 11 and J(x) of Eq. 15, in units of sigma."""
        R, t, tcp = state
        y = (self._R @ tcp + self._t) @ R.T + t
        e = self._p - y
        J = np.empty((len(y), 3, 9))
        J[:, :, :3] = -np.eye(3)
        J[:, :, 3:6] = hat(y)
        J[:, :, 6:] = -R @ self._R
        if self._isotropic:
            return (e * self._weights).ravel(), (J * self._weights[:, :, None]).reshape(-1, 9)
        # Weights stand in the frame of the tool, which X turns: that is the additional term.
        J[:, :, 3:6] += hat(e)
        W = self._W @ R.T
        return np.einsum("mij,mj->mi", W, e).ravel(), (W @ J).reshape(-1, 9)

    def check_rank(self, state: State) -> None:
        """Raise NotObservable with the reason unless all 9 columns are independent.

        Judged where the touches meet CAD exactly: off it by their noise, the points of a line span a
        plane. Of the state only the rotation counts, which no column can be made to vanish by.
        """
        R = state[0]
        W = self._touches.measured().base_sqrt_informations() @ R.T
        J_X = np.concatenate([np.broadcast_to(-np.eye(3), W.shape), hat(self._p)], axis=2)
        J = (W @ np.concatenate([J_X, -R @ self._R], axis=2)).reshape(-1, 9)
        about_center = np.eye(9)
        about_center[:3, 3:6] = hat(self._p.mean(axis=0))
        lever = max(float(np.std(self._p, axis=0).max()), 1.0)
        scales = np.array([1.0] * 3 + [1 / lever] * 3 + [1.0] * 3)
        rank = observability(J @ about_center, scales, _TOLERANCE).rank
        if rank < 9:
            raise NotObservable(
                f"universal method: {rank} of 9 unknowns are determined: {self._missing()}",
                rank=rank,
                unknowns=9,
            )

    def _missing(self) -> str:
        reasons = []
        if are_in_line(self._p, LINE):
            reasons.append("the touched points lie on one line; touch a point beside it")
        if turned_axes(list(self._R))[0] is not Axes.MANY:
            reasons.append(missing_rotation(list(self._R)))
        if not np.isfinite(self._touches.axial_sigma_mm).all():
            reasons.append("some touches measure nothing along the tool; add touches that do")
        return "; ".join(reasons) or "add touches with other wrist orientations"
