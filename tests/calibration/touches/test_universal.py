import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm

from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import (
    Equations,
    UniversalProblem,
    calibrate_universal,
    retract,
)
from vgrd.calibration.universal.start import reduced_cost, rotation_candidates
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation
from vgrd.geometry.least_squares import minimize

SIGMA = 0.233
PAPER_STD = SIGMA * truncnorm.std(-0.7 / SIGMA, 0.7 / SIGMA)


def simulate(seed, m=8, spread=np.pi, noise=0.0, planar=False, axis=(0, 0, 1), lateral=1, axial=1):
    """(problem, true X, true TCP) as in the paper's simulation; noise on the CAD points."""
    rng = np.random.default_rng(seed)
    p = rng.uniform(-150, 150, (m, 3)) * (1, 1, 0 if planar else 1)
    X = Pose(Rotation.random(random_state=seed).as_matrix(), rng.uniform(-500, 500, 3))
    tcp = rng.uniform((-100, -100, 50), (100, 100, 250))
    R = Rotation.from_euler("xyz", rng.uniform(-spread, spread, (m, 3))).as_matrix()
    t = (X.inverse() @ p) - R @ tcp
    off = truncnorm.rvs(-0.7 / SIGMA, 0.7 / SIGMA, scale=SIGMA, size=(m, 3), random_state=rng)
    touches = TouchSet(R, t, np.array(axis), np.full(m, float(lateral)), np.full(m, float(axial)))
    return UniversalProblem(p + off * (noise > 0), touches), X, tcp


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("m", [4, 5, 8])
@pytest.mark.parametrize("spread", [np.pi, 0.5])
def test_perfect_touches_give_the_truth(m, spread, planar):
    for seed in range(3):
        problem, X, tcp = simulate(seed, m, spread, planar=planar)
        result = calibrate_universal(problem)
        np.testing.assert_allclose(result.tcp_in_wrist, tcp, atol=1e-5)
        assert result.object_from_base.distance(X) == pytest.approx((0, 0), abs=1e-5)
        np.testing.assert_allclose(result.residuals_mm, 0, atol=1e-6)


def test_no_start_out_of_many_finds_a_lower_cost():
    for seed in range(30):
        problem, *_ = simulate(seed, m=(4, 5, 6)[seed % 3], spread=(3, 0.5)[seed % 2], noise=1)
        found = calibrate_universal(problem)
        equations = Equations(problem.points_in_object, problem.touches)
        for k in range(12):
            start = equations.start(Rotation.random(random_state=100 * seed + k).as_matrix())
            other = minimize(equations.linearize, retract, start).report
            assert found.report.cost <= other.cost * (1 + 1e-6) + 1e-12


def test_the_papers_noise_gives_the_papers_tcp_error():
    errors = []
    for seed in range(150):
        problem, _, tcp = simulate(seed, noise=1)
        errors.append(np.linalg.norm(calibrate_universal(problem).tcp_in_wrist - tcp))
    assert np.mean(errors) == pytest.approx(0.155, abs=0.02)
    assert 0.1 < np.median(errors) < 0.2


def test_the_covariance_is_as_large_as_the_scatter():
    nees = []
    for seed in range(200):
        problem, X, tcp = simulate(seed, 8, 1.0, noise=1, lateral=PAPER_STD, axial=PAPER_STD)
        result = calibrate_universal(problem)
        error = np.concatenate(
            [(result.object_from_base @ X.inverse()).log(), result.tcp_in_wrist]
        )
        error[6:] -= tcp
        nees.append(error @ np.linalg.solve(result.covariance, error))
    assert np.mean(nees) == pytest.approx(9, rel=0.15)


@pytest.mark.parametrize("axial", [1.0, 5.0, np.inf])
def test_the_jacobian_agrees_with_finite_differences(axial):
    problem, *_ = simulate(3, 6, noise=1, axis=(0.6, 0, 0.8), lateral=1.0, axial=axial)
    equations = Equations(problem.points_in_object, problem.touches)
    K = reduced_cost(problem.points_in_object, problem.touches)
    state = equations.start(rotation_candidates(K)[0])
    state = retract(state, np.array([3, -2, 1, 0.01, 0.02, -0.01, 1, 2, 3]))
    J = equations.linearize(state)[1]
    for k, scale in enumerate([1e-3] * 3 + [1e-6] * 3 + [1e-3] * 3):
        step = scale * np.eye(9)[k]
        ahead, behind = (equations.linearize(retract(state, s * step))[0] for s in (1, -1))
        np.testing.assert_allclose(J[:, k], (ahead - behind) / (2 * scale), atol=1e-5)


def test_a_tool_that_measures_along_itself_in_no_touch_leaves_its_length_open():
    problem, *_ = simulate(4, 10, 1.0, axial=np.inf)
    with pytest.raises(NotObservable, match="nothing along the tool") as caught:
        calibrate_universal(problem)
    assert caught.value.rank == 8


def test_some_touches_may_measure_nothing_along_the_tool():
    problem, X, tcp = simulate(4, 10, 1.0)
    R = problem.touches.rotations
    blind = np.arange(10) < 6
    slid = problem.touches.translations + 5 * R[:, :, 2] * (blind * np.arange(-3, 7))[:, None]
    axial = np.where(blind, np.inf, 1.0)
    touches = TouchSet(R, slid, np.array([0, 0, 1.0]), np.ones(10), axial)
    result = calibrate_universal(UniversalProblem(problem.points_in_object, touches))
    np.testing.assert_allclose(result.tcp_in_wrist, tcp, atol=1e-4)
    assert result.object_from_base.distance(X) == pytest.approx((0, 0), abs=1e-4)


def test_a_bad_touch_has_by_far_the_highest_score():
    problem, *_ = simulate(5, 8, 1.0, noise=1, lateral=SIGMA, axial=SIGMA)
    p = problem.points_in_object.copy()
    p[3] += (4, -3, 2)
    scores = calibrate_universal(UniversalProblem(p, problem.touches)).scores
    assert np.argmax(scores) == 3
    assert scores[3] > 6


def with_wrists(rotations, points=None, m=6):
    rng = np.random.default_rng(0)
    p = rng.uniform(-80, 80, (m, 3)) if points is None else points
    t = p - rotations @ (5, -8, 120)
    ones = np.ones(len(p))
    return UniversalProblem(p, TouchSet(rotations, t, np.array([0, 0, 1.0]), ones, ones))


def random_wrists(m=6):
    return Rotation.random(m, random_state=1).as_matrix()


@pytest.mark.parametrize(
    ("problem", "rank", "words"),
    [
        (with_wrists(np.broadcast_to(np.eye(3), (6, 3, 3))), 6, "kept its orientation"),
        (
            with_wrists(np.array([exp_rotation((0, 0, a)) for a in range(6)])),
            8,
            "one axis only",
        ),
        (with_wrists(random_wrists(), np.outer(np.arange(6.0) * 30, (1, 2, 0))), 8, "on one line"),
    ],
)
def test_what_is_not_determined_is_refused_with_rank_and_reason(problem, rank, words):
    with pytest.raises(NotObservable, match=words) as caught:
        calibrate_universal(problem)
    assert caught.value.rank == rank
    assert caught.value.unknowns == 9


def test_too_few_touches_are_refused():
    with pytest.raises(TooFewObservations, match="at least 4"):
        calibrate_universal(with_wrists(random_wrists(3), m=3))


def test_bad_numbers_are_refused():
    good = with_wrists(random_wrists())
    with pytest.raises(InputError, match="finite"):
        calibrate_universal(UniversalProblem(good.points_in_object * np.nan, good.touches))
    t = good.touches
    for bad, words in (
        ((t.rotations, t.translations * np.nan, (0, 0, 1), np.ones(6), np.ones(6)), "NaN"),
        ((t.rotations, t.translations, (0, 0, 1), np.zeros(6), np.ones(6)), "above 0"),
        ((t.rotations, t.translations, (0, 0, 2), np.ones(6), np.ones(6)), "unit vector"),
    ):
        with pytest.raises(InputError, match=words):
            TouchSet(*(np.asarray(part) for part in bad))


def test_a_start_has_the_best_translation_and_tcp_for_its_rotation():
    problem, X, tcp = simulate(2, 8, 1.0)
    _, t, found = Equations(problem.points_in_object, problem.touches).start(X.rotation)
    np.testing.assert_allclose(t, X.translation, atol=1e-8)
    np.testing.assert_allclose(found, tcp, atol=1e-8)
