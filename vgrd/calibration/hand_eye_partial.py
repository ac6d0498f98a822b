"""Hand-eye of robots that do not turn about two axes: 4-axis arms (SCARA, delta) and portals.

The camera's rotation then comes from the translations; what stays open is a translation of the
camera and of the target together along the axis (4-axis), or in every direction (no turn at all).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.hand_eye import HandEyeProblem, HandEyeResult, PoseSample, SampleResidual
from vgrd.calibration.hand_eye_certificate import certified_start
from vgrd.calibration.hand_eye_fit import move_of
from vgrd.calibration.motion import Axes, hand_eye_observability, refuse_repeats, turned_axes
from vgrd.calibration.rotation_relaxation import Certificate
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import covariance_from, whitener
from vgrd.geometry.least_squares import minimize, require_convergence
from vgrd.model import Finding, Mount

_TRANSLATION_ONLY = 0.05
_ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class PartialHandEye:
    """What is determined, and what is not.

    result: as of `calibrate_hand_eye`; the target's origin has no part (0 mm) along what is free,
    the camera lies accordingly, and the covariance (12, 12) has none there. free: (k, 6),
    orthonormal directions of (t of mount_from_camera, t of mount_from_target), k = 0, 1 or 3.
    findings name what is free and how to learn it; empty when nothing is.
    """

    result: HandEyeResult
    free: Array
    certificate: Certificate
    findings: tuple[Finding, ...]

    def shifted(self, target_along_axis_mm: float) -> tuple[Pose, Pose]:
        """mount_from_camera and mount_from_target when the target's place along the axis is known.

        mm along the axis that the finding names. Raises NotObservable unless one direction is free.
        """
        if len(self.free) != 1:
            raise NotObservable(
                f"hand-eye: {len(self.free)} directions are free, one height decides exactly one",
                rank=12 - len(self.free),
                unknowns=12,
            )
        shift = self.free[0] * np.sqrt(2) * target_along_axis_mm
        X, Y = self.result.mount_from_camera, self.result.mount_from_target
        return (
            Pose(X.rotation, X.translation + shift[:3]),
            Pose(Y.rotation, Y.translation + shift[3:]),
        )


def calibrate_hand_eye_partial(problem: HandEyeProblem) -> PartialHandEye:
    """Maximum likelihood of all that the motion determines, from the certified start.

    All samples count (`robust` and `estimate_scale` are not for this). Raises TooFewObservations,
    NotObservable (rotation of the camera open; names the missing motion), InputError (one pose
    twice) or DidNotConverge.
    """
    samples = problem.samples
    wrists = [s.base_from_wrist for s in samples]
    refuse_repeats([s.name for s in samples], wrists)
    _require_rotation(wrists)
    moves = [move_of(problem.mount, wrist) for wrist in wrists]
    sigma_mm, sigma_rad = _typical_sigmas(problem)
    start = certified_start(
        moves, [s.camera_from_target for s in samples], sigma_mm=sigma_mm, sigma_rad=sigma_rad
    )
    free = _signed(start.free)
    likelihood = _Likelihood(problem, moves, free)
    X, Y, covariance, noise = likelihood.maximize(_on_zero(start.X, start.Y, free))
    result = HandEyeResult(
        mount=problem.mount,
        mount_from_camera=X,
        mount_from_target=Y,
        covariance=covariance,
        noise_scale=noise,
        samples=tuple(
            _residual(s, X.inverse() @ m @ Y) for s, m in zip(samples, moves, strict=True)
        ),
    )
    return PartialHandEye(result, free, start.certificate, _findings(problem.mount, free))


def _require_rotation(wrists: Sequence[Pose]) -> None:
    """Raise unless nothing but translations stays open."""
    seen = hand_eye_observability(wrists)
    turning = seen.undetermined.reshape(-1, 2, 2, 3)[:, :, 1]
    if not np.any(np.linalg.norm(turning, axis=2) > _TRANSLATION_ONLY):
        return
    axes, axis = turned_axes([wrist.rotation for wrist in wrists])
    remedy = "move the wrist by 100 mm or more along two directions that are not in line"
    if axes is Axes.ONE:
        x, y, z = axis
        remedy = (
            f"the wrist turned about the axis ({x:.2f}, {y:.2f}, {z:.2f}) of the base without "
            "moving across it; move it by 100 mm or more across the axis, at two or more turns"
        )
    raise NotObservable(
        f"hand-eye: the robot poses determine {seen.rank} of 12 unknowns and leave the camera's "
        f"rotation open: {remedy}",
        rank=seen.rank,
        unknowns=12,
    )


def _typical_sigmas(problem: HandEyeProblem) -> tuple[float, float]:
    """sigma_mm, sigma_rad of the target's pose, per axis, robot noise included: root mean square."""
    variances = []
    for sample in problem.samples:
        place = np.hstack([np.eye(3), -hat(sample.camera_from_target.translation)])
        C = sample.covariance
        variances.append((np.trace(place @ C @ place.T) / 3, np.trace(C[3:, 3:]) / 3))
    mm, rad = np.mean(variances, axis=0)
    return (
        float(np.sqrt(mm + problem.robot_sigma_mm**2)),
        float(np.sqrt(rad + problem.robot_sigma_rad**2)),
    )


def _signed(free: Array) -> Array:
    """Each direction with the largest component of its target half positive."""
    signs = [np.sign(row[3:][np.argmax(np.abs(row[3:]))]) for row in free]
    return free * np.reshape(signs, (-1, 1))


def _on_zero(X: Pose, Y: Pose, free: Array) -> tuple[Pose, Pose]:
    """Both poses moved along what is free until the target's origin has no part of it."""
    amount = np.linalg.lstsq(free[:, 3:].T, Y.translation, rcond=None)[0]
    shift = amount @ free
    return (
        Pose(X.rotation, X.translation - shift[:3]),
        Pose(Y.rotation, Y.translation - shift[3:]),
    )


class _Likelihood:
    """log(predicted measured^-1), whitened by the noise of camera and robot, on what is not free."""

    def __init__(self, problem: HandEyeProblem, moves: Sequence[Pose], free: Array) -> None:
        self._problem = problem
        self._moves = moves
        blocked = np.zeros((len(free), 12))
        blocked[:, [0, 1, 2, 6, 7, 8]] = free
        self._basis = np.linalg.svd(blocked)[2][len(free) :].T if len(free) else np.eye(12)

    def maximize(self, start: tuple[Pose, Pose]) -> tuple[Pose, Pose, Array, float]:
        """X, Y, covariance (12, 12) of their left tangents, noise over the promised one."""
        state = start
        for _ in range(_ROUNDS):
            whiteners = self._whiteners(state)
            minimum = minimize(
                lambda at, W=whiteners: self._linearize(at, W),  # type: ignore[misc]
                self._retract,
                state,
            )
            require_convergence(minimum.report, "hand-eye")
            state = minimum.state
        freedom = minimum.jacobian.shape[0] - minimum.jacobian.shape[1]
        variance = float(minimum.residuals @ minimum.residuals) / max(freedom, 1)
        C = self._basis @ covariance_from(minimum.jacobian) @ self._basis.T
        return *state, C * max(1.0, variance), float(np.sqrt(variance))

    def _retract(self, state: tuple[Pose, Pose], step: Array) -> tuple[Pose, Pose]:
        xi = self._basis @ step
        return Pose.exp(xi[:6]) @ state[0], Pose.exp(xi[6:]) @ state[1]

    def _whiteners(self, state: tuple[Pose, Pose]) -> list[Array]:
        p = self._problem
        S = np.diag([p.robot_sigma_mm**2] * 3 + [p.robot_sigma_rad**2] * 3)
        camera_from_mount = state[0].inverse()
        out = []
        for sample, move in zip(p.samples, self._moves, strict=True):
            lever = camera_from_mount @ move if p.mount is Mount.EYE_TO_HAND else camera_from_mount
            G = lever.adjoint()
            out.append(whitener(sample.covariance + G @ S @ G.T))
        return out

    def _linearize(
        self, state: tuple[Pose, Pose], whiteners: Sequence[Array]
    ) -> tuple[Array, Array]:
        X, Y = state
        camera_from_mount = X.inverse()
        by_X = -camera_from_mount.adjoint()
        residuals, rows = [], []
        for sample, move, W in zip(self._problem.samples, self._moves, whiteners, strict=True):
            turn = camera_from_mount @ move
            e = (turn @ Y @ sample.camera_from_target.inverse()).log()
            D = W @ np.linalg.inv(Pose.left_jacobian(e))
            residuals.append(W @ e)
            rows.append(D @ np.hstack([by_X, turn.adjoint()]) @ self._basis)
        return np.concatenate(residuals), np.vstack(rows)


def _residual(sample: PoseSample, predicted: Pose) -> SampleResidual:
    mm, rad = predicted.distance(sample.camera_from_target)
    return SampleResidual(sample.name, used=True, reason="", deg=float(np.degrees(rad)), mm=mm)


def _findings(mount: Mount, free: Array) -> tuple[Finding, ...]:
    """What stays open, in words."""
    if not len(free):
        return ()
    holder, other = ("wrist", "base") if mount is Mount.EYE_TO_HAND else ("base", "wrist")
    if len(free) > 1:
        message = (
            "the wrist did not turn: where the camera is stays open in all directions, its "
            f"rotation does not; the target's origin is taken at the origin of the {holder}; "
            "turn the wrist, or measure where the target is"
        )
        return (Finding("position_free", message),)
    x, y, z = np.sqrt(2) * free[0, 3:]
    u, v, w = np.sqrt(2) * free[0, :3]
    message = (
        f"the wrist turned about one axis only: the target's height along ({x:.2f}, {y:.2f}, "
        f"{z:.2f}) of the {holder} stays open and is taken as 0 mm; the camera's place along "
        f"({u:.2f}, {v:.2f}, {w:.2f}) of the {other} depends on it. Measure that height, touch "
        "one point, or tilt the wrist; expected coordinates at this tilt do not need it"
    )
    return (Finding("height_free", message),)
