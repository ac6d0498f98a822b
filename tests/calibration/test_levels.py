"""Levels of noise: drawn with known sizes, found within their own spread."""

import numpy as np
import pytest

from vgrd.calibration.levels import Levels, Whitened, find_levels, wider_by_freedom
from vgrd.geometry import Array

TRUE = np.array([0.5, 2.0, 3.0])  # over the stated ones: pixels, touches, what a group shares
FINE, COARSE, GROUPS = 60, 18, 26


def whitener(J: Array, r: Array):  # type: ignore[no-untyped-def]
    """Two kinds of rows, and what every three rows share."""
    shared = np.kron(np.eye(GROUPS), np.ones((3, 1)))

    def whiten(x: Array) -> Whitened:
        rows = np.exp(np.repeat(x[:2], [FINE, COARSE]) / 2)
        S = np.diag(rows**2) + np.exp(x[2]) * shared @ shared.T
        inverse = np.linalg.inv(np.linalg.cholesky(S))
        own = inverse * rows
        parts = [own[:, :FINE], own[:, FINE:], np.exp(x[2] / 2) * inverse @ shared]
        return Whitened(inverse @ r, inverse @ J, parts)

    return whiten


def draw(rng: np.random.Generator, scales: Array) -> tuple[Array, Array]:
    sigmas = np.repeat(scales[:2], [FINE, COARSE])
    shared = np.repeat(scales[2] * rng.normal(size=GROUPS), 3)
    return rng.normal(size=(FINE + COARSE, 12)), sigmas * rng.normal(size=FINE + COARSE) + shared


def found(scales: Array, seed: int, factors: Array | None = None) -> Levels:
    return find_levels(
        whitener(*draw(np.random.default_rng(seed), scales)), 3, prior_factors=factors
    )


def test_levels_are_found_without_bias_and_within_their_spread() -> None:
    runs = [found(TRUE, seed, np.full(3, np.inf)) for seed in range(80)]
    off = np.array([np.log(one.scales / TRUE) for one in runs])
    told = np.array([np.sqrt(np.diag(one.covariance)) / 2 for one in runs])
    expected = -np.mean(
        told**2, axis=0
    )  # of the logarithm of a variance over its own, to first order
    assert np.abs(off.mean(axis=0) - expected).max() < 3 * off.std(axis=0).max() / np.sqrt(
        len(runs)
    )
    assert off.std(axis=0) == pytest.approx(told.mean(axis=0), rel=0.35)


def test_a_stated_level_is_kept_where_the_data_say_little() -> None:
    whiten = whitener(*draw(np.random.default_rng(1), np.ones(3)))

    def blind(x: Array) -> Whitened:
        whitened = whiten(x)
        everything = np.eye(len(whitened.residuals))
        return Whitened(whitened.residuals, everything, whitened.factors)

    levels = find_levels(blind, 3)
    assert levels.scales == pytest.approx(1)
    assert levels.named([("touches", "mm", 0.2)] * 3)[0].freedom == pytest.approx(3.04, abs=0.01)


def test_a_level_far_off_its_prior_is_surprising() -> None:
    levels = found(np.array([1.0, 5.0, 1.0]), 2).named(
        [("a", "px", 1), ("b", "mm", 1), ("c", "mm", 1)]
    )
    assert levels[1].surprise > 3
    assert max(levels[0].surprise, levels[2].surprise) < 2


def test_few_samples_widen_the_interval() -> None:
    assert wider_by_freedom(5) == pytest.approx(2.571 / 1.960, abs=1e-3)
    assert wider_by_freedom(np.inf) == 1
    parts = found(np.ones(3), 3).freedom_of(np.array([0.0, 1.0, 0.0]))
    assert 10 < parts < 2 * COARSE
