"""Bundle adjustment of intrinsics, board poses and the board's own points.

Printed points are off by more than the pixel noise is worth, so they are unknowns too, held by a
prior as wide as the print is good: x and y by a printing error, z by a lack of flatness, and both
axes by a common stretch and shear (1 part in 1000). Every picture's pose is eliminated from the
normal equations (Schur complement; Triggs et al. 2000, section 6), so that time grows with the
number of pictures and not with its cube. Noise of pixels and of print are estimated from the
residuals (variance components; Foerstner 1979).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.errors import DidNotConverge
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.intrinsics.rows import PictureRows, inverse, solved

_STRETCH_SIGMA = 1e-3  # a guess: 0.3 mm along a sheet of A4
_RATIONAL_SIGMA = 1.0  # of k4, k5, k6, which the pictures alone hardly tell from k1, k2, k3
_MAX_STEPS, _MAX_ROUNDS, _MOST_DAMPING = 60, 12, 1e8  # bounds, guesses; 15 bad steps in a row
_SETTLED, _MATCHED = 1e-8, 0.03  # 0.01 sigma at a cost of 5000; a sigma is told no better
_UNDAMPED = 1e-6  # a step with more damping is short for that alone: it shows no minimum
_SIGMAS_PX, _SIGMAS_MM = (1e-4, 50.0), (2e-4, 2.0)  # guesses: exact data stay solvable
_ORDER = [3, 4, 5, 0, 1, 2]  # OpenCV's columns of rotation and translation as (v, w)


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """What one picture shows: ids (n,) of the board's points and their pixels (n, 2)."""

    name: str
    ids: NDArray[np.intp]
    pixels: Array


@dataclass(frozen=True, slots=True)
class PictureNoise:
    """1 sigma of a pixel coordinate, of the printed x and y, and of the height of a printed point."""

    pixel_px: float = 0.1  # a start: matched to the residuals
    print_mm: float = 0.02  # a start: matched where it is not given
    flat_mm: float = 0.02  # idem


@dataclass(frozen=True, slots=True, eq=False)
class IntrinsicsState:
    """All unknowns: intrinsics (4 + k,) fx fy cx cy and distortion, stretch (2,), offsets (m, 3) mm, poses."""

    intrinsics: Array
    stretch: Array
    offsets: Array
    poses: tuple[Pose, ...]  # camera_from_board

    def camera(self, size_px: tuple[int, int]) -> CameraModel:
        """The camera of this state."""
        return CameraModel(_matrix(self.intrinsics), self.intrinsics[4:], size_px)


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """The minimum.

    covariance: (4 + k, 4 + k) of the intrinsics; residuals: (n, 2) px per view, model minus
    measured; held_out: the same as a fit without that picture predicts them, its own pose fitted.
    """

    state: IntrinsicsState
    noise: PictureNoise
    covariance: Array
    residuals: tuple[Array, ...]
    held_out: tuple[Array, ...]


def adjust(
    nominal: Array,
    views: Sequence[BoardView],
    start: IntrinsicsState,
    noise: PictureNoise,
    *,
    fixed_print: bool,
) -> Bundle:
    """Fit everything, pixel noise matched to the residuals; print noise too unless it is fixed.

    nominal: (m, 3) mm, z = 0. Raises NotObservable and DidNotConverge.
    """
    problem = _Problem(nominal, tuple(views), noise)
    state = start
    for _ in range(_MAX_ROUNDS):
        state = problem.minimum(state)
        matched = problem.matched_noise(state, fixed_print=fixed_print)
        change = np.abs(np.log(_sigmas(matched) / _sigmas(problem.noise))).max()
        problem = replace(problem, noise=matched)
        if change < _MATCHED:
            break
    state = problem.minimum(state)
    return problem.bundle(state)


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    nominal: Array
    views: tuple[BoardView, ...]
    noise: PictureNoise

    def minimum(self, state: IntrinsicsState) -> IntrinsicsState:
        """Levenberg-Marquardt on the reduced normal equations."""
        damping, cost, pictures = 1e-6, self._cost(state), self._all_linearized(state)
        for _ in range(_MAX_STEPS):
            trial = self._step(state, pictures, damping)
            trial_cost = self._cost(trial)
            if not trial_cost <= cost:
                if damping <= _UNDAMPED and trial_cost - cost <= _SETTLED * (1 + cost):
                    return state  # as low as rounding allows
                damping *= 10
                if damping > _MOST_DAMPING:
                    break
                continue
            is_last = damping <= _UNDAMPED and cost - trial_cost <= _SETTLED * (1 + cost)
            state, cost, damping = trial, trial_cost, max(damping / 10, 1e-12)
            if is_last:
                return state
            pictures = self._all_linearized(state)
        raise DidNotConverge(
            f"intrinsics: no minimum (cost {cost:.3g}); do all pictures show the same board "
            "through the same camera and focus?"
        )

    def matched_noise(self, state: IntrinsicsState, *, fixed_print: bool) -> PictureNoise:
        """Noise levels as the residuals show them."""
        C = np.diag(inverse(self._reduced(state, self._all_linearized(state))[0]))
        first = len(state.intrinsics) + 2
        prior = self._prior(state)
        prior_sum = float(np.sum(prior * C))  # unknowns that the prior, not the pixels, determines
        rows = sum(view.pixels.size for view in self.views)
        degrees_of_freedom = max(rows + prior_sum - len(prior) - 6 * len(self.views), 1.0)
        squares = sum(float(np.sum(r * r)) for r in self._residuals(state))
        pixel = np.clip(np.sqrt(squares / degrees_of_freedom), *_SIGMAS_PX)
        if fixed_print:
            return replace(self.noise, pixel_px=float(pixel))
        spread = C[first:].reshape(-1, 3)
        across = _component(state.offsets[:, :2], spread[:, :2], self.noise.print_mm)
        along = _component(state.offsets[:, 2:], spread[:, 2:], self.noise.flat_mm)
        return PictureNoise(float(pixel), across, along)

    def bundle(self, state: IntrinsicsState) -> Bundle:
        """The result at the minimum."""
        pictures = self._all_linearized(state)
        S, _ = self._reduced(state, pictures)
        k = len(state.intrinsics)
        held_out = []
        for rows in pictures:
            information = np.zeros_like(S)
            gradient = rows.reduce_into(information, np.zeros(len(S)))
            step = solved(S - information, gradient)
            residuals = rows.residuals + rows.residual_change(step)
            residuals -= rows.J_pose @ np.linalg.lstsq(rows.J_pose, residuals, rcond=None)[0]
            held_out.append(residuals.reshape(-1, 2) * self.noise.pixel_px)
        return Bundle(
            state,
            self.noise,
            inverse(S)[:k, :k],
            tuple(self._residuals(state)),
            tuple(held_out),
        )

    def _prior(self, state: IntrinsicsState) -> Array:
        """Information of the shared unknowns before any picture."""
        offsets = np.tile(
            [self.noise.print_mm**-2, self.noise.print_mm**-2, self.noise.flat_mm**-2],
            len(self.nominal),
        )
        lens = np.zeros(len(state.intrinsics))
        lens[4 + 5 :] = _RATIONAL_SIGMA**-2
        return np.concatenate([lens, np.full(2, _STRETCH_SIGMA**-2), offsets])

    def _shared(self, state: IntrinsicsState) -> Array:
        return np.concatenate([state.intrinsics, state.stretch, state.offsets.ravel()])

    def _cost(self, state: IntrinsicsState) -> float:
        squares = sum(float(np.sum(r * r)) for r in self._residuals(state))
        prior = self._prior(state) @ self._shared(state) ** 2
        total = squares / self.noise.pixel_px**2 + float(prior)
        return total / 2 if np.isfinite(total) else np.inf

    def _residuals(self, state: IntrinsicsState) -> list[Array]:
        points = self._points(state)
        K, d = _matrix(state.intrinsics), state.intrinsics[4:]
        residuals = []
        for view, pose in zip(self.views, state.poses, strict=True):
            points_in_camera = pose @ points[view.ids]
            pixels = cv2.projectPoints(points_in_camera, np.zeros(3), np.zeros(3), K, d)[0][:, 0]
            is_behind = points_in_camera[:, 2] <= 0
            residuals.append(np.where(is_behind[:, None], np.inf, pixels - view.pixels))
        return residuals

    def _points(self, state: IntrinsicsState) -> Array:
        a, s = state.stretch
        stretched = np.array([[a, s, 0], [s, -a, 0], [0, 0, 0]]) / 2
        return np.asarray(self.nominal + self.nominal @ stretched + state.offsets)

    def _linearized(self, state: IntrinsicsState, view: BoardView, pose: Pose) -> PictureRows:
        points = self._points(state)[view.ids]
        K, d = _matrix(state.intrinsics), state.intrinsics[4:]
        zero = np.zeros(3)
        pixels, D = cv2.projectPoints(pose @ points, zero, zero, K, d)
        n, k, sigma = len(points), len(state.intrinsics), self.noise.pixel_px
        J_point = (D[:, 3:6] @ pose.rotation).reshape(n, 2, 3)
        x, y, _ = self.nominal[view.ids].T / 2
        J_lens = np.zeros((n, 2, k + 2))
        J_lens[:, :, :k] = D[:, 6 : 6 + k].reshape(n, 2, k)
        J_lens[:, :, k] = J_point[:, :, 0] * x[:, None] - J_point[:, :, 1] * y[:, None]
        J_lens[:, :, k + 1] = J_point[:, :, 0] * y[:, None] + J_point[:, :, 1] * x[:, None]
        return PictureRows(
            (pixels[:, 0] - view.pixels).ravel() / sigma,
            J_lens.reshape(2 * n, -1) / sigma,
            J_point / sigma,
            np.asarray(D[:, _ORDER], np.float64) / sigma,
            (k + 2 + 3 * view.ids[:, None] + np.arange(3)).ravel(),
        )

    def _all_linearized(self, state: IntrinsicsState) -> list[PictureRows]:
        return [
            self._linearized(state, view, pose)
            for view, pose in zip(self.views, state.poses, strict=True)
        ]

    def _reduced(
        self, state: IntrinsicsState, pictures: Sequence[PictureRows], damping: float = 0.0
    ) -> tuple[Array, Array]:
        """Normal equations of the shared unknowns, poses eliminated: matrix and gradient."""
        prior = self._prior(state)
        S, g = np.diag(prior * (1 + damping)), prior * self._shared(state)
        for rows in pictures:
            rows.reduce_into(S, g, damping)
        return S, g

    def _step(
        self, state: IntrinsicsState, pictures: Sequence[PictureRows], damping: float
    ) -> IntrinsicsState:
        step = -solved(*self._reduced(state, pictures, damping))
        k = len(state.intrinsics)
        poses = [
            Pose.exp(rows.pose_step(step, damping)) @ pose
            for rows, pose in zip(pictures, state.poses, strict=True)
        ]
        return IntrinsicsState(
            state.intrinsics + step[:k],
            state.stretch + step[k : k + 2],
            state.offsets + step[k + 2 :].reshape(-1, 3),
            tuple(poses),
        )


def _matrix(intrinsics: Array) -> Array:
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _component(offsets: Array, variances: Array, sigma: float) -> float:
    """Standard deviation of a prior, as the offsets and their remaining variances show it."""
    degrees_of_freedom = offsets.size - float(variances.sum()) / sigma**2
    if degrees_of_freedom < 1:
        return sigma
    return float(np.clip(np.sqrt(np.sum(offsets**2) / degrees_of_freedom), *_SIGMAS_MM))


def _sigmas(noise: PictureNoise) -> Array:
    return np.array([noise.pixel_px, noise.print_mm, noise.flat_mm])
