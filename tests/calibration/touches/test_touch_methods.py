import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.calibration.tcp.fixed_point import calibrate_fixed_point
from vgrd.calibration.touches.cad_fit import fit_cad, kabsch
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.turntable.rotation_center import find_rotation_center
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation

TCP = np.array([5.0, -8.0, 120.0])
PIN = np.array([400.0, 100.0, 60.0])
RING = np.array([[80 * np.cos(a), 80 * np.sin(a), 0] for a in np.arange(6) * np.pi / 3])
FIT = Pose.from_rotvec((0.02, -0.03, 1.1), (350, 20, 170))


def touching(rotations, translations, sigma=0.233, axial=None):
    m = len(rotations)
    return TouchSet(
        np.asarray(rotations),
        np.asarray(translations),
        np.array([0, 0, 1.0]),
        np.full(m, sigma),
        np.full(m, sigma if axial is None else axial),
    )


def pin_touches(seed, m=10, sigma=0.233, spread=0.5, noise=True):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.uniform(-spread, spread, (m, 3))).as_matrix()
    return touching(R, PIN - R @ TCP + rng.normal(size=(m, 3)) * sigma * noise, sigma)


def test_a_fixed_point_gives_tcp_and_point():
    result = calibrate_fixed_point(pin_touches(0, noise=False))
    np.testing.assert_allclose(result.tcp_in_wrist, TCP, atol=1e-9)
    np.testing.assert_allclose(result.point_in_base, PIN, atol=1e-9)


def test_the_covariance_of_a_fixed_point_is_as_large_as_the_scatter():
    nees = []
    for seed in range(200):
        result = calibrate_fixed_point(pin_touches(seed))
        error = np.concatenate([result.tcp_in_wrist - TCP, result.point_in_base - PIN])
        nees.append(error @ np.linalg.solve(result.covariance, error))
    assert np.mean(nees) == pytest.approx(6, rel=0.15)


@pytest.mark.parametrize(
    ("rotations", "rank", "words"),
    [
        ([np.eye(3)] * 5, 3, "kept its orientation"),
        ([exp_rotation((0, 0, a)) for a in range(5)], 5, "one axis only"),
    ],
)
def test_a_fixed_point_without_tilt_is_refused(rotations, rank, words):
    R = np.array(rotations)
    with pytest.raises(NotObservable, match=words) as caught:
        calibrate_fixed_point(touching(R, PIN - R @ TCP))
    assert caught.value.rank == rank


def test_two_touches_of_a_fixed_point_are_too_few():
    with pytest.raises(TooFewObservations):
        calibrate_fixed_point(pin_touches(0, m=2))


def ring_touches(seed=0, sigma=0.233, noise=True, axial=None, points=RING):
    rng = np.random.default_rng(seed)
    t = (FIT @ points) + rng.normal(size=points.shape) * sigma * noise
    return touching([exp_rotation((3.1, 0, 0.3))] * len(points), t, sigma, axial)


def test_flange_positions_of_all_targets_follow_from_touches_and_cad():
    fit = fit_cad(RING, ring_touches(noise=False))
    assert fit.base_from_object_flange.distance(FIT) == pytest.approx((0, 0), abs=1e-9)
    np.testing.assert_allclose(fit.flange(np.array([1.0, 2, 3])), FIT @ np.array([1.0, 2, 3]))


def test_the_cad_fit_of_equal_touches_is_the_closed_form():
    touches = ring_touches(4)
    fit = fit_cad(RING, touches).base_from_object_flange
    assert fit.distance(kabsch(RING, touches.translations)) == pytest.approx((0, 0), abs=1e-7)


def test_the_covariance_of_the_cad_fit_is_as_large_as_the_scatter():
    nees = []
    for seed in range(200):
        fit = fit_cad(RING, ring_touches(seed))
        xi = (fit.base_from_object_flange @ FIT.inverse()).log()
        nees.append(xi @ np.linalg.solve(fit.covariance, xi))
    assert np.mean(nees) == pytest.approx(6, rel=0.15)


def test_a_rough_direction_does_not_disturb_the_fine_ones():
    touches = ring_touches(noise=False, axial=50.0)
    axis = touches.rotations[0] @ touches.axis_in_wrist
    slid = touches.translations + axis * np.array([3, -2, 4, -1, 2, -3])[:, None]
    fit = fit_cad(RING, touching(touches.rotations, slid, 0.1, 50.0))
    assert (
        np.linalg.norm((fit.flange(RING[0]) - FIT @ RING[0]) @ (np.eye(3) - np.outer(axis, axis)))
        < 0.1
    )


@pytest.mark.parametrize(
    ("points", "axial", "rank", "words"),
    [
        (np.outer(np.arange(5.0) * 20, (1, 2, 0)), None, 5, "on one line"),
        (RING, np.inf, 5, "nothing along the tool"),
    ],
)
def test_a_cad_fit_that_is_not_determined_is_refused(points, axial, rank, words):
    with pytest.raises(NotObservable, match=words) as caught:
        fit_cad(points, ring_touches(axial=axial, points=points))
    assert caught.value.rank == rank


def test_a_cad_fit_needs_three_touches_and_finite_points():
    with pytest.raises(TooFewObservations):
        fit_cad(RING[:2], ring_touches(points=RING[:2]))
    with pytest.raises(InputError, match="finite"):
        fit_cad(RING * np.nan, ring_touches())


CENTER = np.array([-30.0, 45.0, -12.0])
CAMERA_FROM_AXIS = Pose.from_rotvec((2.8, 0.4, 0.1), (20, -30, 640))
# A tag at 700 mm, each number of it perturbed by 1e-12 (`--perturb`), errs by 7e-10 mm: ten times that.
ROUNDING_MM = 1e-8
AXIS_FROM_TAG = Pose.from_rotvec((0.3, -0.2, 0.5), (35, 20, 10))


def spins(angles, seed=None, covariance=None):
    rng = np.random.default_rng(seed)
    out = []
    for a in angles:
        pose = CAMERA_FROM_AXIS @ Pose.from_rotvec((0, 0, a)) @ AXIS_FROM_TAG
        if seed is not None:
            pose = Pose.exp(rng.multivariate_normal(np.zeros(6), covariance)) @ pose
        out.append(pose)
    return out


def test_the_rotation_centre_is_a_point_of_the_axis_nearest_to_the_tag():
    found = find_rotation_center(spins(np.linspace(0, 5, 7)))
    axis = AXIS_FROM_TAG.rotation.T @ (0, 0, 1)
    origin = AXIS_FROM_TAG.inverse() @ np.zeros(3)
    off = found.center_in_tag - origin
    np.testing.assert_allclose(off - axis * (axis @ off), 0, atol=ROUNDING_MM)
    assert abs(found.center_in_tag @ axis) < ROUNDING_MM
    assert abs(found.axis_in_tag @ axis) == pytest.approx(1)
    np.testing.assert_allclose(found.residuals_mm, 0, atol=ROUNDING_MM)


def test_the_rotation_centre_moves_to_a_height_along_its_axis():
    found = find_rotation_center(spins(np.linspace(0, 5, 7)))
    wanted = CAMERA_FROM_AXIS @ np.array([0, 0, 55.0])
    in_tag, in_camera = found.at_height(wanted)
    np.testing.assert_allclose(in_camera, wanted, atol=1e-9)
    np.testing.assert_allclose(in_tag, AXIS_FROM_TAG.inverse() @ (0, 0, 55.0), atol=1e-9)


def test_the_covariance_of_the_centre_is_as_large_as_its_scatter_across_the_axis():
    axis = AXIS_FROM_TAG.rotation.T @ (0, 0, 1)
    across = np.linalg.svd(axis[None])[2][1:]
    truth = AXIS_FROM_TAG.inverse() @ np.zeros(3)
    G = np.eye(6)
    own = np.diag([1e-4, 1e-4, 4e-3, 1e-7, 1e-7, 1e-8])
    t = CAMERA_FROM_AXIS.translation
    G[:3, 3:] = [[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]
    covariance = G @ own @ G.T
    nees = []
    for seed in range(200):
        found = find_rotation_center(
            spins(np.linspace(0, 5, 8), seed, covariance), [covariance] * 8
        )
        off = across @ (found.center_in_tag - truth)
        C = across @ found.covariance[:3, :3] @ across.T
        nees.append(off @ np.linalg.solve(C, off))
    assert np.mean(nees) == pytest.approx(2, rel=0.2)


def test_an_object_that_was_not_turned_has_no_centre():
    with pytest.raises(NotObservable, match="turned by"):
        find_rotation_center(spins([0, 0.01, 0.02, 0.01]))
    with pytest.raises(TooFewObservations):
        find_rotation_center(spins([0, 1]))
    with pytest.raises(InputError, match="as many covariances"):
        find_rotation_center(spins([0, 1, 2]), [np.eye(6)])


def test_a_slipped_object_stands_out_in_the_residuals():
    poses = spins(np.linspace(0, 5, 8))
    poses[5] = Pose(poses[5].rotation, np.add(poses[5].translation, (2, 0, 0)))
    found = find_rotation_center(poses)
    assert np.argmax(found.scores) == 5
