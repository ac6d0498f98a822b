"""The fake arm: what it reports, where it truly is, and how it moves.

The truth differs from the report by a smooth error field over the workspace (geometry of the arm)
and by a deviation that is drawn anew for every move (repeatability). Moves run along a
minimum-jerk profile.
"""

from dataclasses import dataclass

import numpy as np

from fakes.world.arm_errors import RAD_PER_MM, ErrorField, deviated
from vgrd.geometry import Array, Pose

PEAK_OVER_MEAN = 1.875  # speed of a minimum-jerk profile
THERE_MM, THERE_RAD = 1e-6, 1e-9  # less than any interface tells


def minimum_jerk(elapsed_s: float, duration_s: float) -> float:
    """Share of the way, 0 to 1, after `elapsed_s` of a minimum-jerk move."""
    if duration_s <= 0:
        return 1.0
    x = min(max(elapsed_s / duration_s, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


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
        """Tell the share of the way, 0 to 1."""
        return minimum_jerk(now_s - self.started_s, self.duration_s)

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
        repeatability_mm: float = 0.03,  # as UR states for the UR5e
        field: ErrorField | None = None,
        reading_noise_mm: float = 0.0,
        speed_mm_s: float = 250.0,  # the most while teaching by hand (ISO 10218-1)
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
        """Start a move of the reported flange; returns the time of arrival.

        An arm that is there already does not move, and errs as before.
        """
        mm, rad = self._move.flange(now_s).distance(base_from_wrist)
        if not self.moving(now_s) and mm < THERE_MM and rad < THERE_RAD:
            return now_s
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
        return deviated(reported, deviation)

    def _drawn_deviation(self) -> Array:
        sigma = self._repeatability
        return np.concatenate(
            [self._rng.normal(0, 1, 3) * sigma, self._rng.normal(0, 1, 3) * sigma * RAD_PER_MM]
        )

    def _start(self, target: Pose, deviation: Array, now_s: float) -> float:
        start, start_deviation = self._move.flange(now_s), self._move.deviation(now_s)
        mm, rad = start.distance(target)
        duration = PEAK_OVER_MEAN * max(mm / self._speeds[0], rad / self._speeds[1])
        self._move = Move(start, target, start_deviation, deviation, now_s, duration)
        return now_s + duration
