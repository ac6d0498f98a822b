import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.certificate import certify_rotation
from vgrd.calibration.universal.estimate import (
    Equations,
    UniversalProblem,
    calibrate_universal,
    retract,
)
from vgrd.calibration.universal.problem import checked_points
from vgrd.calibration.universal.start import reduced_cost, rotation_candidates
from vgrd.errors import DidNotConverge, NotObservable
from vgrd.geometry import Pose
from vgrd.geometry.least_squares import minimize
from vgrd.geometry.rotation_relaxation import prove, relax

SIGMA = 0.233


def certify(problem, object_from_base):
    K = reduced_cost(checked_points(problem), problem.touches)
    return certify_rotation(K.T @ K, object_from_base.rotation)


def simulate(seed, m, spread_deg, planar, lateral=SIGMA, axial=SIGMA, noise=SIGMA):
    """(problem, true X, true TCP): m touches, wrists turned at random by up to spread_deg."""
    rng = np.random.default_rng(seed)
    p = rng.uniform(-150, 150, (m, 3)) * (1, 1, 0 if planar else 1)
    X = Pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-500, 500, 3))
    tcp = rng.uniform((-100, -100, 50), (100, 100, 250))
    angles = rng.uniform(-spread_deg, spread_deg, (m, 3))
    R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    t = (X.inverse() @ p) - R @ tcp
    touches = TouchSet(R, t, np.array([0, 0, 1.0]), np.full(m, lateral), np.full(m, axial))
    return UniversalProblem(p + rng.normal(0, noise, p.shape), touches), X, tcp


def lowest_known_cost(problem, X, tcp):
    """The best of the truth and of every valley that a search over all rotations finds."""
    equations = Equations(problem.points_in_object, problem.touches)
    rotations = rotation_candidates(reduced_cost(problem.points_in_object, problem.touches))
    starts = [(X.rotation, X.translation, tcp), *map(equations.start, rotations)]
    return min(minimize(equations.linearize, retract, s).report.cost for s in starts)


@pytest.mark.parametrize("m", [4, 5, 6, 8])
def test_no_problem_ends_in_a_wrong_optimum_and_each_is_proven(m):
    for planar, spread in itertools.product([False, True], [10, 30, 60, 180]):
        for seed in range(20):
            problem, X, tcp = simulate(1000 * m + seed, m, spread, planar)
            try:
                result = calibrate_universal(problem)
            except NotObservable:
                assert (m, spread) == (4, 10)
                continue
            lowest = lowest_known_cost(problem, X, tcp)
            assert result.report.cost <= lowest * (1 + 1e-6) + 1e-12
            assert result.certificate.tight
            assert 0 <= result.certificate.gap < 1e-6


def test_plain_gauss_newton_fails_where_the_certificate_says_so():
    wrong = 0
    for seed in range(60):
        problem, *_ = simulate(seed, 4, (10, 30, 60, 180)[seed % 4], planar=seed % 2 == 0)
        try:
            best = calibrate_universal(problem).report.cost
        except NotObservable:
            continue
        try:
            plain = calibrate_universal(problem, "gauss-newton")
        except (NotObservable, DidNotConverge):
            wrong += 1
            continue
        missed = plain.report.cost > best * (1 + 1e-6)
        assert plain.certificate.tight != missed
        wrong += missed
    assert 0 < wrong < 20


def test_plain_gauss_newton_from_nearby_is_the_same_optimum():
    problem, X, tcp = simulate(7, 8, 60, planar=False)
    near = (Pose.exp((5, -5, 5, 0.05, 0.02, -0.03)) @ X, tcp + 5)
    plain = calibrate_universal(problem, "gauss-newton", near)
    best = calibrate_universal(problem)
    np.testing.assert_allclose(plain.tcp_in_wrist, best.tcp_in_wrist, atol=1e-5)
    assert plain.report.steps < 10
    assert plain.certificate.tight


def test_perfect_data_are_proven_too():
    problem, X, _ = simulate(3, 6, 60, planar=True, noise=0.0)
    assert calibrate_universal(problem).certificate.tight
    assert certify(problem, X).tight


def test_touches_that_measure_less_along_the_tool_are_proven_too():
    for seed, axial in itertools.product(range(10), [1.0, 5.0]):
        problem, *_ = simulate(seed, 8, 60, planar=False, axial=axial)
        assert calibrate_universal(problem).certificate.tight


def test_a_wrong_rotation_is_not_proven():
    problem, X, _ = simulate(3, 6, 60, planar=False)
    certificate = certify(problem, Pose.exp((0, 0, 0, 0, 0, 0.5)) @ X)
    assert not certificate.tight
    assert certificate.gap > 0.1


def test_the_relaxation_alone_finds_and_proves_the_optimum():
    for seed in range(20):
        problem, *_ = simulate(seed, 5, 60, planar=seed % 2 == 0)
        K = reduced_cost(problem.points_in_object, problem.touches)
        relaxed = relax(K.T @ K)
        best = calibrate_universal(problem).object_from_base.rotation
        turn = Rotation.from_matrix(relaxed.rotation @ best).magnitude()
        assert turn < 0.01
        assert prove(K.T @ K, best.T, relaxed.slack).tight


def test_no_rotation_costs_less_than_the_proven_bound():
    problem, *_ = simulate(11, 4, 30, planar=True)
    K = reduced_cost(problem.points_in_object, problem.touches)
    result = calibrate_universal(problem)
    best = np.append(result.object_from_base.rotation.T.ravel(), 1.0)
    bound = (1 - result.certificate.gap) * np.sum((K @ best) ** 2)
    near = Rotation.from_matrix(result.object_from_base.rotation.T)
    for turn in (*Rotation.random(200, random_state=0), *(near * Rotation.random(200) ** 0.01)):
        x = np.append(turn.as_matrix().ravel(), 1.0)
        assert np.sum((K @ x) ** 2) >= bound * (1 - 1e-9)


def test_the_order_of_the_touches_does_not_matter():
    problem, *_ = simulate(13, 6, 60, planar=False)
    order = np.random.default_rng(0).permutation(6)
    t = problem.touches
    shuffled = TouchSet(
        t.rotations[order],
        t.translations[order],
        t.axis_in_wrist,
        t.lateral_sigma_mm[order],
        t.axial_sigma_mm[order],
    )
    one = calibrate_universal(problem)
    other = calibrate_universal(UniversalProblem(problem.points_in_object[order], shuffled))
    np.testing.assert_allclose(one.tcp_in_wrist, other.tcp_in_wrist, rtol=0, atol=1e-9)
    assert one.object_from_base.distance(other.object_from_base)[0] < 1e-8
