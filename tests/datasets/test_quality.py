"""The radius of further misses: drawn here with tails that come from samples which differ."""

import numpy as np

from vgrd.geometry.covariance import radius95, radius95_of_mixture
from vgrd.solving.datasets.quality import within_95


def drawn(rng, sigmas):
    """A miss per sample, (n, 3), isotropic."""
    return rng.normal(size=(len(sigmas), 3)) * np.asarray(sigmas)[:, None]


def test_a_mixture_of_one_is_the_radius_of_its_covariance():
    C = np.diag([1.0, 4.0, 0.25])
    assert np.isclose(radius95_of_mixture([C, C]), radius95(C))
    assert radius95_of_mixture([np.zeros((3, 3))]) == 0


def test_the_radius_of_a_mixture_holds_95_percent():
    rng = np.random.default_rng(5)
    sigmas = [0.5, 1.0, 1.5, 2.5]
    lengths = np.linalg.norm(drawn(rng, np.repeat(sigmas, 20_000)), axis=1)
    radius = radius95_of_mixture([s**2 * np.eye(3) for s in sigmas])
    assert 0.94 < np.mean(lengths <= radius) < 0.965
    alike = radius95(np.mean(np.square(sigmas)) * np.eye(3))
    assert np.mean(lengths <= alike) < 0.94  # their mean alone holds fewer


def test_further_misses_lie_within_whatever_size_was_expected():
    rng = np.random.default_rng(6)
    for count in (8, 15, 40):
        inside = []
        for _ in range(400):
            sigmas = rng.uniform(0.3, 1.5, count)
            misses = drawn(rng, sigmas)
            expected = [(s / 7) ** 2 * np.eye(3) for s in sigmas]  # seven times too small
            radius = within_95(list(misses), expected)
            further = np.linalg.norm(drawn(rng, rng.uniform(0.3, 1.5, 20)), axis=1)
            inside.append(np.mean(further <= radius))
        assert 0.935 < np.mean(inside) < 0.975, count


def test_no_misses_tell_nothing_and_exact_ones_nothing_but_themselves():
    assert np.isnan(within_95([], []))
    assert within_95([np.zeros(3)] * 3, [np.zeros((3, 3))] * 3) == 0


def test_where_some_are_strays_the_largest_miss_is_within():
    rng = np.random.default_rng(7)
    misses = list(drawn(rng, [1.0] * 13 + [40.0] * 2))
    expected = [np.eye(3)] * 15
    largest = np.linalg.norm(misses, axis=1).max()
    assert within_95(misses, expected) < largest
    assert within_95(misses, expected, strays=True) >= largest
