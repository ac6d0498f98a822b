"""The fake arm: what it reports, where it truly is, and how it moves.

The truth differs from the report by a smooth error field over the workspace (geometry of the arm)
and by a deviation that is drawn anew for every move (repeatability). Moves run along a
minimum-jerk profile.
"""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose

_WAVES = 6
_RAD_PER_MM = 0.75e-3  # rotation that comes with the field's translation: 0.15 mrad at 0.2 mm


@dataclass(frozen=True, slots=True, eq=False)
class ErrorField:
    """A smooth deviation of the arm: a sum of sinusoids of 400 to 1200 mm wave length.

    waves: (n, 3) rad/mm; phases: (n, 6); weights: (n, 6) mm and rad per wave.
    """

    waves: Array
    phases: Array
    weights: Array

    @classmethod
    def random(cls, seed: int, peak_mm: float, workspace_mm: Array) -> "ErrorField":
        """Draw a field whose largest translation over `workspace_mm` (2, 3) is `peak_mm`."""
        rng = np.random.default_rng((seed, 1))
        directions = rng.standard_normal((_WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        waves = directions * (2 * np.pi / rng.uniform(400, 1200, (_WAVES, 1)))
        weights = rng.standard_normal((_WAVES, 6)) * ([1.0] * 3 + [_RAD_PER_MM] * 3)
        unscaled = cls(waves, rng.uniform(0, 2 * np.pi, (_WAVES, 6)), weights)
        box = np.linspace(workspace_mm[0], workspace_mm[1], 9).T
        grid = np.stack(np.meshgrid(*box), -1).reshape(-1, 3)
        peak = max(float(np.linalg.norm(unscaled.tangent(p)[:3])) for p in grid)
        return cls(waves, unscaled.phases, weights * (peak_mm / peak))

    def tangent(self, flange_in_base: Array) -> Array:
        """Deviation (6,) at a flange position (3,): (mm, rad) in the base frame."""
        return np.asarray(
            (self.weights * np.sin((self.waves @ flange_in_base)[:, None] + self.phases)).sum(0)
        )


def _deviated(pose: Pose, deviation: Array) -> Pose:
    """Shift `pose` by deviation[:3], turn it about its own origin by deviation[3:], base axes."""
    return Pose(
        Pose.from_rotvec(deviation[3:]).rotation @ pose.rotation,
        pose.translation + deviation[:3],
    )


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A straight minimum-jerk move of the reported flange; deviations (6,) fade over."""

    start: Pose
    end: Pose
    start_deviation: Array
    end_deviation: Array
    started_s: float
    duration_s: float

    def progress(self, now_s: float) -> float:
        """Tell the share of the way, 0 to 1 (minimum jerk)."""
        if self.duration_s <= 0:
            return 1.0
        x = min(max((now_s - self.started_s) / self.duration_s, 0.0), 1.0)
        return x**3 * (10 - 15 * x + 6 * x * x)

    def flange(self, now_s: float) -> Pose:
        """Tell the reported flange at a time."""
        share = self.progress(now_s)
        if share >= 1:
            return self.end
        turn = Pose(self.end.rotation @ self.start.rotation.T, np.zeros(3)).rotvec()
        way = self.end.translation - self.start.translation
        return Pose(
            Pose.from_rotvec(share * turn).rotation @ self.start.rotation,
            self.start.translation + share * way,
        )

    def velocity(self, now_s: float) -> Array:
        """Tell the velocity (6,) of the reported flange, mm/s and rad/s in base axes."""
        x = (now_s - self.started_s) / self.duration_s if self.duration_s > 0 else 1.0
        if not 0 < x < 1:
            return np.zeros(6)
        turn = Pose(self.end.rotation @ self.start.rotation.T, np.zeros(3)).rotvec()
        way = self.end.translation - self.start.translation
        rate = 30 * (x * (1 - x)) ** 2 / self.duration_s
        return np.concatenate([way, turn]) * rate

    def deviation(self, now_s: float) -> Array:
        """Deviation (6,) of the truth from the report, besides the error field."""
        share = self.progress(now_s)
        return (1 - share) * self.start_deviation + share * self.end_deviation


class Arm:
    """One robot arm with its controller's active TCP.

    repeatability_mm: rms length of the deviation drawn for each move; field: error field or None;
    reading_noise_mm: rms noise of a reported position per axis. All times are the caller's clock.
    """

    def __init__(
        self,
        start: Pose,
        wrist_from_tcp: Pose,
        *,
        seed: int,
        repeatability_mm: float = 0.03,
        field: ErrorField | None = None,
        reading_noise_mm: float = 0.0,
        speed_mm_s: float = 250.0,
        speed_rad_s: float = 1.0,
    ) -> None:
        self.wrist_from_tcp = wrist_from_tcp
        self._rng = np.random.default_rng((seed, 2))
        self._repeatability = repeatability_mm / np.sqrt(3)
        self._field = field
        self._reading_noise = reading_noise_mm
        self._speeds = (speed_mm_s, speed_rad_s)
        self._move = Move(start, start, np.zeros(6), np.zeros(6), -np.inf, 0.0)

    def reported_flange(self, now_s: float) -> Pose:
        """Tell what the encoders and the controller's kinematics say."""
        pose = self._move.flange(now_s)
        if not self._reading_noise:
            return pose
        noise = self._rng.normal(0, self._reading_noise, 3)
        return Pose(pose.rotation, pose.translation + noise)

    def reported_tcp(self, now_s: float) -> Pose:
        """`base_from_tcp` with the active TCP."""
        return self.reported_flange(now_s).compose(self.wrist_from_tcp)

    def true_flange(self, now_s: float) -> Pose:
        """Where the flange really is."""
        move = self._move
        return self._true(move.flange(now_s), move.deviation(now_s))

    def true_at(self, reported: Pose) -> Pose:
        """Where the flange is when the controller reports this pose, repeatability left out."""
        return self._true(reported, np.zeros(6))

    def velocity(self, now_s: float) -> Array:
        """Tell the velocity (6,) of the reported flange, mm/s and rad/s in base axes."""
        return self._move.velocity(now_s)

    def moving(self, now_s: float) -> bool:
        """Tell whether the current move has not arrived yet."""
        return now_s < self._move.started_s + self._move.duration_s

    def move_flange(self, base_from_wrist: Pose, now_s: float) -> float:
        """Start a move of the reported flange; returns the time of arrival."""
        return self._start(base_from_wrist, self._drawn_deviation(), now_s)

    def move_tcp(self, base_from_tcp: Pose, now_s: float) -> float:
        """Move the active TCP to a pose, as a controller does: flange = pose * inverse(tcp)."""
        return self.move_flange(base_from_tcp.compose(self.wrist_from_tcp.inverse()), now_s)

    def jog_to_true(self, true_flange: Pose, now_s: float) -> float:
        """Jog until the flange truly stands there, whatever the controller shows; return when."""
        deviation = self._drawn_deviation()
        reported = true_flange
        for _ in range(4):
            there = self._true(reported, deviation)
            reported = Pose(
                true_flange.rotation @ there.rotation.T @ reported.rotation,
                reported.translation + true_flange.translation - there.translation,
            )
        return self._start(reported, deviation, now_s)

    def _true(self, reported: Pose, deviation: Array) -> Pose:
        if self._field is not None:
            deviation = deviation + self._field.tangent(reported.translation)
        return _deviated(reported, deviation)

    def _drawn_deviation(self) -> Array:
        sigma = self._repeatability
        return np.concatenate(
            [self._rng.normal(0, 1, 3) * sigma, self._rng.normal(0, 1, 3) * sigma * _RAD_PER_MM]
        )

    def _start(self, target: Pose, deviation: Array, now_s: float) -> float:
        here, here_deviation = self._move.flange(now_s), self._move.deviation(now_s)
        mm, rad = here.distance(target)
        peak = 1.875  # peak speed of a minimum-jerk profile over its mean
        duration = peak * max(mm / self._speeds[0], rad / self._speeds[1])
        self._move = Move(here, target, here_deviation, deviation, now_s, duration)
        return now_s + duration
