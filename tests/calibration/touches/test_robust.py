import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.calibration.observability.leave_one_out import fit_without_outliers, noise_scale
from vgrd.calibration.tcp.fixed_point import calibrate_fixed_point
from vgrd.calibration.tcp.plane import fit_plane
from vgrd.calibration.tcp.sphere import fit_sphere
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import UniversalProblem, calibrate_universal

TCP = np.array([5.0, -8.0, 120.0])
SIGMA = 0.233


def touching(rng, tips, sigma=SIGMA, noise=SIGMA):
    m = len(tips)
    R = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (m, 3))).as_matrix()
    t = tips - R @ TCP + rng.normal(0, noise, (m, 3))
    return TouchSet(R, t, np.array([0, 0, 1.0]), np.full(m, sigma), np.full(m, sigma))


def shifted(touches, which, off):
    t = touches.translations.copy()
    t[which] += off
    return TouchSet(
        touches.rotations,
        t,
        touches.axis_in_wrist,
        touches.lateral_sigma_mm,
        touches.axial_sigma_mm,
    )


def direction(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def robust_universal(p, touches):
    return fit_without_outliers(
        lambda weights: calibrate_universal(UniversalProblem(p, touches.weighted(weights))),
        len(p),
    )


def test_a_blunder_of_two_millimetres_among_eight_touches_is_named():
    named, alarms, errors, clean_errors = 0, 0, [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        p = rng.uniform(-100, 100, (8, 3))
        touches = touching(rng, p)
        clean = robust_universal(p, touches)
        alarms += not clean.used.all()
        clean_errors.append(np.linalg.norm(clean.result.tcp_in_wrist - TCP))
        bad = int(rng.integers(8))
        found = robust_universal(p, shifted(touches, bad, 2.0 * direction(rng)))
        named += list(np.flatnonzero(~found.used)) == [bad]
        errors.append(np.linalg.norm(found.result.tcp_in_wrist - TCP))
    assert named >= 36
    assert alarms <= 2
    assert np.mean(errors) < 1.4 * np.mean(clean_errors)


SURFACES = {
    "fixed point": (calibrate_fixed_point, lambda _: np.zeros((16, 3))),
    "plane": (fit_plane, lambda rng: rng.uniform(-150, 150, (16, 3)) * (1, 1, 0)),
    "ball": (
        fit_sphere,
        lambda rng: 20.0 * np.array([direction(rng) for _ in range(16)]),
    ),
}


@pytest.mark.parametrize("name", SURFACES)
def test_two_blunders_in_the_conventional_methods_are_left_out(name):
    solve, draw = SURFACES[name]
    for seed in range(8):
        rng = np.random.default_rng(seed)
        touches = shifted(touching(rng, draw(rng), 0.05, 0.05), [2, 9], (0, 0, 15.0))
        found = fit_without_outliers(lambda w, t=touches: solve(t.weighted(w)), 16)
        assert not found.used[2] or found.scores[2] < 4  # off along a surface is no error
        assert not found.used[9] or found.scores[9] < 4
        assert np.linalg.norm(found.result.tcp_in_wrist - TCP) < 1.0


def test_touches_that_all_scatter_more_are_not_called_bad():
    rng = np.random.default_rng(1)
    p = rng.uniform(-100, 100, (10, 3))
    found = robust_universal(p, touching(rng, p, sigma=0.05, noise=0.5))
    assert found.used.all()
    assert 5 < noise_scale(found.result) < 15


def test_with_nothing_left_over_nothing_is_left_out():
    rng = np.random.default_rng(1)
    p = rng.uniform(-100, 100, (4, 3))
    found = robust_universal(p, shifted(touching(rng, p), 2, (5.0, 0, 0)))
    assert found.used.all()
