"""Quick versions of `vgrd study degenerate-touches`, which takes 300 sessions of each kind."""

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.robustness.degenerate_touches import (
    DEGENERATE,
    DOUBTFUL,
    GOOD,
    TCP,
    solve_session,
)
from vgrd.calibration.tcp.sphere import calibrate_sphere
from vgrd.calibration.touches.equations import TouchSet
from vgrd.errors import NotObservable
from vgrd.geometry import exp_rotation
from vgrd.geometry.covariance import observability

SESSIONS = 12


def shares(kind, column):
    rows = [solve_session(seed, kind) for seed in SeedSequence(7).spawn(SESSIONS)]
    return sum(row[column] for row in rows)


@pytest.mark.parametrize("kind", DEGENERATE)
def test_touches_whose_motion_leaves_the_tcp_open_are_refused_whatever_the_noise(kind):
    assert shares(kind, "accepted") == 0


@pytest.mark.parametrize("kind", GOOD)
def test_touches_with_enough_motion_are_accepted(kind):
    assert shares(kind, "accepted") == SESSIONS
    assert shares(kind, "wrong") == 0


@pytest.mark.parametrize("kind", DOUBTFUL)
def test_between_the_two_a_session_is_refused_or_right(kind):
    assert shares(kind, "wrong") == 0


@pytest.mark.parametrize("radius_mm", [None, 25.0])
def test_a_ball_is_found_from_the_outside_where_the_first_guess_lies_beyond_it(radius_mm):
    """Started as if the ball were a point, 12 of 300 such sessions ended in a wrong minimum."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        axes = rng.uniform(-0.6, 0.6, (12, 3))
        R = np.array([exp_rotation(axis) for axis in axes])
        u = rng.normal(size=(12, 3))
        u[:, 2] = np.abs(u[:, 2])
        tips = 25.0 * u / np.linalg.norm(u, axis=1)[:, None]
        told = np.full(12, 0.05)
        found = calibrate_sphere(
            TouchSet(R, tips - R @ TCP, np.array([0, 0, 1.0]), told, told), radius_mm
        )
        np.testing.assert_allclose(found.tcp_in_wrist, TCP, atol=1e-5)


def test_a_ball_that_another_one_rivals_is_refused_or_right():
    """One touch more than unknowns: little is left over that could tell the minima apart."""
    refused = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        R = np.array([exp_rotation(axis) for axis in rng.uniform(-0.6, 0.6, (7, 3))])
        u = rng.normal(size=(7, 3))
        tips = 25.0 * u / np.linalg.norm(u, axis=1)[:, None] + rng.normal(size=(7, 3)) * 0.2
        told = np.full(7, 0.2)
        touches = TouchSet(R, tips - R @ TCP, np.array([0, 0, 1.0]), told, told)
        try:
            found = calibrate_sphere(touches, 25.0)
        except NotObservable as fault:
            refused += "two TCPs" in str(fault)
        else:
            off = found.tcp_in_wrist - TCP
            assert off @ np.linalg.solve(found.covariance, off) < 36
    assert refused > 0


def test_a_direction_that_only_the_noise_of_its_columns_measures_does_not_count():
    rng = np.random.default_rng(1)
    sigma = 0.05
    J = np.column_stack([np.ones(30), rng.normal(size=30) * sigma, rng.normal(size=30)])
    assert observability(J, np.ones(3), 1e-3).rank == 3
    known = observability(J, np.ones(3), 1e-3, np.array([0.0, sigma, 0.0]))
    assert known.rank == 2
    assert abs(known.undetermined[0, 1]) > 0.99
