"""How an arm differs from its report, and what teaching told of it."""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array

_REPEATABILITY = 0.3  # share; a guess: 0.03 mm of an arm's 0.1 mm repeat
_UNIFORM_VARIANCE = 1 / 12  # of a step of 1: what is rounded lies anywhere in it


@dataclass(frozen=True, slots=True)
class ArmModel:
    """Errors of the arm: a new draw at every stand, rounding, and a smooth field over the workspace.

    sigma_mm, field_mm: per axis, of the flange; turns are rad_per_mm times as large. The field's
    correlation over a distance d is exp(-d^2 / 2 length_mm^2). quantum_mm, quantum_rad: steps to
    which the robot's interface rounds a pose, each axis by itself.
    """

    sigma_mm: float = 0.0
    field_mm: float = 0.0
    length_mm: float = 200.0  # a guess: a fraction of the reach, as errors of links and joints
    rad_per_mm: float = 2e-3  # 1 / REACH_MM (500 mm)
    quantum_mm: float = 0.0
    quantum_rad: float = 0.0

    @classmethod
    def of(cls, robot_sigma_mm: float, step_mm: float = 0.0, step_rad: float = 0.0) -> "ArmModel":
        """An arm of which one figure is known, repeatability being the lesser part of it, and its steps."""
        repeats = _REPEATABILITY * robot_sigma_mm
        field_mm = float(np.sqrt(robot_sigma_mm**2 - repeats**2))
        return cls(repeats, field_mm, quantum_mm=step_mm, quantum_rad=step_rad)

    @property
    def is_exact(self) -> bool:
        """True when the arm is taken to be where it reports."""
        return not (self.sigma_mm or self.field_mm or self.quantum_mm or self.quantum_rad)

    def field(self, a: Array, b: Array) -> Array:
        """mm^2 (n, m): covariance per axis between flange positions a (n, 3) and b (m, 3)."""
        squared = np.sum((a[:, None] - b[None]) ** 2, axis=2)
        return np.asarray(self.field_mm**2 * np.exp(-0.5 * squared / self.length_mm**2))

    def prior(self, flange_at: Array) -> Array:
        """mm^2 (s, s): covariance per axis of all stands (s, 3), rounding not included."""
        own = self.sigma_mm**2 * np.eye(len(flange_at))
        return np.asarray(own + self.field(flange_at, flange_at))

    def scales(self) -> Array:
        """(6,): what 1 mm of error means for a deviation (mm, rad) of the flange."""
        return np.array([1.0] * 3 + [self.rad_per_mm] * 3)

    def rounding(self) -> Array:
        """(6,): sigmas (mm, rad) of the rounding of a pose."""
        steps = np.array([self.quantum_mm] * 3 + [self.quantum_rad] * 3)
        return np.asarray(steps * np.sqrt(_UNIFORM_VARIANCE))

    def variances(self) -> Array:
        """(6,): mm^2 and rad^2 of the deviation at one stand, everything included."""
        own = (self.sigma_mm**2 + self.field_mm**2) * self.scales() ** 2
        return np.asarray(own + self.rounding() ** 2)

    def cholesky_factor(self, flange_at: Array) -> Array:
        """H (6 s, k) with H H^T the covariance of the deviations at all stands (s, 3)."""
        s = len(flange_at)
        L = np.linalg.cholesky(self.prior(flange_at) + 1e-12 * np.eye(s))
        own = np.kron(L, np.diag(self.scales()))
        if not (self.quantum_mm or self.quantum_rad):
            return np.asarray(own)
        return np.hstack([own, np.kron(np.eye(s), np.diag(self.rounding()))])


@dataclass(frozen=True, slots=True, eq=False)
class ArmKnowledge:
    """What teaching told of the arm's deviations (mm, rad), to predict them elsewhere (kriging).

    flange_at: (s, 3) where it stood. Per stand and axis: score (6 s,) of the residuals, J_unknowns
    (6 s, n) its derivative by the estimate, information (6 s, 6 s). s is 0 for an arm without field.
    """

    model: ArmModel
    flange_at: Array
    score: Array
    J_unknowns: Array
    information: Array

    def deviation(self, flange: Array) -> tuple[Array, Array, Array]:
        """Most likely deviation (6,) at a flange position (3,), derivative (6, n), covariance (6, 6)."""
        return self.deviations(flange[None])

    def deviations(self, flanges: Array, sent: int = 0) -> tuple[Array, Array, Array]:
        """The same of p stands at flange positions (p, 3): (6 p,), (6 p, n), (6 p, 6 p).

        sent: at the last so many the arm is sent to a pose; nobody reads one there, so none is rounded.
        """
        squares, p = self.model.scales() ** 2, len(flanges)
        own = np.tile(self.model.variances() - self.model.field_mm**2 * squares, (p, 1))
        own[p - sent :] -= self.model.rounding() ** 2
        here = np.einsum("pq,ij,pi->piqj", np.eye(p), np.eye(6), own)
        here += np.einsum("pq,ij->piqj", self.model.field(flanges, flanges), np.diag(squares))
        here = here.reshape(6 * p, 6 * p)
        near = self.model.field(flanges, self.flange_at)
        shared = np.einsum("ps,ij->pisj", near, np.diag(squares)).reshape(
            6 * p, 6 * len(self.flange_at)
        )
        return (
            -shared @ self.score,
            -shared @ self.J_unknowns,
            np.asarray(here - shared @ self.information @ shared.T),
        )
