"""Quantiles of the chi-square distribution, the one place that computes them."""

from scipy.special import gammainc, gammaincinv


def chi2_quantile(probability: float, degrees_of_freedom: float) -> float:
    """What a sum of that many squared standard normals stays within with the probability given."""
    return float(2 * gammaincinv(degrees_of_freedom / 2, probability))


def chi2_probability(value: float, degrees_of_freedom: float) -> float:
    """Probability that such a sum is at most `value`."""
    return float(gammainc(degrees_of_freedom / 2, value / 2))
