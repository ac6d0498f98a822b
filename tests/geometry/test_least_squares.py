"""The iteration ends at a minimum, or says that it did not."""

import numpy as np
import pytest

from vgrd.errors import DidNotConverge
from vgrd.geometry.least_squares import check_convergence, minimize


def test_the_iteration_finds_the_valley_of_rosenbrock():
    def linearize(x):
        r = np.array([1 - x[0], 10 * (x[1] - x[0] ** 2)])
        return r, np.array([[-1.0, 0], [-20 * x[0], 10]])

    found = minimize(linearize, np.add, np.array([-1.2, 1.0]))
    assert found.report.converged
    np.testing.assert_allclose(found.state, [1, 1], atol=1e-8)


def test_an_iteration_without_minimum_says_so():
    def linearize(x):
        return np.exp(-x), np.diag(-np.exp(-x))

    found = minimize(linearize, np.add, np.zeros(1), max_steps=3)
    with pytest.raises(DidNotConverge, match="hand-eye: no minimum after 3 steps"):
        check_convergence(found.report, "hand-eye")


def test_a_start_that_is_not_finite_is_refused():
    with pytest.raises(DidNotConverge, match="start"):
        minimize(lambda x: (x * np.nan, np.eye(1)), np.add, np.zeros(1))


def downhill(minimum):
    """By how much a full Gauss-Newton step would still change the residuals."""
    J = minimum.jacobian
    step = np.linalg.lstsq(J / np.linalg.norm(J, axis=0), -minimum.residuals, rcond=1e-9)[0]
    return np.linalg.norm(J / np.linalg.norm(J, axis=0) @ step)


def exponentials(seed, offset=0.0):
    """Two decaying terms through noise, badly scaled; offset: digits that the residuals lose."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4, 40)
    truth = np.array([800.0, 1.3, 0.02, 0.4])

    def model(x):
        return x[0] * np.exp(-x[1] * t) + 1e3 * x[2] * np.exp(-x[3] * t)

    seen = model(truth) + rng.normal(size=40) * 0.3

    def linearize(x):
        a, b = np.exp(-x[1] * t), np.exp(-x[3] * t)
        J = np.column_stack([a, -x[0] * t * a, 1e3 * b, -1e3 * x[2] * t * b])
        return (model(x) + offset - (seen + offset)) / 0.3, J / 0.3

    return linearize, truth * rng.uniform(0.9, 1.1, 4)


@pytest.mark.parametrize("column", [None, 0, 1])
def test_a_jacobian_of_wrong_sign_is_not_taken_for_a_minimum(column):
    sign = np.ones(2) if column is not None else -np.ones(2)
    if column is not None:
        sign[column] = -1

    def linearize(x):
        r = np.array([3 - x[0], 10 * (x[1] - x[0] ** 2), x[1] - 2])
        return r, np.array([[-1.0, 0], [-20 * x[0], 10], [0, 1]]) * sign

    found = minimize(linearize, np.add, np.array([-1.2, 1.0]))
    assert not found.report.converged
    with pytest.raises(DidNotConverge):
        check_convergence(found.report, "wrong")


def test_the_gradient_at_a_minimum_is_small_with_a_margin():
    for seed in range(40):
        linearize, start = exponentials(seed)
        found = minimize(linearize, np.add, start)
        assert found.report.converged
        assert downhill(found) < 1e-8 * (1 + np.linalg.norm(found.residuals))


def test_costs_that_drown_in_rounding_keep_no_iteration_from_its_minimum():
    for seed in range(40):
        linearize, start = exponentials(seed, offset=1e8)
        found = minimize(linearize, np.add, start, tolerance=1e-6)
        assert found.report.converged
        assert downhill(found) < 1e-6 * (1 + np.linalg.norm(found.residuals))


def test_the_last_digits_and_the_order_of_the_rows_do_not_move_a_minimum():
    for seed in range(20):
        linearize, start = exponentials(seed)
        order = np.random.default_rng(seed).permutation(40)
        shaken = start * (1 + 1e-12 * np.array([1, -1, 1, -1]))

        def permuted(x, linearize=linearize, order=order):
            r, J = linearize(x)
            return r[order], J[order]

        first = minimize(linearize, np.add, start)
        second = minimize(permuted, np.add, shaken)
        np.testing.assert_allclose(second.state, first.state, rtol=1e-8)
