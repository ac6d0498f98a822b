from dataclasses import replace

import numpy as np
import pytest

from vgrd.calibration.hand_eye.certificate import certified_start, rotation_cost
from vgrd.calibration.hand_eye.fit import PoseSample
from vgrd.calibration.hand_eye.null_space import null_space_findings
from vgrd.calibration.hand_eye.pose_pairs import HandEyeProblem, calibrate_hand_eye
from vgrd.calibration.hand_eye.state import flange_motion_of
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose, exp_rotation, hat, log_rotation
from vgrd.model import Mount

MOUNTS = list(Mount)


def random_pose(rng, mm, turn=np.pi):
    axis = rng.normal(size=3)
    axis *= rng.uniform(0, turn) / np.linalg.norm(axis)
    return Pose.from_rotvec(axis, rng.normal(size=3) * mm)


class Problem:
    """Random camera, target and wrists; the noise is `size` times 0.2 mm and 1 mrad per axis."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.mount = MOUNTS[seed % 2]
        self.sigma_mm, self.sigma_rad = np.array((0.2, 1e-3)) * (0.1, 1, 10, 40)[seed % 4]
        self.X, self.Y = random_pose(rng, 500), random_pose(rng, 200)
        n, turn = (3, 4, 6, 10)[seed // 4 % 4], (0.3, 1.2, np.pi)[seed % 3]
        self.moves = [
            flange_motion_of(self.mount, random_pose(rng, 200, turn).inverse()) for _ in range(n)
        ]
        sigma = np.repeat((self.sigma_mm, self.sigma_rad), 3)
        self.cameras = [
            _shaken(self.X.inverse() @ move @ self.Y, rng.normal(size=6) * sigma)
            for move in self.moves
        ]

    @property
    def sigmas(self):
        return {"sigma_mm": self.sigma_mm, "sigma_rad": self.sigma_rad}

    def start(self):
        return certified_start(self.moves, self.cameras, **self.sigmas)

    def cost(self):
        return rotation_cost(self.moves, self.cameras, **self.sigmas)


def _shaken(pose, noise):
    return Pose(exp_rotation(noise[3:]) @ pose.rotation, pose.translation + noise[:3])


def test_every_one_of_100_random_problems_is_certified():
    gaps = [Problem(seed).start().certificate for seed in range(100)]
    assert all(certificate.tight for certificate in gaps)
    assert max(certificate.gap for certificate in gaps) < 1e-6


def test_the_certified_start_finds_the_best_minimum_where_descent_from_identity_fails():
    failed = 0
    rng = np.random.default_rng(0)
    for seed in range(100):
        problem = Problem(seed)
        best, cost = problem.start().cost, problem.cost()
        others = [cost(cost.descend(exp_rotation(rng.normal(size=3) * 2))) for _ in range(2)]
        from_identity = cost(cost.descend(np.eye(3)))
        assert best <= min([from_identity, *others]) * (1 + 1e-9)
        failed += from_identity > 1.01 * best
    assert failed >= 2


@pytest.mark.parametrize("seed", range(8))
def test_the_cost_of_a_rotation_is_the_sum_of_squares_it_stands_for(seed):
    problem = Problem(seed)
    rng = np.random.default_rng(seed)
    R = exp_rotation(rng.normal(size=3))
    X, _ = problem.cost().poses(R)
    through = [(m.inverse() @ X @ c) for m, c in zip(problem.moves, problem.cameras, strict=True)]
    turns = np.array([pose.rotation for pose in through])
    places = np.array([pose.translation for pose in through])
    expected = np.sum((turns - turns.mean(axis=0)) ** 2) / (2 * problem.sigma_rad**2)
    expected += np.sum((places - places.mean(axis=0)) ** 2) / problem.sigma_mm**2
    assert problem.cost()(R) == pytest.approx(expected, rel=1e-9)


def test_the_order_of_the_samples_does_not_matter_to_the_start():
    problem = Problem(6)
    order = np.random.default_rng(1).permutation(len(problem.moves))
    first = problem.start()
    again = certified_start(
        [problem.moves[i] for i in order], [problem.cameras[i] for i in order], **problem.sigmas
    )
    np.testing.assert_allclose(first.X.rotation, again.X.rotation, atol=1e-9)
    np.testing.assert_allclose(first.X.translation, again.X.translation, rtol=1e-9)


def test_perfect_data_give_the_truth_and_a_tight_certificate():
    for seed in range(20):
        problem = Problem(seed)
        exact = [problem.X.inverse() @ move @ problem.Y for move in problem.moves]
        start = certified_start(problem.moves, exact, sigma_mm=0.1, sigma_rad=1e-3)
        assert start.X.distance(problem.X) == pytest.approx((0, 0), abs=1e-6)
        assert start.Y.distance(problem.Y) == pytest.approx((0, 0), abs=1e-6)
        assert start.certificate.tight


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_default_says_that_its_start_was_the_best_of_all(mount):
    rng = np.random.default_rng(5)
    problem, X, _ = partial_problem(
        mount, [random_pose(rng, 100, 1.0) for _ in range(7)], sigma=1.0
    )
    result = calibrate_hand_eye(problem)
    assert result.certificate.tight
    assert result.mount_from_camera.distance(X)[0] < 1
    again = HandEyeProblem(mount, problem.samples, 1e-6, 1e-9, start=result)
    assert calibrate_hand_eye(again).certificate is None


# 4-axis arms and portals

COARSE = np.array((0.01, 0.01, 0.06, np.radians(0.03), np.radians(0.03), np.radians(0.01)))
AXIS = {Mount.EYE_TO_HAND: (700, 100, 800), Mount.EYE_IN_HAND: (30, -60, 90)}


def four_axis(n, seed, yaw=1.5, shift=100.0):
    rng = np.random.default_rng(seed)
    tool_down = Pose.from_rotvec((np.pi, 0, 0), (400, 0, 300))
    out = []
    for _ in range(n):
        place = rng.uniform(-1, 1, 3) * shift
        turned = Pose.from_rotvec((0, 0, rng.uniform(-yaw, yaw)))
        out.append(
            Pose(turned.rotation @ tool_down.rotation, tool_down.translation + place)
            if shift
            else turned @ tool_down
        )
    return out


def partial_problem(mount, wrists, seed=0, sigma=0.0):
    rng = np.random.default_rng(seed + 500)
    X = Pose.from_rotvec((2.1, -1.6, 0.2), AXIS[mount])
    Y = Pose.from_rotvec((0.3, -0.2, 0.9), (35, -20, 55))
    noise = np.diag(COARSE**2)
    samples = []
    for i, wrist in enumerate(wrists):
        seen = X.inverse() @ flange_motion_of(mount, wrist) @ Y
        shaken = _shaken(seen, rng.normal(size=6) * COARSE * sigma)
        about = np.eye(6)
        about[:3, 3:] = -hat(seen.translation)
        inverse = np.linalg.inv(about)
        samples.append(PoseSample(str(i), wrist, shaken, inverse @ noise @ inverse.T))
    return HandEyeProblem(mount, samples, 1e-6, 1e-9), X, Y


def calibrate_partly(problem):
    """All that the motion determines, whatever stays open."""
    return calibrate_hand_eye(replace(problem, allow_unobservable=3))


def codes_of(result, mount):
    return [finding.code for finding in null_space_findings(mount, result.null_space)]


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("seed", range(4))
def test_a_4_axis_robot_leaves_only_the_height_open_and_says_so(mount, seed):
    problem, X, Y = partial_problem(mount, four_axis(6, seed))
    found = calibrate_partly(problem)
    assert codes_of(found, mount) == ["height_free"]
    assert found.null_space.shape == (1, 6)
    axis = found.null_space[0, 3:] * np.sqrt(2)
    np.testing.assert_allclose(np.abs(axis), (0, 0, 1), atol=1e-9)
    assert found.mount_from_target.translation @ axis == pytest.approx(0, abs=1e-9)
    shift = found.null_space[0] * np.sqrt(2) * float(Y.translation @ axis)
    both = [
        Pose(pose.rotation, pose.translation + part)
        for pose, part in zip(
            (found.mount_from_camera, found.mount_from_target), (shift[:3], shift[3:]), strict=True
        )
    ]
    for one, truth in zip(both, (X, Y), strict=True):
        assert one.distance(truth) == pytest.approx((0, 0), abs=1e-6)
    assert found.certificate.tight


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_4_axis_robot_predicts_pictures_at_any_yaw_without_the_height(mount):
    problem, X, Y = partial_problem(mount, four_axis(8, 3), sigma=1.0)
    found = calibrate_partly(problem)
    for wrist in four_axis(10, 99):
        expected = X.inverse() @ flange_motion_of(mount, wrist) @ Y
        mm, rad = found.predict(wrist).distance(expected)
        assert mm < 0.3
        assert rad < 1e-3


@pytest.mark.parametrize("mount", MOUNTS)
def test_six_moves_of_a_4_axis_robot_give_the_rotation_to_hundredths_of_a_degree(mount):
    off = []
    for seed in range(25):
        problem, X, _ = partial_problem(mount, four_axis(7, seed), seed, sigma=1.0)
        found = calibrate_partly(problem)
        off.append(log_rotation(found.mount_from_camera.rotation @ X.rotation.T))
    assert np.degrees(np.sqrt(np.mean(np.sum(np.square(off), axis=1)))) < 0.013


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_covariance_of_a_4_axis_robot_is_as_large_as_the_scatter(mount):
    nees = []
    for seed in range(40):
        problem, X, Y = partial_problem(mount, four_axis(7, seed), seed, sigma=1.0)
        found = calibrate_partly(problem)
        shift = 2 * (Y.translation @ found.null_space[0, 3:]) * found.null_space[0]
        truth = (
            Pose(X.rotation, X.translation - shift[:3]),
            Pose(Y.rotation, Y.translation - shift[3:]),
        )
        both = found.mount_from_camera, found.mount_from_target
        xi = np.concatenate([(a @ b.inverse()).log() for a, b in zip(both, truth, strict=True)])
        C = found.covariance / max(1, found.noise_scale**2)
        e, V = np.linalg.eigh(C)
        nees.append(np.sum((V.T @ xi)[1:] ** 2 / e[1:]))
    assert np.mean(nees) == pytest.approx(11, rel=0.2)


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_portal_without_any_rotation_gives_the_cameras_rotation_and_names_the_rest(mount):
    problem, X, Y = partial_problem(mount, four_axis(5, 1, yaw=0.0))
    found = calibrate_partly(problem)
    assert found.null_space.shape == (3, 6)
    assert codes_of(found, mount) == ["position_free"]
    assert found.mount_from_camera.distance(X)[1] < 1e-9
    assert found.mount_from_target.distance(Y)[1] < 1e-9
    np.testing.assert_allclose(found.mount_from_target.translation, 0, atol=1e-9)


@pytest.mark.parametrize("mount", MOUNTS)
def test_wrists_that_turn_about_many_axes_leave_nothing_open(mount):
    rng = np.random.default_rng(2)
    problem, X, Y = partial_problem(mount, [random_pose(rng, 100, 1.0) for _ in range(6)])
    found = calibrate_partly(problem)
    assert codes_of(found, mount) == []
    assert found.null_space.shape == (0, 6)
    assert found.mount_from_camera.distance(X) == pytest.approx((0, 0), abs=1e-6)
    assert found.mount_from_target.distance(Y) == pytest.approx((0, 0), abs=1e-6)


@pytest.mark.ordered("the first and the second of a pair are told by name")
@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("wrists", "error", "words"),
    [
        (four_axis(2, 0), TooFewObservations, "at least 3"),
        ([four_axis(1, 0)[0]] * 4, NotObservable, "all 4 robot poses are equal"),
        (four_axis(6, 0, shift=0.0), NotObservable, "without moving across it"),
        (
            [Pose(np.eye(3), np.array((10.0, 5, 2)) * i) for i in range(5)],
            NotObservable,
            "two directions that are not in line",
        ),
        (four_axis(3, 0) * 2, InputError, "'0' and '3'"),
    ],
)
def test_motion_that_leaves_the_rotation_open_is_refused_by_its_remedy(
    mount, wrists, error, words
):
    with pytest.raises(error, match=words):
        calibrate_partly(partial_problem(mount, wrists)[0])
