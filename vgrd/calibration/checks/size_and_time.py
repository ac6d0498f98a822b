"""The size of tag A and the age of the pictures, both against the robot's motion.

One linear step of the hand-eye equations around the closed form, with two unknowns more: the scale
of the target and the time by which a picture is later than its pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.checks.pose_agreement import Poses, agreement
from vgrd.calibration.hand_eye import PoseSample
from vgrd.errors import NotObservable
from vgrd.geometry import Array, hat, log_rotation
from vgrd.geometry.covariance import covariance_from, sqrt_information
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import REACH_MM
from vgrd.model import Finding, Mount, Observation, Recording, Stability

_SIGMAS = 4.0  # 1 in 16,000 good files is doubted
_SIZE_MATTERS = 4e-3  # 0.1 mm of a tag of 25 mm: what a caliper shows
_STEP_S = 0.35  # looks farther apart tell no velocity
_MIN_MOVING = 6  # one unknown more than a hand-eye step, with samples to spare
_MOVING_MM_S = 5.0  # slower, 10 ms of delay are 0.05 mm
_TIME_MATTERS_MM = 0.1  # what the delay shifts, at the median speed
_CAUCHY = 2.385  # 95 % efficiency with normal noise (Rey 1983)
_ROUNDS = 3  # of reweighing
_MIN_SAMPLES = 4  # three determine the poses, one more the scale
_LEAST_SIGMA_MM = 1e-3  # keeps an arm that states no error solvable


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard deviation."""

    value: float
    sigma: float

    def differs(self, expected: float, at_least: float) -> bool:
        """Whether it is off by more than chance and more than matters."""
        return abs(self.value - expected) > max(_SIGMAS * self.sigma, at_least)


def tag_size(samples: Sequence[PoseSample], recording: Recording) -> Finding | None:
    """Tag A's edge as the robot's motion sees it, where it contradicts the file."""
    tag = recording.facts.tag_a
    scale = target_scale(samples, recording)
    if tag is None or scale is None or not scale.differs(1.0, _SIZE_MATTERS):
        return None
    size, sigma = scale.value * tag.size_mm, scale.sigma * tag.size_mm
    return finding(
        "tag_size",
        f"tag A measures {size:.2f} +- {sigma:.2f} mm against the robot's motion, the file says "
        f"{tag.size_mm:g}",
    )


def target_scale(samples: Sequence[PoseSample], recording: Recording) -> Measured | None:
    """True over stated size of tag A; None where the motion does not tell."""
    if len(samples) < _MIN_SAMPLES:
        return None
    step = _Step(samples, recording)
    return step.solve(
        -np.concatenate([step.levers, np.zeros_like(step.levers)], axis=1), start=1.0
    )


def time_offset(recording: Recording) -> Finding | None:
    """How much later than their poses the pictures were taken; looks on the move tell it.

    Needs looks that follow each other within a third of a second, six of them moving; a camera
    that stands still. None otherwise, and where the offset is not beyond chance.
    """
    facts = recording.facts
    if facts.mount is not Mount.EYE_TO_HAND or facts.camera_stability is Stability.MOVABLE:
        return None
    looks = sorted((s for s in recording.looks if s.tag_a), key=lambda look: look.stamp_s)
    moving = _twists(looks)
    fast = [k for k, twist in moving.items() if np.linalg.norm(twist[:3]) > _MOVING_MM_S]
    if len(fast) < _MIN_MOVING:
        return None
    samples = [
        PoseSample("", look.base_from_wrist, look.tag_a.camera_from_tag, look.tag_a.covariance)
        for look in looks
        if look.tag_a is not None
    ]
    step = _Step(samples, recording)
    columns = np.zeros((len(looks), 6))
    for k, twist in moving.items():
        columns[k] = step.moved(k, twist)
    late = step.solve(columns, start=0.0)
    speed = float(np.median([np.linalg.norm(moving[k][:3]) for k in fast]))
    if late is None or not late.differs(0.0, _TIME_MATTERS_MM / speed):
        return None
    return finding(
        "time_offset",
        f"pictures show the robot {1e3 * abs(late.value):.0f} +- {1e3 * late.sigma:.0f} ms "
        f"{'after' if late.value > 0 else 'before'} the pose recorded with them, at "
        f"{speed:.0f} mm/s that is {abs(late.value) * speed:.1f} mm",
        fatal=True,
    )


def _twists(looks: Sequence[Observation]) -> dict[int, Array]:
    """Velocity (6,), mm/s and rad/s in the base, of the looks whose neighbours are near in time.

    The first three numbers are of the flange's origin.
    """
    twists = {}
    for k in range(1, len(looks) - 1):
        start, end = looks[k - 1], looks[k + 1]
        dt = end.stamp_s - start.stamp_s
        if not 0 < dt < 2 * _STEP_S:
            continue
        a, b = start.base_from_wrist, end.base_from_wrist
        v = (b.translation - a.translation) / dt
        twists[k] = np.concatenate([v, log_rotation(b.rotation @ a.rotation.T) / dt])
    return twists


class _Step:
    """Rows of `M_i Y = X C_i`, whitened, at the closed form: translation, then rotation.

    Unknowns: left turns of X and Y's rotations, and the two translations; levers: R_X t_C, (n, 3).
    """

    def __init__(self, samples: Sequence[PoseSample], recording: Recording) -> None:
        facts = recording.facts
        wrists = Poses.of([sample.base_from_wrist for sample in samples])
        self._moves = wrists if facts.mount is Mount.EYE_TO_HAND else wrists.inverted()
        self._cameras = Poses.of([sample.camera_from_target for sample in samples])
        self._fit = agreement(self._moves, self._cameras, unit_known=True)
        self.levers = self._cameras.translations @ self._fit.X.rotation.T
        covariances = np.array([sample.covariance for sample in samples])
        self._W = self._whiteners(covariances, max(facts.robot_sigma_mm, _LEAST_SIGMA_MM))

    def moved(self, k: int, twist: Array) -> Array:
        """What a second of that motion of the flange adds to the rows (6,) of a sample."""
        lever = self._moves.rotations[k] @ self._fit.Y.translation
        return np.concatenate([twist[:3] + np.cross(twist[3:], lever), twist[3:]])

    def solve(self, column: Array, *, start: float) -> Measured | None:
        """The further unknown with derivatives (n, 6); None where it is not determined."""
        residuals, rows = self._rows(column)
        weights = np.ones(len(rows))
        n = len(rows)
        for _ in range(_ROUNDS):
            r = (residuals * weights[:, None]).ravel()
            J = (rows * weights[:, None, None]).reshape(6 * n, 13)
            try:
                C = covariance_from(J)
            except NotObservable:
                return None
            x = -C @ (J.T @ r)
            misses = np.sqrt(np.mean((residuals + rows @ x) ** 2, axis=1))
            typical = max(1.0, float(np.median(misses)))
            weights = 1 / np.sqrt(1 + (misses / typical / _CAUCHY) ** 2)
        return Measured(start + float(x[-1]), typical * float(np.sqrt(C[-1, -1])))

    def _rows(self, column: Array) -> tuple[Array, Array]:
        fit, R_M, n = self._fit, self._moves.rotations, len(self._moves)
        e = np.empty((n, 6))
        e[:, :3] = self._moves.translations + R_M @ fit.Y.translation - fit.X.translation
        e[:, :3] -= self.levers
        predicted = fit.X.rotation @ self._cameras.rotations
        e[:, 3:] = log_rotation(R_M @ fit.Y.rotation @ np.swapaxes(predicted, 1, 2))
        J = np.zeros((n, 6, 13))
        J[:, :3, :3] = hat(self.levers)
        J[:, :3, 3:6] = -np.eye(3)
        J[:, :3, 9:12] = R_M
        J[:, 3:, :3] = -np.eye(3)
        J[:, 3:, 6:9] = R_M
        J[:, :, 12] = column
        return np.einsum("nij,nj->ni", self._W, e), self._W @ J

    def _whiteners(self, covariances: Array, sigma_mm: float) -> Array:
        n, R_X = len(self._moves), self._fit.X.rotation
        J_camera = np.zeros((n, 6, 6))
        J_camera[:, :3, :3] = J_camera[:, 3:, 3:] = R_X
        J_camera[:, :3, 3:] = -R_X @ hat(self._cameras.translations)
        J_robot = np.zeros((n, 6, 6))
        J_robot[:, :3, :3] = J_robot[:, 3:, 3:] = np.eye(3)
        J_robot[:, :3, 3:] = -hat(self._moves.rotations @ self._fit.Y.translation)
        S = np.diag([sigma_mm**2] * 3 + [(sigma_mm / REACH_MM) ** 2] * 3)
        noise = J_camera @ covariances @ np.swapaxes(J_camera, 1, 2)
        return sqrt_information(noise + J_robot @ S @ np.swapaxes(J_robot, 1, 2))
