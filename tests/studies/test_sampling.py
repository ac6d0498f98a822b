"""What chance leaves open in as few repetitions as the paper's, and whether its figures lie in it."""

import json

import numpy as np
import pytest
from scipy.stats import norm

from fakes.studies.conducting import conduct
from fakes.studies.sampling import beside_the_paper, interval95, ratio_of_means, resampled
from fakes.studies.study import Figure


def figure(outcome, name):
    (found,) = [f for f in outcome.figures if f.name == name]
    return found


def test_the_interval_of_a_mean_of_five_is_that_of_theory():
    draws = np.random.default_rng(0).normal(10.0, 2.0, 20_000)
    low, high = interval95(resampled(draws, 5, np.mean))
    half = norm.ppf(0.975) * 2.0 / np.sqrt(5)
    assert (low, high) == pytest.approx((10 - half, 10 + half), abs=0.15)


def test_more_repetitions_leave_less_open():
    rows = np.exp(np.random.default_rng(1).normal(0.0, 0.5, (3000, 2))) * (2.0, 1.0)
    widths = [np.ptp(interval95(resampled(rows, n, ratio_of_means))) for n in (5, 20, 80)]
    assert widths == sorted(widths, reverse=True)
    assert ratio_of_means(rows) == pytest.approx(0.5, rel=0.05)


def test_the_same_comes_out_again_and_nothing_out_of_nothing():
    rows = np.arange(7.0)
    assert (resampled(rows, 5, np.mean) == resampled(rows, 5, np.mean)).all()
    assert np.isnan(interval95(resampled(np.zeros(0), 5, np.mean))).all()
    nothing = beside_the_paper(Figure("f", 1.0), np.zeros(0), 1.0)
    assert nothing.paper_inside is None
    assert json.loads(json.dumps(nothing.as_json(), allow_nan=False))["interval"] is None


@pytest.mark.parametrize(
    ("low", "high", "inside"),
    [(2.0, None, True), (9.0, None, False), (-3.0, 0.2, True), (5.0, np.inf, False)],
)
def test_a_number_or_a_range_of_the_paper_is_in_or_out(low, high, inside):
    values = np.linspace(0, 4, 401)
    assert beside_the_paper(Figure("f", 2.0), values, low, high).paper_inside is inside


def test_the_ratios_of_the_paper_lie_in_what_its_own_few_repetitions_leave_open(tmp_path):
    """The bar of the issue, for table 2 and figure 10; docs/studies.md has the others."""
    for study, runs, name in (
        ("experiment-a", 15, "universal / conventional"),
        ("fig10", 8, "special / conventional"),
    ):
        found = figure(conduct(study, runs=runs, folder=tmp_path, plot=False), name)
        assert found.paper_inside, (study, found)
        assert found.interval[0] < found.value < found.interval[1]


def test_rounding_of_its_rows_does_not_explain_the_totals_of_table_4(tmp_path):
    outcome = conduct("table4", folder=tmp_path, plot=False)
    for name, total in (("conventional", 16), ("special", 10)):
        found = figure(outcome, name)
        assert found.interval[0] < found.value < found.interval[1] < total
        assert found.paper_inside is False
