"""Rigid fit of point pairs: `X c_i = M_i q`, least squares, one level of noise from the residuals.

c_i: the point in the camera; M_i: the flange's motion, base_from_wrist for a fixed camera (X = base_from_camera)
and its inverse for one on the arm (X = wrist_from_camera); q: the point where it is fixed, in the wrist or in
the base. With q known: Kabsch 1976, Umeyama 1991; else Gauss-Newton over X and q.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_law

from vgrd.errors import DidNotConverge, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, hat, nearest_rotation

_LEAST = 3  # points fix a pose
_LEAST_FREE = 5  # and the point's place too: 15 equations for the 15 unknowns of the linear start
_LINE = 1e-3  # second spread over the first: 0.3 mm of noise over 300 mm
_STEPS = 50  # at most; five are usual
_STILL_MM = 1e-9  # of a step
_RANK = 1e-7  # of the smallest singular value: below it the motion leaves the point open


@dataclass(frozen=True, slots=True, eq=False)
class PointPairs:
    """n samples: motions M_i of the module's equation, points (n, 3) in the camera, mm.

    tool_point (3,): q, mm; None where it is to be found.
    """

    names: Sequence[str]
    motions: Sequence[Pose]
    points: Array
    tool_point: Array | None

    @property
    def places(self) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and translations (n, 3) of the motions."""
        return (
            np.array([pose.rotation for pose in self.motions]),
            np.array([pose.translation for pose in self.motions]),
        )

    @property
    def unknowns(self) -> int:
        """6 of X, and 3 where the point is to be found."""
        return 6 if self.tool_point is not None else 9

    def without(self, index: int) -> "PointPairs":
        """All samples but one."""
        return self.chosen([i for i in range(len(self.names)) if i != index])

    def chosen(self, keep: Sequence[int]) -> "PointPairs":
        """Some of the samples."""
        return PointPairs(
            [self.names[i] for i in keep],
            [self.motions[i] for i in keep],
            self.points[list(keep)],
            self.tool_point,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PointPairsFit:
    """X, q and what the residuals (n, 3), mm, say of them.

    cofactor (6, 6) or (9, 9): covariance over level_mm squared, left tangent of X (v, w), then q.
    """

    X: Pose
    tool_point: Array
    residuals: Array
    cofactor: Array
    unknowns: int

    @property
    def freedom(self) -> int:
        """Residuals over unknowns."""
        return int(self.residuals.size - self.unknowns)

    @property
    def level_mm(self) -> float:
        """1 sigma of one coordinate of one sample, mm; NaN without redundancy."""
        if self.freedom <= 0:
            return float("nan")
        return float(np.sqrt((self.residuals**2).sum() / self.freedom))

    @property
    def covariance(self) -> Array:
        """Covariance of X (6, 6), left tangent, mm and rad; the level's own spread is in it.

        The variance of Student's t, which has one only above two degrees of freedom.
        """
        wider = self.freedom / (self.freedom - 2) if self.freedom > 2 else np.nan
        return np.asarray(self.level_mm**2 * wider * self.cofactor[:6, :6])

    def u95_mm(self, point: Array, *, of_a_look: bool = False) -> float:
        """95 % radius of X applied to a point (3,) of the camera, mm, taken as wide as its worst direction.

        of_a_look: with the noise of one further look and one robot pose.
        """
        J = np.hstack([np.eye(3), -hat(self.X @ point)])
        worst = float(np.linalg.eigvalsh(J @ self.cofactor[:6, :6] @ J.T)[-1]) + of_a_look
        if self.freedom <= 0:
            return float("nan")
        bound = 3 * float(f_law.ppf(0.95, 3, self.freedom))
        return float(np.sqrt(bound * worst) * self.level_mm)


@dataclass(frozen=True, slots=True)
class SampleMiss:
    """A sample predicted by the others: miss, mm; chance that one of so many good ones misses by more."""

    mm: float
    chance: float


def fit_point_pairs(pairs: PointPairs) -> PointPairsFit:
    """Fit all samples alike.

    Raises TooFewObservations, NotObservable (points on one line, wrists that never turned) or DidNotConverge.
    """
    least = _LEAST if pairs.tool_point is not None else _LEAST_FREE
    if len(pairs.names) < least:
        raise TooFewObservations(f"{len(pairs.names)} points, at least {least} are needed")
    spread = np.linalg.svd(pairs.points - pairs.points.mean(0), compute_uv=False)
    if spread[1] <= _LINE * spread[0] or spread[0] == 0:
        raise NotObservable(
            "all points lie on one line (or are one): the turn about it stays open; add points beside it, "
            "best in three directions",
            rank=5,
            unknowns=6,
        )
    if pairs.tool_point is not None:
        return _known(pairs, pairs.tool_point)
    return _free(pairs)


def leave_one_out(pairs: PointPairs) -> list[SampleMiss | None]:
    """Each sample predicted by the others; None where they determine no fit.

    The miss over its own noise and the fit's follows F with 3 degrees of freedom; the chance counts all samples.
    """
    misses: list[SampleMiss | None] = []
    for index in range(len(pairs.names)):
        try:
            fit = fit_point_pairs(pairs.without(index))
        except (TooFewObservations, NotObservable, DidNotConverge):
            misses.append(None)
            continue
        M, c = pairs.motions[index], pairs.points[index]
        miss = fit.X @ c - M @ fit.tool_point
        J = _slopes(fit.X @ c[None], M.rotation[None], fit.unknowns)[0]
        S = np.eye(3) + J @ fit.cofactor @ J.T
        chance = 1.0
        if fit.freedom > 0 and fit.level_mm > 0:
            ratio = float(miss @ np.linalg.solve(S, miss)) / (3 * fit.level_mm**2)
            chance = min(1.0, len(pairs.names) * float(f_law.sf(ratio, 3, fit.freedom)))
        misses.append(SampleMiss(float(np.linalg.norm(miss)), chance))
    return misses


def scale_of(pairs: PointPairs, fit: PointPairsFit) -> tuple[float, float]:
    """Lengths of the camera over those of the robot, and their sigma, with rotation and centre free.

    Umeyama's scale, the other way round; the fit itself does not use it.
    """
    R, t = pairs.places
    bases = R @ fit.tool_point + t
    p, c = bases - bases.mean(0), pairs.points - pairs.points.mean(0)
    U, values, Vt = np.linalg.svd(p.T @ c)
    turn = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    scale = float(np.trace(turn.T @ (p.T @ c)) / (p**2).sum())
    freedom = max(3 * len(p) - 7, 1)
    rest = c - scale * p @ turn
    del values
    return scale, float(np.sqrt((rest**2).sum() / freedom / (p**2).sum()))


def is_mirrored(pairs: PointPairs, fit: PointPairsFit) -> bool:
    """Whether the points fit clearly better with one axis of the camera turned round: a left-handed frame."""
    R, t = pairs.places
    bases = R @ fit.tool_point + t
    p, c = bases - bases.mean(0), pairs.points - pairs.points.mean(0)
    U, _, Vt = np.linalg.svd(p.T @ c)
    mirror = U @ np.diag([1, 1, -np.linalg.det(U @ Vt)]) @ Vt
    flat = np.linalg.svd(c, compute_uv=False)
    misfit = ((p - c @ mirror.T) ** 2).sum()
    tenth = 0.01 * (fit.residuals**2).sum()  # of the misfit: ten times nearer
    return bool(flat[2] > _LINE * flat[0] and misfit < tenth)


@dataclass(frozen=True, slots=True, eq=False)
class ToolPointChange:
    """Where the samples say that the tool's point is (3,), mm, and the chance of so much by noise alone.

    typical_mm: what the samples are then off, median.
    """

    place: Array
    chance: float
    typical_mm: float


def tool_point_change(pairs: PointPairs, fit: PointPairsFit) -> ToolPointChange | None:
    """The tool's point by the samples; None where the wrist turned too little to say it."""
    free = PointPairs(pairs.names, pairs.motions, pairs.points, None)
    try:
        other = fit_point_pairs(free)
    except (TooFewObservations, NotObservable, DidNotConverge):
        return None
    left = (other.residuals**2).sum()
    if other.freedom <= 0 or left == 0:
        return None
    ratio = ((fit.residuals**2).sum() - left) / 3 / (left / other.freedom)
    chance = float(f_law.sf(max(ratio, 0.0), 3, other.freedom))
    typical_mm = float(np.median(np.linalg.norm(other.residuals, axis=1)))
    return ToolPointChange(other.tool_point, chance, typical_mm)


def _known(pairs: PointPairs, tool_point: Array) -> PointPairsFit:
    """Kabsch: the rotation by SVD, then the place."""
    R, t = pairs.places
    bases = R @ tool_point + t
    centre, middle = bases.mean(0), pairs.points.mean(0)
    turn = nearest_rotation((bases - centre).T @ (pairs.points - middle), tolerance=np.inf)
    X = Pose(turn, centre - turn @ middle)
    return _finished(pairs, X, tool_point, 6)


def _free(pairs: PointPairs) -> PointPairsFit:
    """Gauss-Newton over X and q from the linear solution, which knows nothing of rotations."""
    R, t = pairs.places
    n = len(pairs.names)
    rows = np.zeros((n, 3, 15))
    for axis in range(3):
        rows[:, axis, 3 * axis : 3 * axis + 3] = pairs.points
    rows[:, :, 9:12] = np.eye(3)
    rows[:, :, 12:] = -R
    x = np.linalg.lstsq(rows.reshape(-1, 15), t.ravel(), rcond=1e-9)[0]
    try:
        turn = nearest_rotation(x[:9].reshape(3, 3), tolerance=np.inf)
    except np.linalg.LinAlgError as error:
        raise DidNotConverge("no start was found: are the points those of these poses?") from error
    X, q = Pose(turn, np.asarray(x[9:12], dtype=np.float64)), x[12:]
    for _ in range(_STEPS):
        seen = X @ pairs.points
        J = _slopes(seen, R, 9).reshape(-1, 9)
        size = np.linalg.norm(J, axis=0)
        U, values, Vt = np.linalg.svd(J / size, full_matrices=False)
        if values[-1] < _RANK * values[0]:
            raise NotObservable(
                "the wrist turned about one axis or not at all: where the point sits stays open; turn it "
                "about two axes, or give tcp_in_wrist",
                rank=int((values > _RANK * values[0]).sum()),
                unknowns=9,
            )
        step = -(Vt.T / values) @ U.T @ (seen - R @ q - t).ravel() / size
        X, q = Pose.exp(step[:6]) @ X, q + step[6:]
        if np.abs(step[[0, 1, 2, 6, 7, 8]]).max() < _STILL_MM * max(1.0, float(np.abs(t).max())):
            return _finished(pairs, X, q, 9)
    raise DidNotConverge(
        "the fit of the points found no minimum: do points and poses belong together?"
    )


def _slopes(seen: Array, R: Array, unknowns: int) -> Array:
    """Derivative (n, 3, unknowns) of the residuals by the left tangent of X, then by q."""
    J = np.zeros((len(seen), 3, unknowns))
    J[:, :, :3] = np.eye(3)
    J[:, :, 3:6] = -hat(seen)
    J[:, :, 6:] = -R[:, :, : unknowns - 6]
    return J


def _finished(pairs: PointPairs, X: Pose, q: Array, unknowns: int) -> PointPairsFit:
    R, t = pairs.places
    seen = X @ pairs.points
    J = _slopes(seen, R, unknowns).reshape(-1, unknowns)
    size = np.linalg.norm(J, axis=0)
    cofactor = np.linalg.inv((J / size).T @ (J / size)) / np.outer(size, size)
    return PointPairsFit(X, q, seen - R @ q - t, cofactor, unknowns)
