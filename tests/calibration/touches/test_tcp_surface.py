import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.calibration.tcp.plane import Plane, calibrate_plane
from vgrd.calibration.tcp.sphere import calibrate_sphere
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import UniversalProblem, calibrate_universal
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation

TCP = np.array([5.0, -8.0, 120.0])
SIGMA = 0.1
NORMAL = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
PLANE = Plane(NORMAL, 75.0)
CENTER = np.array([400.0, 100.0, 60.0])
RADIUS = 25.0
KNOWN = [True, False]


def touching(R, tips, sigma=SIGMA, axial=None):
    m = len(R)
    axial = sigma if axial is None else axial
    return TouchSet(R, tips - R @ TCP, np.array([0, 0, 1.0]), np.full(m, sigma), np.full(m, axial))


def wrists(rng, m, spread=0.6):
    return Rotation.from_rotvec(rng.uniform(-spread, spread, (m, 3))).as_matrix()


def on_plane(seed, m=14, noise=SIGMA, normal=NORMAL, spread=0.6):
    rng = np.random.default_rng(seed)
    flat = np.linalg.svd(normal[None])[2][1:]
    tips = rng.uniform(-120, 120, (m, 2)) @ flat + normal * PLANE.offset_mm
    return touching(wrists(rng, m, spread), tips + rng.normal(0, noise, (m, 3)))


def on_ball(seed, m=16, noise=SIGMA):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(m, 3))
    u[:, 2] = np.abs(u[:, 2])
    u /= np.linalg.norm(u, axis=1)[:, None]
    return touching(wrists(rng, m), CENTER + RADIUS * u + rng.normal(0, noise, (m, 3)))


def plane_tcp(touches, known):
    return calibrate_plane(touches, PLANE if known else None)


def ball_tcp(touches, known):
    return calibrate_sphere(touches, RADIUS if known else None)


@pytest.mark.parametrize("known", KNOWN)
def test_a_plane_gives_the_tcp_and_the_plane(known):
    for seed in range(10):
        found = plane_tcp(on_plane(seed, noise=0.0), known)
        np.testing.assert_allclose(found.tcp_in_wrist, TCP, atol=1e-5)
        n = found.surface.normal_in_base
        np.testing.assert_allclose(
            n * found.surface.offset_mm, NORMAL * PLANE.offset_mm, atol=1e-5
        )


@pytest.mark.parametrize("known", KNOWN)
def test_a_ball_gives_the_tcp_the_centre_and_the_radius(known):
    for seed in range(10):
        found = ball_tcp(on_ball(seed, noise=0.0), known)
        np.testing.assert_allclose(found.tcp_in_wrist, TCP, atol=1e-5)
        np.testing.assert_allclose(found.surface.center_in_base, CENTER, atol=1e-5)
        assert found.surface.radius_mm == pytest.approx(RADIUS, abs=1e-5)


@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize(("draw", "solve"), [(on_plane, plane_tcp), (on_ball, ball_tcp)])
def test_the_covariance_is_as_large_as_the_scatter(draw, solve, known):
    nees = []
    for seed in range(150):
        found = solve(draw(seed, m=20), known)
        error = found.tcp_in_wrist - TCP
        nees.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(nees) == pytest.approx(3, rel=0.2)


@pytest.mark.parametrize("direction", np.vstack([np.eye(3), -np.eye(3)]))
def test_an_unknown_plane_may_stand_in_any_direction(direction):
    found = calibrate_plane(on_plane(1, normal=direction))
    np.testing.assert_allclose(found.tcp_in_wrist, TCP, atol=1.5)
    assert abs(found.surface.normal_in_base @ direction) > 0.9999


def test_a_direction_that_was_not_measured_does_not_count():
    touches = on_plane(3, m=10, noise=0.0)
    blind = TouchSet(
        touches.rotations,
        touches.translations + NORMAL * 7.0 * (np.arange(10) == 4)[:, None],
        touches.axis_in_wrist,
        touches.lateral_sigma_mm,
        np.where(np.arange(10) == 4, np.inf, SIGMA),
    )
    found = calibrate_plane(blind, PLANE)
    np.testing.assert_allclose(found.tcp_in_wrist, TCP, atol=1e-6)
    assert found.degrees_of_freedom == 6


def turned_about(axis, m=16):
    return np.array([exp_rotation(np.array(axis) * a) for a in np.linspace(-0.6, 0.6, m)])


@pytest.mark.parametrize("known", KNOWN)
def test_a_constant_wrist_is_refused_with_the_missing_motion(known):
    R = np.broadcast_to(np.eye(3), (16, 3, 3))
    plane, ball = on_plane(0, m=16), on_ball(0, m=16)
    for touches, solve in ((plane, plane_tcp), (ball, ball_tcp)):
        tips = touches.rotations @ TCP + touches.translations
        with pytest.raises(NotObservable, match="kept its orientation"):
            solve(touching(R, tips), known)


@pytest.mark.parametrize("known", KNOWN)
def test_one_axis_of_tilt_is_refused_with_the_missing_motion(known):
    R = turned_about(np.linalg.svd(NORMAL[None])[2][1])
    plane, ball = on_plane(0, m=16), on_ball(0, m=16)
    for touches, solve in ((plane, plane_tcp), (ball, ball_tcp)):
        tips = touches.rotations @ TCP + touches.translations
        with pytest.raises(NotObservable, match="one axis only"):
            solve(touching(R, tips), known)


def test_a_plane_touched_on_one_line_is_refused():
    rng = np.random.default_rng(0)
    line = np.linalg.svd(NORMAL[None])[2][1]
    tips = np.outer(np.linspace(-100, 100, 12), line) + NORMAL * PLANE.offset_mm
    with pytest.raises(NotObservable, match="on one line"):
        calibrate_plane(touching(wrists(rng, 12), tips))


def test_a_ball_touched_with_the_tool_always_upright_on_it_is_refused():
    rng = np.random.default_rng(0)
    R = wrists(rng, 16)
    with pytest.raises(NotObservable, match="several sides"):
        calibrate_sphere(touching(R, CENTER - RADIUS * R[:, :, 2]))


def test_too_few_touches_and_impossible_surfaces_are_refused():
    with pytest.raises(TooFewObservations, match="at least 3"):
        calibrate_plane(on_plane(0, m=2), PLANE)
    with pytest.raises(TooFewObservations, match="at least 7"):
        calibrate_plane(on_plane(0, m=6))
    with pytest.raises(TooFewObservations, match="at least 8"):
        calibrate_sphere(on_ball(0, m=7))
    with pytest.raises(TooFewObservations, match="at least 7"):
        calibrate_sphere(on_ball(0, m=6), RADIUS)
    with pytest.raises(InputError, match="unit vector"):
        calibrate_plane(on_plane(0), Plane(np.array([0, 0, 2.0]), 1.0))
    with pytest.raises(InputError, match="positive"):
        calibrate_sphere(on_ball(0), -1.0)


def test_tip_positions_from_a_tracker_give_the_tcp_and_the_tracker():
    rng = np.random.default_rng(2)
    tracker_from_base = Pose.from_rotvec((0.3, -0.8, 2.0), (2500, -400, 900))
    R = wrists(rng, 8)
    tips = rng.uniform(-300, 300, (8, 3)) + CENTER
    seen = tracker_from_base @ tips + rng.normal(0, 0.02, (8, 3))
    found = calibrate_universal(UniversalProblem(seen, touching(R, tips, 0.02)))
    assert np.linalg.norm(found.tcp_in_wrist - TCP) < 0.15
    assert found.object_from_base.distance(tracker_from_base)[0] < 0.5
    assert found.certificate.tight
