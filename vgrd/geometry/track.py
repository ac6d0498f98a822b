"""A pose that moves, known at some instants: where it is between them.

Piecewise cubic (Catmull and Rom 1974, steps of any length): it goes through every pose and has one
velocity at each. A straight line between poses would lag behind an arm that speeds up, at 10 Hz by
more than a touch is good for.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry.pose import Array, Pose, log_rotation

_LEAST_STEP_S = 1e-3  # half of the shortest period (500 Hz): closer instants are one


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """stamps_s: (n,) ascending, n >= 2; rotations (n, 3, 3), positions (n, 3) of the pose then."""

    stamps_s: Array
    rotations: Array
    positions: Array

    @classmethod
    def of(cls, stamps_s: Sequence[float], poses: Sequence[Pose]) -> "PoseTrack":
        """From instants in any order; those that repeat an earlier one are left out.

        InputError for fewer than two different ones.
        """
        order = np.argsort(np.asarray(stamps_s, dtype=np.float64), kind="stable")
        stamps = np.asarray(stamps_s, dtype=np.float64)[order]
        kept = order[np.diff(stamps, prepend=-np.inf) >= _LEAST_STEP_S]
        if len(kept) < 2:
            raise InputError(f"a track needs poses of two different times, got {len(kept)}")
        return cls(
            np.asarray(stamps_s, dtype=np.float64)[kept],
            np.array([poses[k].rotation for k in kept]),
            np.array([poses[k].translation for k in kept]),
        )

    def covers(self, times_s: Array, longest_step_s: float) -> Array:
        """Whether (m,) instants lie between two poses (m,) that are no farther apart in time."""
        k = np.searchsorted(self.stamps_s, times_s, side="right")
        inside = (k > 0) & (k < len(self.stamps_s))
        k = np.clip(k, 1, len(self.stamps_s) - 1)
        return np.asarray(inside & (self.stamps_s[k] - self.stamps_s[k - 1] <= longest_step_s))

    def at(self, times_s: Array) -> tuple[Array, Array]:
        """Rotations (m, 3, 3) and positions (m, 3) at (m,) instants; outside, those of the ends."""
        times_s = np.clip(times_s, self.stamps_s[0], self.stamps_s[-1])
        t, n = self.stamps_s, len(self.stamps_s)
        k = np.clip(np.searchsorted(t, times_s, side="right") - 1, 0, n - 2)
        around = np.stack([np.maximum(k - 1, 0), k, k + 1, np.minimum(k + 2, n - 1)], axis=1)
        origin = self.rotations[k]
        turns = log_rotation(self.rotations[around] @ np.swapaxes(origin, 1, 2)[:, None])
        y = np.concatenate([self.positions[around], turns], axis=2)
        value = _cubic(t[around], y, times_s)
        R = Rotation.from_rotvec(value[:, 3:]).as_matrix() @ origin
        return np.asarray(R), value[:, :3]

    def twists(self, times_s: Array, half_s: float) -> Array:
        """Mean twists (m, 6) from `half_s` before (m,) instants to as long after them.

        (v, w), mm/s and rad/s: the pose a moment dt later is exp(dt twist) @ pose.
        """
        (R0, p0), (R1, p1) = self.at(times_s - half_s), self.at(times_s + half_s)
        w = log_rotation(R1 @ np.swapaxes(R0, 1, 2))
        v = p1 - p0 - np.cross(w, 0.5 * (p0 + p1))
        return np.concatenate([v, w], axis=1) / (2 * half_s)


def _cubic(t: Array, y: Array, at: Array) -> Array:
    """Value (m, 6) between the middle two of four instants t (m, 4), of y (m, 4, 6)."""
    h = (t[:, 2] - t[:, 1])[:, None]
    start, end = y[:, 1], y[:, 2]
    m0, m1 = _slope(t[:, :3], y[:, :3]), _slope(t[:, 1:], y[:, 1:])
    u = (at[:, None] - t[:, 1:2]) / h
    return np.asarray(
        (1 + 2 * u) * (1 - u) ** 2 * start
        + u * (1 - u) ** 2 * h * m0
        + u**2 * (3 - 2 * u) * end
        + u**2 * (u - 1) * h * m1
    )


def _slope(t: Array, y: Array) -> Array:
    """Rate (m, 6) at the middle of three instants: of the parabola through them.

    At an end of the track, where two are the same, that of the line.
    """
    before, after = (t[:, 1] - t[:, 0])[:, None], (t[:, 2] - t[:, 1])[:, None]
    a = (y[:, 1] - y[:, 0]) / np.where(before > 0, before, 1.0)
    b = (y[:, 2] - y[:, 1]) / np.where(after > 0, after, 1.0)
    return np.asarray((a * after + b * before) / (before + after))
