"""Boards measured as wholes: true poses within their covariance, and what contradicts a board is refused."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.camera.patterns import charuco_pattern, grid_pattern
from fakes.camera.pictures import Band, Look, Placed, draw, pinhole
from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.vision.alignment.refinement import RefinementMethod
from vgrd.vision.boards.fit import fit_board
from vgrd.vision.boards.inspection import inspect_board
from vgrd.vision.images.pictures import Picture
from vgrd.vision.inspection import inspect_picture
from vgrd.vision.print.boards import Charuco
from vgrd.vision.print.targets import TagGrid

SIZE = (1280, 960)
OPTICS = pinhole(
    np.array([[2000.0, 0, 640], [0, 2000, 480], [0, 0, 1]]),
    np.array([-0.08, 0.10, 2e-4, -1e-4]),
    SIZE,
)
CAMERA = CameraModel(OPTICS.matrix, OPTICS.distortion, SIZE)
CHARUCO = Charuco(5, 7, 15.0, 11.0, "5x5_100")
TAGS = TagGrid("36h11", 4, 3, 18.0, 4.5)
BOARDS = pytest.mark.parametrize("board", [CHARUCO, TAGS], ids=["charuco", "tags"])
NOISY = Look(shot=0.1, read=2.0)


def placed(board, pose):
    """The board as it is printed, origin in its outer corner."""
    if isinstance(board, Charuco):
        return Placed(charuco_pattern(board), pose)
    tags = [TagSpec(board.dictionary, tag_id, board.size_mm) for tag_id in board.corners()]
    first_tag = Pose.from_rotvec((0, 0, 0), (board.size_mm / 2, board.size_mm / 2, 0))
    return Placed(grid_pattern(tags, board.columns, board.gap_mm), pose @ first_tag)


def pose_of(board, seed, tilt_deg=25.0, distance_mm=500.0):
    """Tilted and turned by the seed, the board's middle in front of the camera."""
    azimuth, turn = np.random.default_rng(seed).uniform(0, 2 * np.pi, 2)
    tilt = np.radians(tilt_deg) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    R = (Pose.from_rotvec(tilt) @ Pose.from_rotvec((0, 0, turn))).rotation
    middle = (37.5, 52.5, 0) if isinstance(board, Charuco) else (42.75, 31.5, 0)
    return Pose(R, np.array([0, 0, distance_mm]) - R @ np.array(middle))


def picture_of(board, pose, look=None, seed=0):
    return draw(OPTICS, [placed(board, pose)], look, seed=seed).in_frame(SIZE)


def squared_error(report, true):
    """Of the pose by its covariance: 6 on average."""
    xi = (report.pose @ true.inverse()).log()
    return xi @ np.linalg.solve(report.fit.covariance, xi)


def codes(report):
    return [finding.code for finding in report.findings]


@BOARDS
def test_poses_are_true_within_their_covariance(board):
    errors = []
    for seed in range(5):
        pose = pose_of(board, seed)
        report = inspect_board(picture_of(board, pose, NOISY, seed), "b", board, CAMERA)
        assert codes(report) == []
        assert report.fit.refined.method is RefinementMethod.PHOTOMETRIC
        assert report.pose.distance(pose)[0] < 0.02
        errors.append(squared_error(report, pose))
    assert 1.5 < np.mean(errors) < 10


def test_a_misfit_of_the_outline_widens_the_covariance_of_the_pose():
    pose = pose_of(TAGS, 0)
    wrong = CameraModel(OPTICS.matrix, np.array([-0.05, 0.10, 2e-4, -1e-4]), SIZE)
    picture = picture_of(TAGS, pose)
    right, off = (inspect_board(picture, "b", TAGS, camera).fit for camera in (CAMERA, wrong))
    assert off.poses[0].cost > 10 * right.poses[0].cost
    best = off.poses[0]
    expected = best.covariance * best.cost / 2
    np.testing.assert_allclose(best.inflated_covariance, expected, rtol=1e-4)


@BOARDS
def test_a_board_that_is_hidden_in_part_is_measured_and_said_to_be(board):
    pose = pose_of(board, 0)
    picture = picture_of(board, pose, Look(in_front=Band(0.3, from_px=0.0)))
    report = inspect_board(picture, "b", board, CAMERA)
    assert codes(report) == ["partial"]
    assert report.pose.distance(pose)[0] < 0.05
    assert squared_error(report, pose) < 25


@BOARDS
def test_a_shadow_is_not_taken_for_something_that_hides(board):
    shaded = picture_of(board, pose_of(board, 0), Look(shadow=Band(0.3)))
    report = inspect_board(shaded, "b", board, CAMERA)
    assert codes(report) == ["shadow"]
    assert report.pose.distance(pose_of(board, 0))[0] < 0.02


@BOARDS
def test_a_board_that_reaches_out_of_the_picture_is_measured_and_said_to_be(board):
    pose = pose_of(board, 4)
    inner = Pose(pose.rotation, pose.translation + np.array([140.0, 0, 0]))
    report = inspect_board(picture_of(board, inner, NOISY), "b", board, CAMERA)
    assert codes(report) == ["partial"]
    assert report.pose.distance(inner)[0] < 0.1
    assert squared_error(report, inner) < 25


@BOARDS
def test_a_board_of_which_too_little_is_seen_has_no_pose(board):
    picture = picture_of(board, pose_of(board, 1), Look(in_front=Band(0.3, from_px=-160.0)))
    report = inspect_board(picture, "b", board, CAMERA)
    assert codes(report) == ["not_measured"]
    assert report.pose is None
    assert report.to_json().keys() == {"board", "findings"}


@pytest.mark.parametrize(
    ("drawn", "stated", "why"),
    [
        (CHARUCO, replace(CHARUCO, columns=7, rows=5), "no usable charuco board"),
        (CHARUCO, replace(CHARUCO, dictionary="4x4_50"), "0 markers"),
        (CHARUCO, replace(CHARUCO, square_mm=16), r"markers are about \d\.\d% larger"),
        (CHARUCO, replace(CHARUCO, marker_mm=11.5), r"markers are about \d\.\d% smaller"),
        (TAGS, replace(TAGS, first_id=100), "none of the board's tags"),
        (TAGS, replace(TAGS, first_id=1), "not where its file has them"),
        (TAGS, replace(TAGS, columns=3, rows=4), "not where its file has them"),
        (TAGS, replace(TAGS, gap_mm=9.0), "not where its file has them"),
        (TAGS, replace(TAGS, gap_mm=5.1), r"markers are about \d\.\d% larger"),
    ],
)
def test_a_board_file_of_another_board_is_named(drawn, stated, why):
    picture = picture_of(drawn, pose_of(drawn, 0))
    with pytest.raises(TagNotSeen, match=why):
        fit_board(picture, stated, CAMERA)


@pytest.mark.parametrize(
    ("board", "stated"),
    [
        (TAGS, replace(TAGS, gap_mm=4.7)),
        (TAGS, replace(TAGS, size_mm=17.9, gap_mm=4.6)),
        (CHARUCO, replace(CHARUCO, square_mm=15.15)),
    ],
)
def test_sizes_that_contradict_each_other_are_told_and_make_the_pose_uncertain(board, stated):
    pose = pose_of(board, 0)
    report = inspect_board(picture_of(board, pose), "b", stated, CAMERA)
    assert codes(report) == ["sizes"]
    assert "larger" in report.findings[0].message
    assert report.pose.distance(pose)[0] > 0.2
    assert 2 < report.to_json()["origin_sigma_mm"] < 6
    assert squared_error(report, pose) < 10


def test_a_smaller_scale_of_the_whole_board_puts_it_nearer_unseen():
    pose = pose_of(TAGS, 0)
    smaller = replace(TAGS, size_mm=0.9 * TAGS.size_mm, gap_mm=0.9 * TAGS.gap_mm)
    report = inspect_board(picture_of(TAGS, pose), "b", smaller, CAMERA)
    np.testing.assert_allclose(report.pose.translation, 0.9 * pose.translation, atol=0.02)


@BOARDS
def test_a_board_seen_twice_or_in_a_mirror_is_refused(board):
    pose = pose_of(board, 3)
    picture = picture_of(board, pose)
    half = picture[:, 320:960]
    twice = np.hstack([half, half])
    with pytest.raises(TagNotSeen, match="several times"):
        fit_board(twice, board, CAMERA)
    with pytest.raises(TagNotSeen, match="mirror"):
        fit_board(np.ascontiguousarray(picture[:, ::-1]), board, CAMERA)


def test_a_distant_frontal_board_has_two_poses_and_so_none():
    far = TagGrid("36h11", 2, 2, 8.0, 2.0)
    middle = np.array([9.0, 9.0, 0])
    frontal = Pose.from_rotvec((0.02, 0.01, 0), np.array([0, 0, 900.0]) - middle)
    report = inspect_board(picture_of(far, frontal, NOISY), "b", far, CAMERA)
    assert "ambiguous" in codes(report)
    assert report.fit is not None
    assert report.pose is None


def test_tags_on_a_measured_board_are_not_listed_beside_it():
    pose = pose_of(TAGS, 2)
    lone = TagSpec("36h11", 200, 18.0)
    other = Placed(
        grid_pattern([lone], 1, 1.0), pose @ Pose.from_rotvec((0, 0, 0), (-30.0, 20.0, 0))
    )
    pixels = draw(OPTICS, [placed(TAGS, pose), other], seed=1).in_frame(SIZE)
    report = inspect_picture(
        Picture(pixels, is_turned=False), ["36h11"], None, CAMERA, {"b": TAGS}
    )
    assert [sighting.tag.id for sighting in report.tags] == [200]
    assert report.boards[0].pose is not None
    alone = inspect_picture(Picture(pixels, is_turned=False), [], None, CAMERA, {"b": TAGS})
    assert alone.tags == alone.findings == ()
    with pytest.raises(InputError, match="camera"):
        inspect_picture(Picture(pixels, is_turned=False), [], None, None, {"b": TAGS})
