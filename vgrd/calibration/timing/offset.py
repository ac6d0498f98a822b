"""The time between poses and pictures, by maximum likelihood from pictures of the moving arm.

Picture i with stamp s_i, the configured delay included, shows tag A at
C_i = X^-1 M(s_i + d + r (row_i - 1/2)) Y, with X the camera in the base, Y tag A on the flange, M the
track of the flange. Unknown are the offset d, the time r that the shutter takes to roll over a
picture, X and Y (nuisance, which pictures at rest hold too), and how much the stamps jitter: a
variance that is estimated with them (Mandel and Paule 1970).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, hat, log_rotation
from vgrd.geometry.covariance import covariance_from, sqrt_information
from vgrd.geometry.track import PoseTrack
from vgrd.judging.thresholds import REACH_MM
from vgrd.model import CellFacts, MovingSight, Observation, Stability

MOST_SIGMA_S = 1e-3  # 3 ms are 3 sigma: what is less certain is not told as known
WIDEST_S = 0.25  # of an offset: a camera's pipeline takes a few frames
_GRID_S = 0.02  # a jog speeds up and slows down over a tenth of a second and more
_LEAST_PICTURES = 8  # moving ones: two unknowns more than a pose, and the jitter
_MOVING_MM_S = 5.0  # of the flange; slower ones tell 10 ms by 0.05 mm, which is noise
_SMOOTH_S = 0.04  # either way: ten poses of a UR, less than a jog takes to speed up
_LONGEST_STEP_S = 0.3  # between poses: five a second, and half of that lost
_ROLL_SIGMA_S = 0.03  # a guess: shutters roll in 10 to 60 ms, one that does not in 0
_CAUCHY = 2.385  # 95 % efficiency with normal noise (Rey 1983)
_ROUNDS = 12  # of weights and jitter; the offset settles in three to five
_LEAST_SIGMA_MM = 1e-3  # keeps an arm that states no error solvable


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How much later than it was believed pictures were taken, by the clock of the poses.

    offset_s: positive where a picture shows the arm where it was only later. sigma_s: of
    it; jitter_s: how much single stamps scatter; roll_s: time from the first row of a picture to the
    last. pictures: of the moving arm. configured_s: the delay that was reckoned with already.
    unknown: why none is told, else "".
    """

    offset_s: float = 0.0
    sigma_s: float = float("inf")
    jitter_s: float = 0.0
    roll_s: float = 0.0
    pictures: int = 0
    configured_s: float = 0.0
    unknown: str = ""

    @property
    def delay_s(self) -> float:
        """In all, what was configured included."""
        return self.configured_s + self.offset_s

    def to_json(self) -> dict[str, object]:
        """For the summary of a session; ms, null where it is not known."""
        known = not self.unknown
        return {
            "offset_ms": 1e3 * self.offset_s if known else None,
            "delay_ms": 1e3 * self.delay_s if known else None,
            "sigma_ms": 1e3 * self.sigma_s if np.isfinite(self.sigma_s) else None,
            "jitter_ms": 1e3 * self.jitter_s if known else None,
            "pictures": self.pictures,
            "unknown": self.unknown,
        }


def find_time_offset(
    facts: CellFacts,
    track: PoseTrack,
    moving: Sequence[MovingSight],
    rests: Sequence[Observation],
    base_from_camera: Pose,
    wrist_from_tag_a: Pose,
) -> TimeOffset:
    """The offset, or why it is unknown: too little motion, too few pictures, a camera that people move.

    track: of the flange. moving: pictures of the moving arm; rests: of the arm at rest. The two
    poses are where the search starts, as the session was solved.
    """
    if facts.camera_stability is Stability.MOVABLE:
        return TimeOffset(
            unknown="a camera that people move may itself have moved between pictures"
        )
    usable = [sight for sight in moving if sight.tag_a is not None and _is_within(track, sight)]
    fast = [sight for sight in usable if _speed(track, sight) >= _MOVING_MM_S]
    if len(fast) < _LEAST_PICTURES:
        return TimeOffset(
            pictures=len(fast),
            unknown=f"{len(fast)} pictures show tag A on the moving arm, {_LEAST_PICTURES} are "
            "needed: jog with tag A in view while a session records",
        )
    problem = _Problem(facts, track, fast, [r for r in rests if r.tag_a is not None])
    found = problem.solve(base_from_camera, wrist_from_tag_a)
    return replace(found, configured_s=fast[-1].delay_s)


def _is_within(track: PoseTrack, sight: MovingSight) -> bool:
    """Whether the flange is known wherever the picture may belong."""
    times = sight.taken_s + np.arange(-WIDEST_S, WIDEST_S + _GRID_S, _GRID_S)
    return bool(track.covers(times, _LONGEST_STEP_S).all())


def _speed(track: PoseTrack, sight: MovingSight) -> float:
    """Of the flange's origin, mm/s."""
    (twist,) = track.twists(np.array([sight.taken_s]), _SMOOTH_S)
    at = sight.base_from_wrist.translation
    return float(np.linalg.norm(twist[:3] + np.cross(twist[3:], at)))


@dataclass(frozen=True, slots=True, eq=False)
class _Unknowns:
    """Offset and roll, s; camera and tag."""

    times_s: Array
    X: Pose
    Y: Pose

    def moved(self, step: Array) -> "_Unknowns":
        return _Unknowns(
            self.times_s + step[:2], Pose.exp(step[2:8]) @ self.X, self.Y @ Pose.exp(step[8:])
        )


class _Problem:
    """Rows of all pictures, moving ones first."""

    def __init__(
        self,
        facts: CellFacts,
        track: PoseTrack,
        moving: Sequence[MovingSight],
        rests: Sequence[Observation],
    ) -> None:
        self._track, self._count = track, len(moving)
        self._stamps_s = np.array([sight.taken_s for sight in moving])
        seen = [sight.tag_a for sight in moving] + [rest.tag_a for rest in rests]
        tags = [tag for tag in seen if tag is not None]
        rows = np.array([tag.corners_px[:, 1].mean() for tag in tags[: self._count]])
        self._rows = rows / facts.image_size_px[1] - 0.5
        self._R_C = np.array([tag.camera_from_tag.rotation for tag in tags])
        self._t_C = np.array([tag.camera_from_tag.translation for tag in tags])
        self._R_rest = np.array([r.base_from_wrist.rotation for r in rests]).reshape(-1, 3, 3)
        self._t_rest = np.array([r.base_from_wrist.translation for r in rests]).reshape(-1, 3)
        sigma_mm = max(facts.robot_sigma_mm, _LEAST_SIGMA_MM)
        self._noise = np.array([tag.covariance for tag in tags]) + self._arm_noise(sigma_mm)

    def solve(self, X: Pose, Y: Pose) -> TimeOffset:
        """The most likely offset; unknown where it lies at the edge or is not certain enough."""
        here = self._start(X, Y)
        jitter_s, weights = 0.0, np.ones(len(self._noise))
        scale, C = 1.0, np.eye(14)
        for _ in range(_ROUNDS):
            r, J = self._linearized(here)
            W = self._whiteners(J, jitter_s)
            e, A = np.einsum("nij,nj->ni", W, r), W @ J
            prior = np.zeros((1, 14))
            prior[0, 1] = 1 / _ROLL_SIGMA_S
            stacked = np.vstack([(A * weights[:, None, None]).reshape(-1, 14), prior])
            miss = np.append((e * weights[:, None]).ravel(), here.times_s[1] / _ROLL_SIGMA_S)
            try:
                C = covariance_from(stacked)
            except NotObservable:
                return self._unknown("the arm moved too little")
            here = here.moved(-C @ (stacked.T @ miss))
            left = self._linearized(here)[0]
            sizes = np.sqrt(np.mean(np.einsum("nij,nj->ni", W, left) ** 2, axis=1))
            scale = max(1.0, float(np.median(sizes)))
            weights = 1 / np.sqrt(1 + (sizes / scale / _CAUCHY) ** 2)
            jitter_s = self._jitter_s(left, J)
        sigma_s = scale * float(np.sqrt(C[0, 0]))
        return self._judged(here, sigma_s, jitter_s)

    def _judged(self, here: _Unknowns, sigma_s: float, jitter_s: float) -> TimeOffset:
        offset_s, roll_s = (float(value) for value in here.times_s)
        if abs(offset_s) > WIDEST_S:
            return self._unknown(f"it would be more than {1e3 * WIDEST_S:.0f} ms")
        if not sigma_s <= MOST_SIGMA_S:
            return self._unknown(
                f"it is certain to {1e3 * sigma_s:.1f} ms only, {1e3 * MOST_SIGMA_S:g} are needed: "
                "jog longer and faster, to and fro, with tag A in view",
                sigma_s,
            )
        return TimeOffset(offset_s, sigma_s, jitter_s, roll_s, self._count)

    def _unknown(self, why: str, sigma_s: float = float("inf")) -> TimeOffset:
        return TimeOffset(sigma_s=sigma_s, pictures=self._count, unknown=why)

    def _start(self, X: Pose, Y: Pose) -> _Unknowns:
        """The best offset of a grid, camera and tag as they are."""
        offsets = np.arange(-WIDEST_S, WIDEST_S + _GRID_S / 2, _GRID_S)
        starts = [_Unknowns(np.array([offset, 0.0]), X, Y) for offset in offsets]
        W = sqrt_information(self._noise)
        return min(starts, key=lambda start: self._roughly(start, W))

    def _roughly(self, start: _Unknowns, W: Array) -> float:
        """How badly a start fits; one wild picture counts little."""
        e = np.einsum("nij,nj->ni", W, self._linearized(start)[0])[: self._count]
        return float(np.sum(np.log1p(np.mean(e**2, axis=1))))

    def _linearized(self, here: _Unknowns) -> tuple[Array, Array]:
        """Left tangents (n, 6) from predicted to seen tags, and their derivatives (n, 6, 14)."""
        m, n = self._count, len(self._noise)
        times = self._stamps_s + here.times_s[0] + here.times_s[1] * self._rows
        R_M, t_M = self._track.at(times)
        R_M, t_M = np.concatenate([R_M, self._R_rest]), np.concatenate([t_M, self._t_rest])
        camera_from_base = here.X.inverse()
        R = camera_from_base.rotation @ R_M @ here.Y.rotation
        t = (R_M @ here.Y.translation + t_M) @ camera_from_base.rotation.T
        t = t + camera_from_base.translation
        w = log_rotation(self._R_C @ np.swapaxes(R, 1, 2))
        r = np.zeros((n, 6))
        r[:, 3:] = w
        # To first order in the turn, about half of it: exact enough for a few mrad.
        r[:, :3] = self._t_C - t - np.cross(w, 0.5 * (self._t_C + t))
        A = camera_from_base.adjoint()
        J = np.zeros((n, 6, 14))
        # Of a while, not of a moment: the poses' stamps jitter, and that must not reach the rows.
        J[:m, :, 0] = -self._track.twists(times, _SMOOTH_S) @ A.T
        J[:m, :, 1] = J[:m, :, 0] * self._rows[:, None]
        J[:, :, 2:8] = A
        J[:, :3, 8:11] = J[:, 3:, 11:] = -R
        J[:, :3, 11:] = -hat(t) @ R
        return r, J

    def _whiteners(self, J: Array, jitter_s: float) -> Array:
        """Inverse roots (n, 6, 6) of the noise, a moving picture's stamp being uncertain too."""
        noise = self._noise.copy()
        late = jitter_s * J[: self._count, :, 0]
        noise[: self._count] += late[:, :, None] * late[:, None, :]
        return sqrt_information(noise)

    def _jitter_s(self, r: Array, J: Array) -> float:
        """Standard deviation of the stamps, from the time (m,) by which each picture is off."""
        W = sqrt_information(self._noise[: self._count])
        along = np.einsum("nij,nj->ni", W, J[: self._count, :, 0])
        information = np.sum(along**2, axis=1)
        off_s = np.sum(along * np.einsum("nij,nj->ni", W, r[: self._count]), axis=1) / information
        limit = _CAUCHY * 1.4826 * float(np.median(np.abs(off_s)))  # sigma of a median deviation
        off_s = np.clip(off_s, -limit, limit)
        low, high = 0.0, WIDEST_S**2
        for _ in range(60):  # bisection to the last bit
            middle = 0.5 * (low + high)
            excess = np.sum(off_s**2 / (middle + 1 / information)) - (self._count - 2)
            low, high = (middle, high) if excess > 0 else (low, middle)
        return float(np.sqrt(low))

    def _arm_noise(self, sigma_mm: float) -> Array:
        """Covariance (n, 6, 6) that the arm's error adds, as left tangents in the camera."""
        G = np.zeros((len(self._t_C), 6, 6))
        G[:, :3, :3] = G[:, 3:, 3:] = np.eye(3)
        G[:, :3, 3:] = hat(self._t_C)
        variances = np.array([sigma_mm**2] * 3 + [(sigma_mm / REACH_MM) ** 2] * 3)
        return np.asarray((G * variances) @ np.swapaxes(G, 1, 2))
