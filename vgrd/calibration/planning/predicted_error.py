"""Foresight: what samples not taken yet would add, and what that does to the job's error.

Every sample is predicted at the present estimate; only covariances are needed, no measurements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from vgrd.calibration.joint import (
    EvidenceKind,
    JointFit,
    StepLayout,
    information_inverse,
    predict,
    solution_of,
    work_orientation,
)
from vgrd.calibration.planning.predicted_rows import ForeseenRows, picture_of
from vgrd.calibration.planning.reach import Candidate, Looking, known_targets
from vgrd.geometry import Array, Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import IRRELEVANT_MM
from vgrd.model import Policy

QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)  # of a turn: where errors of an axis show most
_FREEDOMS = np.linspace(1.0, 3.0, 501)  # of a position: 1 where it can miss along one line only
_QUANTILES = np.array([chi2_quantile(0.95, freedom) for freedom in _FREEDOMS])  # u95


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What will be asked for; everything in it counts alike.

    works: orientations (3, 3) of the wrist at work, none for the one of the touches; angles_rad:
    turns of the object; targets: names, None for all whose place is known.
    """

    policy: Policy = Policy.FIXED
    works: Sequence[Array] = ()
    angles_rad: Sequence[float] = QUARTERS
    targets: Sequence[str] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """One coordinate of the job: the target's name, base_from_wrist (3, 3) at work."""

    target: str
    base_from_wrist: Array


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A direction that the samples leave open; matters: whether the job's answers depend on it."""

    what: str
    matters: bool


class PredictedError:
    """Predicts rows of candidates at the present estimate, and the job's error from them."""

    def __init__(
        self,
        result: JointFit,
        job: Job,
        tag_a_in_view: Callable[[Pose], bool] | None = None,
    ) -> None:
        self._result = result
        self._foreseen = ForeseenRows(result, tag_a_in_view or (lambda _: True))
        N = result.undetermined
        self.covariance = result.covariance + N @ N.T
        self.asked, self._jacobians, self._rest = self._ask(job)

    def miss_covariances(self, covariance: Array) -> Array:
        """(j, 3, 3) of the misses at work, mm^2, of each in `asked`."""
        B = self._jacobians
        return np.asarray(B @ covariance @ B.transpose(0, 2, 1) + self._rest)

    def error_mm(self, covariance: Array) -> float:
        """Mean 95 % radius over everything that the job asks for."""
        return float(_radii95(self.miss_covariances(covariance)).mean())

    def target_errors_mm(self, covariance: Array, job: Job) -> dict[str, float]:
        """The same by target."""
        target_radii = self.angle_errors_mm(covariance, job).mean(axis=0)
        names = _targets(self._result, job)
        return dict(zip(names, map(float, target_radii), strict=True))

    def angle_errors_mm(self, covariance: Array, job: Job) -> Array:
        """(a, t) by turn of the object and target."""
        radii = _radii95(self.miss_covariances(covariance))
        by_angle = radii.reshape(len(job.angles_rad), len(_targets(self._result, job)), -1)
        return np.asarray(by_angle.mean(axis=2))

    def errors_after(self, covariance: Array, rows: Array) -> Array:
        """`error_mm` (c,) after each of c candidates, rows (c, r, n), alone."""
        j, n = len(self._jacobians), self._jacobians.shape[2]
        A = rows @ covariance
        S = np.eye(rows.shape[1]) + A @ rows.transpose(0, 2, 1)
        G = self._jacobians.reshape(-1, n) @ A.transpose(0, 2, 1)
        half = np.linalg.solve(np.linalg.cholesky(S), G.transpose(0, 2, 1))
        half = half.transpose(0, 2, 1).reshape(len(rows), j, 3, -1)
        covariances = self.miss_covariances(covariance) - half @ half.transpose(0, 1, 3, 2)
        radii = _radii95(covariances.reshape(-1, 3, 3)).reshape(len(rows), j)
        return np.asarray(radii.mean(axis=1))

    @staticmethod
    def with_rows(covariance: Array, rows: Array) -> Array:
        """Covariance after rows (r, n) of unit noise were measured."""
        gain = covariance @ rows.T
        S = np.eye(len(rows)) + rows @ gain
        return np.asarray(covariance - gain @ np.linalg.solve(S, gain.T))

    def without(self, *, looks: bool, spins: bool) -> Array:
        """Covariance without any touch, nor what was seen in one; with or without looks and spins."""
        data, layout = self._result.data, self._result.layout
        rows = []
        if looks:
            indices = np.flatnonzero(~np.isin(data.looks.stations, data.touch_stations))
            alone = [Looking(pose) for pose in data.looks.subset(indices).poses()]
            rows.append(self.rows(alone).reshape(-1, layout.size))
        links = [EvidenceKind.HOLES, EvidenceKind.TURNTABLE, EvidenceKind.REFINED] + [
            EvidenceKind.SPINS
        ] * spins
        rows += [self._result.jacobian[data.rows_of(link)] for link in links]
        P, N = information_inverse(np.vstack(rows), layout)
        return P + N @ N.T

    def rows(self, candidates: Sequence[Candidate]) -> Array:
        """Rows (c, r, n) of unit noise that each candidate would add, empty ones 0."""
        return self._foreseen.of(candidates)

    def undetermined(self) -> tuple[Undetermined, ...]:
        """What the samples leave open, in words, and whether the job minds."""
        result = self._result
        N = result.open_directions
        if not N.size:
            return ()
        J_open = (self._jacobians @ N).reshape(-1, N.shape[1])
        _, s, Vt = np.linalg.svd(J_open / np.sqrt(len(self._jacobians)), full_matrices=True)
        rank = int(np.sum(s > IRRELEVANT_MM))
        open_directions = []
        for part, matters in ((Vt[:rank], True), (Vt[rank:], False)):
            directions = N @ part.T
            apart = np.linalg.svd(directions[StepLayout.TCP], full_matrices=True)[2]
            open_directions += [
                Undetermined(_in_words(result, d), matters) for d in (directions @ apart.T).T
            ]
        return tuple(open_directions)

    def _ask(self, job: Job) -> tuple[list[Question], Array, Array]:
        """What is asked, derivatives (j, 3, n) by the unknowns, the rest of the covariance (j, 3, 3)."""
        result, solution = self._result, solution_of(self._result)
        asked, jacobians, rests = [], [], []
        works: Sequence[Array | None] = job.works or (None,)
        for angle in job.angles_rad:
            tag = picture_of(result, angle)
            for name, work in product(_targets(result, job), works):
                R_work = work_orientation(result.recording, name, job.policy, work)
                prediction = predict(result, solution, name, tag, job.policy, R_work, refuse=False)
                rest = prediction.J_picture @ tag.covariance @ prediction.J_picture.T
                rest = rest + prediction.J_arm @ prediction.arm_covariance @ prediction.J_arm.T
                asked.append(Question(name, prediction.base_from_wrist.rotation))
                jacobians.append(prediction.J_unknowns)
                rests.append(rest)
        return asked, np.array(jacobians), np.array(rests)


def _targets(result: JointFit, job: Job) -> Sequence[str]:
    return job.targets or known_targets(result)


def _in_words(result: JointFit, direction: Array) -> str:
    """An undetermined direction (n,): the TCP's share of it, or the unknowns concerned."""
    tcp = direction[StepLayout.TCP]
    size = float(np.linalg.norm(tcp))
    if size < 1.0:
        return replace(result, undetermined=direction[:, None]).unknown_in_words() or "an unknown"
    x, y, z = np.round(tcp / size * np.sign(tcp[int(np.argmax(np.abs(tcp)))]), 2) + 0.0
    return f"the TCP along ({x:.2f}, {y:.2f}, {z:.2f}) of the flange"


def _radii95(covariances: Array) -> Array:
    """`radius95` of many (j, 3, 3), its quantile from a table, which differs by less than 1e-6."""
    total = np.trace(covariances, axis1=1, axis2=2)
    squares = np.einsum("jab,jba->j", covariances, covariances)
    freedoms = total**2 / squares
    return np.asarray(np.sqrt(squares / total * np.interp(freedoms, _FREEDOMS, _QUANTILES)))
