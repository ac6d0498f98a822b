"""Quantiles of the chi-square distribution, the one place that computes them."""

from scipy.special import gammainc, gammaincinv


def chi2_quantile(probability: float, degrees_of_freedom: float) -> float:
    """Bound that a sum of so many squared standard normals stays below with the given probability."""
    return float(2 * gammaincinv(degrees_of_freedom / 2, probability))


def chi2_probability(value: float, degrees_of_freedom: float) -> float:
    """Probability that a sum of so many squared standard normals is at most `value`."""
    return float(gammainc(degrees_of_freedom / 2, value / 2))
