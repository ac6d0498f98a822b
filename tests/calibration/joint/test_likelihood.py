"""Restricted likelihood of levels in parts, against its definition with matrices of all rows."""

import numpy as np
import pytest

from vgrd.calibration.joint.noise.likelihood import Part, Restricted
from vgrd.geometry import Array

FACTORS = np.array([2.0, 2.0, 3.0, 2.0])
TRUE = np.array([0.6, 1.8, 2.5, 1.3])  # over the stated ones
WIDTHS = np.array([3, 5, 3, 5, 5, 1, 1, 1, 1, 3, 3, 5] * 6)  # rows of every sample
N = 9


class Problem:
    """Rows of samples in disorder: pictures, touches, what a sample draws, and what all of them share."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        samples = np.repeat(np.arange(len(WIDTHS)), WIDTHS)
        self.samples = samples[rng.permutation(len(samples))]
        size = len(samples)
        of = np.flatnonzero(WIDTHS[self.samples] > 1)
        first = of[rng.random(len(of)) < 0.5]
        second = np.setdiff1d(np.arange(size), np.append(first, np.flatnonzero(self.samples == 0)))
        drawn = Part(of, rng.normal(size=(len(of), 2)), self.samples[of])
        shared = Part(of, 0.3 * rng.normal(size=(len(of), 4)), None)
        self.parts = [Part.independent(first), Part.independent(second), drawn, shared]
        self.rounding = Part(of, 0.2 * rng.normal(size=(len(of), 1)), self.samples[of])
        self.jacobian = rng.normal(size=(size, N))
        S = self.covariance(TRUE**2)
        noise = np.linalg.cholesky(S) @ rng.normal(size=size)
        self.residuals = self.jacobian @ rng.normal(size=N) + noise
        known = [(1.0, Part.independent(np.arange(size)))]
        known += [(-1.0, part) for part in self.parts[:2]] + [(1.0, self.rounding)]
        self.restricted = Restricted(
            self.residuals, self.jacobian, self.samples, self.parts, known
        )

    def of(self, part: Part) -> Array:
        """(r, r): covariance of a part."""
        out = np.zeros((len(self.samples), len(self.samples)))
        alike = np.ones((len(part.rows), len(part.rows)))
        if part.sources is not None:
            alike = part.sources[:, None] == part.sources
        out[np.ix_(part.rows, part.rows)] = part.factor @ part.factor.T * alike
        return out

    def covariance(self, sizes: Array) -> Array:
        """(r, r): of all rows."""
        covariances = [self.of(part) for part in self.parts]
        own = np.eye(len(self.samples)) - covariances[0] - covariances[1] + self.of(self.rounding)
        return own + np.tensordot(sizes, covariances, axes=1)

    def unlikelihood(self, log_variances: Array) -> float:
        """Minus the logarithm of the restricted likelihood, times the prior of the levels."""
        S, J, r = self.covariance(np.exp(log_variances)), self.jacobian, self.residuals
        by = np.linalg.solve(S, J)
        misses = r - J @ np.linalg.solve(J.T @ by, by.T @ r)
        volume = np.linalg.slogdet(S)[1] + np.linalg.slogdet(J.T @ by)[1]
        prior = np.sum((log_variances / (2 * np.log(FACTORS))) ** 2)
        return 0.5 * float(misses @ np.linalg.solve(S, misses) + volume + prior)


@pytest.mark.parametrize("seed", range(4))
def test_the_levels_are_the_most_likely_ones(seed: int) -> None:
    problem = Problem(seed)
    levels = problem.restricted.find(FACTORS)
    best = problem.unlikelihood(levels.log_variances)
    for step in 0.05 * np.vstack([np.eye(4), -np.eye(4)]):
        assert best < problem.unlikelihood(levels.log_variances + step)
    h = 1e-4 * np.eye(4)
    slope = [
        problem.unlikelihood(levels.log_variances + d)
        - problem.unlikelihood(levels.log_variances - d)
        for d in h
    ]
    spread = np.sqrt(np.diag(levels.covariance))
    assert np.abs(np.array(slope) / 2e-4 * spread).max() < 0.01
    assert np.abs(np.log(levels.scales / TRUE) / spread * 2).max() < 4.5


def test_a_level_that_vanishes_and_one_far_off_are_found_from_anywhere() -> None:
    problem = Problem(7)
    levels = [
        problem.restricted.find(FACTORS, np.array(start))
        for start in ([0.0] * 4, [3.0, -4, 5, -6], [-6.0, 4, -6, 5])
    ]
    for other in levels[1:]:
        np.testing.assert_allclose(other.log_variances, levels[0].log_variances, atol=0.01)


def test_the_variance_of_an_answer_is_that_of_generalised_least_squares() -> None:
    problem, sizes = Problem(3), np.array([0.5, 2.0, 3.0, 1.5])
    J = np.random.default_rng(0).normal(size=(2, 3, N))
    parts, totals = problem.restricted.variances(J, sizes)
    S = problem.covariance(sizes)
    by = np.linalg.solve(S, problem.jacobian)
    inverse = np.linalg.inv(problem.jacobian.T @ by)
    for one, own, total in zip(J, parts, totals, strict=True):
        gain = one @ inverse @ by.T
        expected = [
            np.trace(gain @ (size * problem.of(part)) @ gain.T)
            for size, part in zip(sizes, problem.parts, strict=True)
        ]
        np.testing.assert_allclose(own, expected, rtol=1e-9)
        np.testing.assert_allclose(total, np.trace(gain @ S @ gain.T), rtol=1e-9)
