from dataclasses import replace

import cv2
import numpy as np
import pytest

from vgrd.calibration.hand_eye.fit import PoseSample
from vgrd.calibration.hand_eye.park_martin import park_martin_start
from vgrd.calibration.hand_eye.pose_pairs import HandEyeProblem, calibrate_hand_eye
from vgrd.calibration.hand_eye.recording import calibrate_recording
from vgrd.calibration.hand_eye.recording_problem import PointSample, points_problem
from vgrd.calibration.levels import Level
from vgrd.errors import CalibrationError, InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import Mount

CAMERA = CameraModel(
    [[1352.0, 0, 789.7], [0, 1356.1, 627.3], [0, 0, 1]], [-0.1, 0.05, 0, 0], (1600, 1200)
)
BOARD = np.array([[x, y, 0.0] for x in range(0, 120, 30) for y in range(0, 180, 30)]) - (45, 75, 0)
MOUNTS = list(Mount)
TIGHT = np.diag([1e-4] * 3 + [1e-8] * 3)
X_TRUE = {
    Mount.EYE_TO_HAND: Pose.from_rotvec((2.0, -1.5, 0.3), (900, 100, 700)),
    Mount.EYE_IN_HAND: Pose.from_rotvec((0.05, -0.1, 1.5), (40, -60, 80)),
}
Y_TRUE = {
    Mount.EYE_TO_HAND: Pose.from_rotvec((0.1, 0.2, -0.7), (20, -10, 60)),
    Mount.EYE_IN_HAND: Pose.from_rotvec((0.02, 0.01, 0.4), (500, 50, 10)),
}


def wrists(mount, n, seed, spread=0.5):
    """Flange poses from which the target is seen at 500 to 700 mm, turned about all axes."""
    rng = np.random.default_rng(seed)
    X, Y = X_TRUE[mount], Y_TRUE[mount]
    out = []
    for _ in range(n):
        tilt = Pose.from_rotvec(rng.uniform(-spread, spread, 3))
        seen = Pose(np.diag([1.0, -1, -1]), rng.uniform((-80, -60, 500), (80, 60, 700))) @ tilt
        move = X @ seen @ Y.inverse()
        out.append(move if mount is Mount.EYE_TO_HAND else move.inverse())
    return out


def seen(mount, wrist):
    move = wrist if mount is Mount.EYE_TO_HAND else wrist.inverse()
    return X_TRUE[mount].inverse() @ move @ Y_TRUE[mount]


def pose_problem(mount, n=10, seed=0, covariance=TIGHT, robot=(0.0, 0.0), poses=None, **options):
    rng = np.random.default_rng(seed + 1000)
    samples = []
    for i, wrist in enumerate(poses or wrists(mount, n, seed)):
        xi = rng.multivariate_normal(np.zeros(6), covariance) if seed else np.zeros(6)
        slip = Pose.exp(rng.normal(size=6) * np.repeat(robot, 3))
        look = Pose.exp(xi) @ seen(mount, wrist @ slip)
        samples.append(PoseSample(str(i), wrist, look, covariance))
    return HandEyeProblem(mount, samples, *(max(r, 1e-9) for r in robot), **options)


def point_samples(mount, n=10, seed=0, noise_px=0.0, scale=1.0, poses=None):
    rng = np.random.default_rng(seed + 2000)
    samples = []
    for i, wrist in enumerate(poses or wrists(mount, n, seed)):
        uv = CAMERA.project(seen(mount, wrist) @ (BOARD * scale))
        uv = uv + rng.normal(size=uv.shape) * noise_px
        samples.append(PointSample(str(i), wrist, BOARD, uv))
    return samples


def assert_truth(result, mount, mm=1e-4, rad=1e-7):
    for found, truth in (
        (result.mount_from_camera, X_TRUE[mount]),
        (result.mount_from_target, Y_TRUE[mount]),
    ):
        off_mm, off_rad = found.distance(truth)
        assert off_mm < mm
        assert off_rad < rad


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("seed", range(4))
def test_perfect_looks_give_the_truth_from_any_arrangement(mount, seed):
    problem = pose_problem(mount, n=3 + seed, poses=wrists(mount, 3 + seed, seed))
    assert_truth(calibrate_hand_eye(problem), mount)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("seed", range(3))
def test_perfect_pixels_give_the_truth(mount, seed):
    result = calibrate_recording(points_problem(mount, CAMERA, point_samples(mount, seed=seed)))
    assert_truth(result, mount, 1e-3, 1e-6)
    assert max(s.px for s in result.samples) < 1e-4
    assert all(s.used and not s.reason for s in result.samples)


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_closed_form_agrees_with_opencv_on_noisy_data(mount):
    looks = pose_problem(mount, n=12, seed=5, covariance=np.diag([0.04] * 3 + [1e-6] * 3)).samples
    moves = [
        s.base_from_wrist if mount is Mount.EYE_TO_HAND else s.base_from_wrist.inverse()
        for s in looks
    ]
    X, _ = park_martin_start(moves, [s.camera_from_target for s in looks])
    R, t = cv2.calibrateHandEye(
        [m.inverse().rotation for m in moves],
        [m.inverse().translation for m in moves],
        [s.camera_from_target.rotation for s in looks],
        [s.camera_from_target.translation for s in looks],
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    # OpenCV inverts the pairs, which weighs the translations a little differently.
    assert X.distance(Pose(R, t[:, 0])) == pytest.approx((0, 0), abs=0.5)
    np.testing.assert_allclose(X.rotation, R, atol=1e-9)


@pytest.mark.parametrize("mount", MOUNTS)
def test_refinement_beats_the_closed_form_on_looks_of_unequal_quality(mount):
    worse = 0
    for seed in range(1, 6):
        problem = pose_problem(
            mount,
            10,
            seed,
            np.diag([4e-4, 4e-4, 0.09, 1e-6, 1e-6, 1e-8]),
            (0.05, 1e-4),
            robust=False,
        )
        X, _ = park_martin_start(
            [
                s.base_from_wrist if mount is Mount.EYE_TO_HAND else s.base_from_wrist.inverse()
                for s in problem.samples
            ],
            [s.camera_from_target for s in problem.samples],
        )
        refined = calibrate_hand_eye(problem).mount_from_camera
        worse += refined.distance(X_TRUE[mount])[1] > X.distance(X_TRUE[mount])[1]
    assert worse <= 1


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_covariance_is_as_large_as_the_scatter_robot_noise_included(mount):
    nees = []
    covariance = np.diag([1e-3, 1e-3, 1e-2, 1e-6, 1e-6, 1e-8])
    for seed in range(1, 81):
        problem = pose_problem(mount, 8, seed, covariance, (0.1, 2e-4), robust=False)
        result = calibrate_hand_eye(problem)
        C = result.covariance / max(1, result.noise_scale**2)
        xi = np.concatenate(
            [
                (result.mount_from_camera @ X_TRUE[mount].inverse()).log(),
                (result.mount_from_target @ Y_TRUE[mount].inverse()).log(),
            ]
        )
        nees.append(xi @ np.linalg.solve(C, xi))
    assert np.mean(nees) == pytest.approx(12, rel=0.15)


@pytest.mark.parametrize("mount", MOUNTS)
def test_intrinsics_are_found_again_from_wrong_ones(mount):
    wrong = CAMERA.with_intrinsics(np.add(CAMERA.intrinsics(), (8, -6, 10, -7, 0.02, -0.02)))
    samples = point_samples(mount, n=14)
    result = calibrate_recording(points_problem(mount, wrong, samples, refine=True))
    np.testing.assert_allclose(result.camera.intrinsics()[:4], CAMERA.intrinsics()[:4], atol=1e-2)
    assert_truth(result, mount, 1e-2, 1e-4)
    assert (result.intrinsics_sigma > 0).all()


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_size_of_the_board_is_measured_by_the_robots_motion(mount):
    problem = points_problem(mount, CAMERA, point_samples(mount, n=12, noise_px=0.05, scale=1.004))
    result = calibrate_recording(
        replace(problem, blank=replace(problem.blank, refines_scale=True))
    )
    assert result.target_scale == pytest.approx(1.004, abs=4 * result.target_scale_sigma)
    assert 0 < result.target_scale_sigma < 1e-3


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_picture_with_the_wrong_pose_is_left_out_and_named(mount):
    samples = point_samples(mount, noise_px=0.05, poses=wrists(mount, 12, 3))
    moved = samples[7].base_from_wrist @ Pose.from_rotvec((0, 0.02, 0), (30, 10, 5))
    samples[7] = replace(samples[7], base_from_wrist=moved)
    result = calibrate_recording(points_problem(mount, CAMERA, samples))
    assert [s.name for s in result.samples if not s.used] == ["7"]
    assert "mm" in result.samples[7].reason
    assert 25 < result.samples[7].mm < 45
    assert_truth(result, mount, 0.5, 1e-3)


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_warm_start_ends_where_the_closed_form_does(mount):
    samples = point_samples(mount, noise_px=0.1)
    problem = points_problem(mount, CAMERA, samples)
    cold = calibrate_recording(problem)
    warm = calibrate_recording(replace(problem, start=cold))
    assert warm.mount_from_camera.distance(cold.mount_from_camera)[0] < 1e-2
    wrist = samples[0].base_from_wrist
    assert cold.predict(wrist).distance(seen(mount, wrist))[0] < 1


def turning(n, axis, mount=Mount.EYE_TO_HAND):
    first = wrists(mount, 1, 1)[0]
    return [
        Pose(first.rotation, np.add(first.translation, (10 * i, 7 * i * i, -5 * i)))
        @ Pose.from_rotvec(np.multiply(axis, 0.2 * i))
        for i in range(n)
    ]


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("poses", "error", "words"),
    [
        (turning(2, (0, 0, 1)), TooFewObservations, "at least 3"),
        ([turning(1, (0, 0, 1))[0]] * 5, NotObservable, "all 5 robot poses are equal"),
        (turning(6, (0, 0, 0)), NotObservable, "kept its orientation"),
        (turning(6, (0, 0, 1)), NotObservable, "one axis only"),
    ],
)
def test_poses_that_leave_something_open_are_refused_with_the_missing_motion(
    mount, poses, error, words
):
    with pytest.raises(error, match=words):
        calibrate_hand_eye(pose_problem(mount, poses=poses))


@pytest.mark.ordered("the number of a sample is part of what is expected")
@pytest.mark.parametrize("mount", MOUNTS)
def test_one_pose_twice_is_refused_by_name(mount):
    poses = wrists(mount, 6, 1)
    poses[4] = poses[2]
    with pytest.raises(InputError, match="'2' and '4'"):
        calibrate_hand_eye(pose_problem(mount, poses=poses))
    problem = points_problem(mount, CAMERA, point_samples(mount, poses=poses))
    with pytest.raises(InputError, match="'2' and '4'"):
        calibrate_recording(problem)


def test_a_sample_with_bad_points_is_named():
    samples = point_samples(Mount.EYE_TO_HAND, n=5)
    bad = PointSample("x9", samples[0].base_from_wrist, BOARD[:3], np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"'x9'.*at least 4"):
        points_problem(Mount.EYE_TO_HAND, CAMERA, [*samples[1:], bad])


def test_intrinsics_from_too_few_pictures_are_refused():
    samples = point_samples(Mount.EYE_TO_HAND, n=3)
    problem = points_problem(Mount.EYE_TO_HAND, CAMERA, samples, refine=True)
    with pytest.raises(CalibrationError, match="18 unknowns"):
        calibrate_recording(problem)


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_covariance_of_a_predicted_pose_is_that_of_shaken_calibrations(mount):
    samples = point_samples(mount, n=9, seed=2, noise_px=0.4)
    result = calibrate_recording(points_problem(mount, CAMERA, samples))
    wrist = wrists(mount, 1, 77)[0]
    rng = np.random.default_rng(8)
    expected = result.predict(wrist)
    steps = rng.multivariate_normal(np.zeros(12), result.covariance, 4000)
    off = []
    for step in steps:
        moved = replace(
            result,
            mount_from_camera=Pose.exp(step[:6]) @ result.mount_from_camera,
            mount_from_target=Pose.exp(step[6:]) @ result.mount_from_target,
        ).predict(wrist)
        turn = (moved @ expected.inverse()).rotvec()
        off.append([*(moved.translation - expected.translation), *turn])
    ratio = np.linalg.eigvals(
        np.linalg.solve(result.pose_covariance(wrist), np.cov(np.transpose(off)))
    ).real
    assert ratio.min() > 0.85
    assert ratio.max() < 1.15


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_noise_of_a_look_is_told_in_its_own_size(mount):
    samples = point_samples(mount, n=40, seed=4, noise_px=0.5)
    problem = points_problem(mount, CAMERA, samples)
    result = calibrate_recording(problem)
    own = [
        np.r_[p.translation - q.translation, (p @ q.inverse()).rotvec()]
        for p, q in (
            (result.predict(s.base_from_wrist), c)
            for s, c in zip(samples, problem.cameras, strict=True)
        )
    ]
    d2 = [xi @ np.linalg.solve(C, xi) for xi, C in zip(own, result.looks, strict=True)]
    assert 4.5 < np.mean(d2) < 7.5  # six numbers each, less what 12 unknowns of 240 take


def test_a_level_that_is_known_stays():
    samples = point_samples(Mount.EYE_TO_HAND, n=10, seed=1, noise_px=0.2)
    problem = points_problem(Mount.EYE_TO_HAND, CAMERA, samples)
    arm = Level("arm's position", "mm", 1.0, 3.0, 0.01)
    found = {level.name: level.found for level in calibrate_recording(problem).levels}
    with_it = calibrate_recording(replace(problem, known=(arm,)))
    assert found["arm's position"] < 0.3
    assert {v.name: v.found for v in with_it.levels}["arm's position"] == pytest.approx(3, rel=0.1)
