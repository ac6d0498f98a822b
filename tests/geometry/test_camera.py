import cv2
import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import pose_from_points

SIZE = (1600, 1200)
MATRIX = np.array([[1352.0, 0, 789.7], [0, 1356.1, 627.3], [0, 0, 1]])
DISTORTIONS = [
    (),
    (-0.08, 0.1, 2e-4, -1e-4),
    (-0.3, 0.12, 1e-3, -5e-4, -0.02),
    (0.2, -0.1, 1e-3, -5e-4, 0.01, 0.3, -0.05, 0.01),
]
PLANE = np.array([[x, y, 0.0] for x in (0, 30, 60, 90) for y in (0, 30, 60)])
SPACE = np.random.default_rng(3).uniform(-50, 50, (9, 3))


def camera(distortion=()):
    return CameraModel(MATRIX, np.array(distortion), SIZE)


def points(rng, n=40):
    return rng.uniform((-200, -150, 500), (200, 150, 900), (n, 3))


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_projection_agrees_with_opencv(distortion):
    p = points(np.random.default_rng(1))
    expected = cv2.projectPoints(p, np.zeros(3), np.zeros(3), MATRIX, np.array(distortion))[0]
    np.testing.assert_allclose(camera(distortion).project(p), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_projection_derivatives_agree_with_finite_differences(distortion):
    c = camera(distortion)
    p = points(np.random.default_rng(2))
    pixels, J = c.linearize(p)
    np.testing.assert_allclose(pixels, c.project(p))
    for k, d in enumerate(np.eye(3) * 1e-3):
        np.testing.assert_allclose(
            J[:, :, k], (c.project(p + d) - c.project(p - d)) / 2e-3, atol=1e-6
        )
    J = c.intrinsics_jacobian(p)
    for k, d in enumerate(np.diag([1e-3] * 4 + [1e-6] * 2)):
        ahead, behind = (c.with_intrinsics(c.intrinsics() + s * d) for s in (1, -1))
        numeric = (ahead.project(p) - behind.project(p)) / (2 * d[k])
        np.testing.assert_allclose(J[:, :, k], numeric, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_a_ray_goes_back_to_its_point(distortion):
    c = camera(distortion)
    p = points(np.random.default_rng(4))
    np.testing.assert_allclose(c.normalize(c.project(p)), p[:, :2] / p[:, 2:], atol=1e-12)


def test_points_behind_the_camera_have_no_pixel():
    assert np.isnan(camera().project([[0, 0, -5.0], [0, 0, 0.0]])).all()


def test_a_pixel_no_ray_can_reach_is_not_a_number():
    barrel = CameraModel(MATRIX, np.array([-0.5, 0, 0, 0]), SIZE)
    assert np.isnan(barrel.normalize([[8000.0, 627.3]])).all()
    assert np.isfinite(barrel.normalize([[800.0, 627.3]])).all()


@pytest.mark.parametrize(
    ("matrix", "distortion", "words"),
    [
        (np.eye(4), (), r"\(3, 3\)"),
        (MATRIX * np.nan, (), "finite"),
        (MATRIX + np.diag([0, 0, 1]), (), "fx"),
        (np.diag([-1.0, 1, 1]), (), "fx"),
        (MATRIX, (1, 2, 3), "3 numbers"),
    ],
)
def test_bad_intrinsics_are_refused(matrix, distortion, words):
    with pytest.raises(InputError, match=words):
        CameraModel(matrix, np.array(distortion), SIZE)


def scene(seed, target, distortion=()):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    tilt = rng.uniform(0.2, 0.9) * axis / np.linalg.norm(axis)
    pose = Pose.from_rotvec(tilt, rng.uniform((-80, -80, 500), (80, 80, 800)))
    pose = pose @ Pose.from_rotvec((0, 0, rng.uniform(-3, 3)))
    return rng, pose, camera(distortion).project(pose @ target)


@pytest.mark.parametrize(
    "target", [PLANE, PLANE[[0, 2, 9, 11]], SPACE], ids=["plane", "4", "space"]
)
@pytest.mark.parametrize("seed", range(12))
def test_a_pose_is_found_again_from_perfect_pixels(seed, target):
    distortion = DISTORTIONS[seed % 4]
    _, pose, uv = scene(seed, target, distortion)
    found = pose_from_points(target, uv, camera(distortion))
    assert found.camera_from_target.distance(pose) == pytest.approx((0, 0), abs=1e-5)
    assert found.rms_px < 1e-6


@pytest.mark.parametrize("seed", range(8))
def test_a_noisy_pose_is_the_one_opencv_refines_to(seed):
    rng, _, uv = scene(seed, PLANE, DISTORTIONS[1])
    uv = uv + rng.normal(scale=0.1, size=uv.shape)
    found = pose_from_points(PLANE, uv, camera(DISTORTIONS[1])).camera_from_target
    _, r, t = cv2.solvePnP(PLANE, uv, MATRIX, np.array(DISTORTIONS[1]), flags=cv2.SOLVEPNP_IPPE)
    r, t = cv2.solvePnPRefineLM(PLANE, uv, MATRIX, np.array(DISTORTIONS[1]), r, t)
    other = Pose.from_rotvec(r[:, 0], t[:, 0])
    assert found.distance(other) == pytest.approx((0, 0), abs=2e-3)


def test_the_better_of_two_mirrored_poses_is_kept_whatever_the_start_was():
    target = PLANE[[0, 2, 9, 11]]
    wrong = 0
    for seed in range(40):
        rng, pose, uv = scene(seed, target)
        found = pose_from_points(target, uv + rng.normal(scale=0.02, size=uv.shape), camera())
        wrong += found.camera_from_target.distance(pose)[1] > 0.02
    assert wrong == 0


def test_the_covariance_of_a_pose_is_as_large_as_its_scatter():
    rng, pose, uv = scene(5, PLANE)
    nees = []
    for _ in range(300):
        noisy = uv + rng.normal(scale=0.2, size=uv.shape)
        found = pose_from_points(PLANE, noisy, camera(), pose, sigma_px=0.2)
        xi = (found.camera_from_target @ pose.inverse()).log()
        nees.append(xi @ np.linalg.solve(found.covariance, xi))
    assert np.mean(nees) == pytest.approx(6, rel=0.12)


@pytest.mark.parametrize(
    ("target", "pixels", "words"),
    [
        (PLANE[:3], np.zeros((3, 2)), "at least 4"),
        (PLANE, np.zeros((3, 2)), "shapes"),
        (PLANE * np.nan, np.zeros((12, 2)), "finite"),
        (np.outer(np.arange(5.0), (1, 2, 3)), np.zeros((5, 2)), "one line"),
        (SPACE[:5], np.arange(10.0).reshape(5, 2), "at least 6"),
    ],
)
def test_points_that_give_no_pose_are_refused(target, pixels, words):
    with pytest.raises(InputError, match=words):
        pose_from_points(target, pixels, camera())
