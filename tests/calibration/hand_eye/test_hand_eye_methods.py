import cv2
import numpy as np
import pytest

from vgrd.calibration.hand_eye.published import METHODS, PosePair
from vgrd.calibration.hand_eye.published.motions import Motions
from vgrd.calibration.hand_eye.published.robot_world import li, shah
from vgrd.calibration.hand_eye.published.separable import horaud_dornaika, park_martin, tsai_lenz
from vgrd.calibration.hand_eye.published.simultaneous import andreff, daniilidis
from vgrd.calibration.hand_eye.state import flange_motion_of
from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.geometry.covariance import covariance_from
from vgrd.model import Mount

MOUNTS = list(Mount)
NAMES = list(METHODS)
SIGMA = np.array([0.2] * 3 + [1e-3] * 3)
# Root mean square error over the Cramer-Rao bound (mm, rad) of 40 sessions, rounded up: these
# methods weigh all pairs alike and know nothing of the noise.
WITHIN = {
    "tsai-lenz": (2.3, 2.5),
    "park-martin": (1.9, 2.2),
    "horaud-dornaika": (1.9, 2.2),
    "daniilidis": (2.1, 2.1),
    "andreff": (2.2, 1.7),
    "lu-chou": (1.7, 2.1),
    "wu": (2.4, 2.2),
    "gwak": (1.6, 1.7),
    "shah": (2.3, 2.2),
    "li": (3.6, 2.2),
}


def random_pose(rng, mm, turn=np.pi):
    axis = rng.normal(size=3)
    return Pose.from_rotvec(
        axis / np.linalg.norm(axis) * rng.uniform(0, turn), rng.normal(size=3) * mm
    )


class Cell:
    """A camera and a target somewhere; `pairs` are what robot and camera would report."""

    def __init__(self, mount, seed=0, X=None):
        self.mount = mount
        self.rng = np.random.default_rng(seed)
        self.X = X or random_pose(self.rng, 300, 2.6)
        self.Y = random_pose(self.rng, 100)

    def pairs(self, n=8, *, turn=1.2, sigma=0.0, poses=None):
        poses = poses or [random_pose(self.rng, 150, turn) for _ in range(n)]
        return [PosePair(wrist, self.seen(wrist, sigma)) for wrist in poses]

    def seen(self, wrist, sigma=0.0):
        move = wrist if self.mount is Mount.EYE_TO_HAND else wrist.inverse()
        noise = self.rng.normal(size=6) * sigma * SIGMA
        return Pose.exp(noise) @ self.X.inverse() @ move @ self.Y


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("name", NAMES)
def test_perfect_pairs_give_the_truth(name, mount):
    for seed in range(8):
        cell = Cell(mount, seed)
        found = METHODS[name].solve(cell.pairs(3 + seed), mount)
        assert found.mount_from_camera.distance(cell.X) == pytest.approx((0, 0), abs=1e-6)
        assert found.mount_from_target.distance(cell.Y) == pytest.approx((0, 0), abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_a_camera_turned_by_exactly_half_a_turn_is_no_special_case(name, axis):
    cell = Cell(Mount.EYE_TO_HAND, 3, Pose.from_rotvec(np.multiply(np.pi, axis), (400, 50, 900)))
    found = METHODS[name].solve(cell.pairs(), cell.mount)
    assert found.mount_from_camera.distance(cell.X) == pytest.approx((0, 0), abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_wrists_over_all_orientations_half_turns_between_them_included(name):
    cell = Cell(Mount.EYE_IN_HAND, 4)
    wrists = [random_pose(cell.rng, 150) for _ in range(9)]
    wrists.append(wrists[0] @ Pose.from_rotvec((np.pi, 0, 0), (10, 20, 30)))
    found = METHODS[name].solve(cell.pairs(poses=wrists, sigma=0.1), cell.mount)
    mm, rad = found.mount_from_camera.distance(cell.X)
    assert mm < 1
    assert rad < 1e-3


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("name", NAMES)
def test_noise_costs_no_more_than_a_small_factor_of_the_cramer_rao_bound(name, mount):
    squares, bound = [], []
    for seed in range(40):
        cell = Cell(mount, seed)
        pairs = cell.pairs(10, sigma=1.0)
        off = (METHODS[name].solve(pairs, mount).mount_from_camera @ cell.X.inverse()).log() ** 2
        squares.append((off[:3].sum(), off[3:].sum()))
        bound.append(_bound(cell, pairs))
    ratio = np.sqrt(np.mean(squares, axis=0) / np.mean(bound, axis=0))
    assert (ratio < WITHIN[name]).all(), ratio
    assert (ratio > 0.8).all(), ratio


def _bound(cell, pairs):
    """Cramer-Rao bound of the variances of X (mm^2, rad^2)."""
    back = cell.X.inverse()
    moves = [flange_motion_of(cell.mount, pair.base_from_wrist) for pair in pairs]
    rows = [
        np.hstack([-back.adjoint(), (back @ move).adjoint()]) / SIGMA[:, None] for move in moves
    ]
    variances = np.diag(covariance_from(np.vstack(rows)))
    return variances[:3].sum(), variances[3:6].sum()


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_the_samples_does_not_matter(name, mount):
    cell = Cell(mount, 7)
    pairs = cell.pairs(9, sigma=1.0)
    found = METHODS[name].solve(pairs, mount)
    for _ in range(3):
        again = METHODS[name].solve([pairs[i] for i in cell.rng.permutation(9)], mount)
        for one, other in (
            (found.mount_from_camera, again.mount_from_camera),
            (found.mount_from_target, again.mount_from_target),
        ):
            np.testing.assert_allclose(one.rotation, other.rotation, rtol=0, atol=1e-9)
            size = np.linalg.norm(one.translation)
            np.testing.assert_allclose(
                one.translation, other.translation, rtol=0, atol=1e-9 * size
            )


@pytest.mark.parametrize("name", NAMES)
def test_metres_and_millimetres_give_the_same(name):
    cell = Cell(Mount.EYE_TO_HAND, 8)
    pairs = cell.pairs(sigma=1.0)
    large = [
        PosePair(*(Pose(p.rotation, 1000 * p.translation) for p in _both(pair))) for pair in pairs
    ]
    small = METHODS[name].solve(pairs, cell.mount).mount_from_camera
    big = METHODS[name].solve(large, cell.mount).mount_from_camera
    np.testing.assert_allclose(big.translation / 1000, small.translation, atol=1e-6)
    np.testing.assert_allclose(big.rotation, small.rotation, atol=1e-9)


def _both(pair):
    return pair.base_from_wrist, pair.camera_from_target


def opencv_motions(pairs):
    """The motions that OpenCV makes of an eye-in-hand recording, each pair one way, and its scale."""
    A, B = [], []
    for i, one in enumerate(pairs):
        for other in pairs[i + 1 :]:
            A.append(other.base_from_wrist.inverse() @ one.base_from_wrist)
            B.append(other.camera_from_target @ one.camera_from_target.inverse())
    return Motions.absolute(A, B)


def far_apart(seed):
    """Seven poses all turned by 0.35 to 2.8 rad from each other: OpenCV leaves small turns out."""
    rng = np.random.default_rng(seed)
    poses = []
    while len(poses) < 7:
        one = random_pose(rng, 150, 1.3)
        if all(0.35 < one.distance(other)[1] < 2.8 for other in poses):
            poses.append(one)
    return poses


@pytest.mark.parametrize(
    ("method", "flag"),
    [
        (tsai_lenz, cv2.CALIB_HAND_EYE_TSAI),
        (park_martin, cv2.CALIB_HAND_EYE_PARK),
        (horaud_dornaika, cv2.CALIB_HAND_EYE_HORAUD),
        (andreff, cv2.CALIB_HAND_EYE_ANDREFF),
        (daniilidis, cv2.CALIB_HAND_EYE_DANIILIDIS),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_noisy_motions_give_what_opencv_makes_of_them(method, flag, seed):
    pairs = Cell(Mount.EYE_IN_HAND, seed).pairs(poses=far_apart(seed), sigma=1.0)
    motions = opencv_motions(pairs)
    size = motions.scaled()[1]
    R, t = cv2.calibrateHandEye(
        [p.base_from_wrist.rotation for p in pairs],
        [p.base_from_wrist.translation / size for p in pairs],
        [p.camera_from_target.rotation for p in pairs],
        [p.camera_from_target.translation / size for p in pairs],
        method=flag,
    )
    found = method(motions)
    np.testing.assert_allclose(found.rotation, R, atol=1e-7)
    np.testing.assert_allclose(found.translation, t[:, 0] * size, atol=1e-4)


@pytest.mark.parametrize(
    ("method", "flag"),
    [(shah, cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH), (li, cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI)],
)
@pytest.mark.parametrize("seed", range(3))
def test_noisy_poses_give_what_opencv_makes_of_them_as_robot_world(method, flag, seed):
    pairs = Cell(Mount.EYE_IN_HAND, seed).pairs(10, turn=0.8, sigma=1.0)
    cameras = [p.camera_from_target for p in pairs]
    moves = [p.base_from_wrist.inverse() for p in pairs]
    poses = Motions.absolute(cameras, moves)
    size = poses.scaled()[1]
    R_X, t_X, R_Z, t_Z = cv2.calibrateRobotWorldHandEye(
        [c.rotation for c in cameras],
        [c.translation / size for c in cameras],
        [m.rotation for m in moves],
        [m.translation / size for m in moves],
        method=flag,
    )
    for found, R, t in zip(method(poses), (R_X, R_Z), (t_X, t_Z), strict=True):
        np.testing.assert_allclose(found.rotation, R, atol=1e-7)
        np.testing.assert_allclose(found.translation, t[:, 0] * size, atol=1e-4)


def turning_about_one_axis():
    return [Pose.from_rotvec((0, 0, 0.3 * i), (20 * i, 9 * i * i, -5 * i)) for i in range(6)]


def moving_without_turning():
    return [Pose.from_rotvec((0, 0, 0), (20 * i, 9 * i * i, -5 * i)) for i in range(6)]


def turning_by_halves():
    return [
        Pose.from_rotvec(np.multiply(np.pi, axis), np.multiply(50, axis))
        for axis in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    ]


@pytest.mark.ordered("the first and the second of a pair are told by name")
@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("poses", "error", "words"),
    [
        (turning_about_one_axis()[:2], TooFewObservations, "at least 3"),
        ([turning_about_one_axis()[1]] * 5, NotObservable, "all 5 robot poses are equal"),
        (moving_without_turning(), NotObservable, "kept its orientation"),
        (turning_about_one_axis(), NotObservable, "one axis only.*about another axis"),
        (turning_about_one_axis()[:3] * 2, InputError, "'1' and '4'"),
    ],
)
def test_poses_that_leave_something_open_are_refused_with_the_missing_motion(
    name, mount, poses, error, words
):
    with pytest.raises(error, match=words):
        METHODS[name].solve(Cell(mount).pairs(poses=poses), mount)


@pytest.mark.parametrize("name", [n for n in NAMES if METHODS[n].equation == "AX = XB"])
def test_motions_that_are_all_half_turns_are_refused(name):
    with pytest.raises(NotObservable, match="half turns"):
        METHODS[name].solve(
            Cell(Mount.EYE_IN_HAND).pairs(poses=turning_by_halves()), "eye-in-hand"
        )


@pytest.mark.parametrize("name", NAMES)
def test_a_target_whose_pose_is_not_read_again_is_named(name):
    pairs = Cell(Mount.EYE_IN_HAND).pairs()
    stuck = [PosePair(p.base_from_wrist, pairs[0].camera_from_target) for p in pairs]
    with pytest.raises(NotObservable, match="target kept its orientation in the pictures"):
        METHODS[name].solve(stuck, Mount.EYE_IN_HAND)
