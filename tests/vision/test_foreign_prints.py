"""Tags as another drawing prints and photographs them: nothing of it is shared with the fit."""

import ast
from pathlib import Path

import cv2
import numpy as np
import pytest

import fakes.camera.foreign
from fakes.camera.foreign.faults import FAULTS
from fakes.camera.foreign.photograph import Conditions, photograph
from fakes.camera.foreign.sheet import Printer, printed
from fakes.studies.prints.single_tags import nees, pose_at
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.print_size import pose_by_size
from vgrd.model import TagSpec
from vgrd.vision.print.codes import square_corners
from vgrd.vision.tags.detection import find_tags
from vgrd.vision.tags.planar_pose import planar_poses
from vgrd.vision.tags.tag_finder import TagDetector

SIZE = (168, 168)
MATRIX = np.array([[2400.0, 0, 83.2], [0, 2400.0, 83.8], [0, 0, 1]])
TAG = TagSpec("apriltag_36h11", 3, 10.0)
DICTIONARY = cv2.aruco.DICT_APRILTAG_36h11


def shot(conditions, pose, seed):
    rng = np.random.default_rng(seed)
    return photograph(DICTIONARY, TAG.id, TAG.size_mm, pose, MATRIX, SIZE, conditions, rng)


def sightings(conditions, tilt, count):
    """Sightings and true poses."""
    with TagDetector(MATRIX, np.zeros(0), [TAG], SIZE) as detector:
        for seed in range(count):
            pose = pose_at(tilt, np.random.default_rng(seed))
            yield detector.examine(shot(conditions, pose, seed))[TAG.id], pose


def test_the_photographs_share_no_code_with_the_fit_nor_with_the_other_drawings():
    for path in Path(fakes.camera.foreign.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module.startswith(("vgrd", "fakes")):
                assert node.module.startswith(("vgrd.geometry", "fakes.camera.foreign"))


def test_ink_widens_the_black_by_its_length_on_either_side():
    def inked(ink_mm):
        light = printed(
            DICTIONARY, 3, 10.0, Printer(ink_mm=ink_mm), np.random.default_rng(0)
        ).reflectance
        across, down = light[light.shape[0] // 6 + 3], light[:, light.shape[1] // 6 + 3]
        share = [np.mean((line - line.min()) / np.ptp(line)) for line in (across, down)]
        return np.array(share) * 15.0  # 12 cells of 1.25 mm

    grown = inked((0.0, 0.0)) - inked((0.02, -0.01))
    np.testing.assert_allclose(grown, (0.04, -0.02), atol=2e-3)


@pytest.mark.parametrize(
    ("fault", "tilt"),
    [
        ("clean", 40),
        ("ink +0.01 mm in x", 20),
        ("ink +0.01 mm", 60),
        ("ragged 0.01 mm, fine", 40),
        ("dots of 0.042 mm", 40),
        ("defocus, disc of 3 px", 20),
        ("defocus, disc of 3 px", 60),
        ("lens with wings", 40),
        ("lens with wings", 60),
        ("JPEG 60", 60),
        ("gamma 1/2.2", 20),
        ("Bayer", 40),
    ],
)
def test_the_covariance_of_a_tag_holds_for_real_prints_and_lenses(fault, tilt):
    squares = [
        nees(sighting.observation, pose, 0.0)
        for sighting, pose in sightings(FAULTS[fault], tilt, 12)
    ]
    # 72 normal numbers: their mean square has a standard deviation of 0.17.
    assert 0.35 < np.mean(squares) / 6 < 1.65


@pytest.mark.parametrize("fault", ["motion of 3 px", "gloss", "lens with wings"])
def test_what_no_covariance_tells_is_named(fault):
    for sighting, _ in sightings(FAULTS[fault], 40, 4):
        assert sighting.findings


def test_light_that_a_lens_throws_far_does_not_move_the_corners():
    for fault in ("lens with wings", "defocus, disc of 3 px"):
        errors = [
            CameraModel(MATRIX, np.zeros(0), SIZE).project(pose @ square_corners(TAG.size_mm))
            - sighting.observation.corners_px
            for sighting, pose in sightings(FAULTS[fault], 60, 6)
        ]
        assert np.sqrt(np.mean(np.square(errors))) < 0.008  # a Gaussian alone: 0.015 and more


def test_ink_is_told_from_blur_and_gamma_in_each_direction():
    conditions = Conditions(printer=Printer(ink_mm=(0.01, -0.005)))
    for sighting, _ in sightings(conditions, 40, 3):
        x, y = sighting.refined.fit.ink_mm
        assert x - y == pytest.approx(0.015, abs=0.002)


def test_the_covariance_of_a_clean_print_is_that_of_its_noise():
    """Scattered sides are found only where they are: pixels of a clean print tell of none."""
    clean, ragged = (
        np.median([np.trace(s.refined.covariance) for s, _ in sightings(FAULTS[fault], 40, 8)])
        for fault in ("clean", "ragged 0.01 mm, fine")
    )
    assert ragged > 9 * clean  # three times the sigma


@pytest.mark.parametrize("tilt", [15, 40, 60])
def test_a_print_of_another_size_moves_the_pose_as_is_told(tilt):
    camera = CameraModel(MATRIX, np.zeros(0), SIZE)
    pose, square = pose_at(tilt, np.random.default_rng(tilt)), square_corners(10.0)
    slope = pose_by_size(camera, 10.0, pose)
    for axis, share in ((0, 1e-5), (1, -1e-5)):
        larger = square.copy()
        larger[:, axis] *= 1 + share
        seen = planar_poses(camera, square, camera.project(pose @ larger), 1e-6 * np.eye(8))[0]
        moved = (seen.pose @ pose.inverse()).log()
        np.testing.assert_allclose(moved, share * slope[:, axis], rtol=0.02, atol=1e-7)


def test_a_stretched_print_is_no_misfit_within_its_tolerance():
    camera = CameraModel(MATRIX, np.zeros(0), SIZE)
    pose, square = pose_at(40, np.random.default_rng(1)), square_corners(10.0)
    corners = camera.project(pose @ (square * (1.001, 1.0, 1.0)))
    stated, tolerant = (
        planar_poses(camera, square, corners, 1e-7 * np.eye(8), size)[0] for size in (0.0, 0.001)
    )
    assert stated.inflation > 5
    assert tolerant.inflation == 1.0


def test_a_print_of_another_size_is_judged_by_how_well_its_size_is_known():
    conditions = Conditions(printer=Printer(stretch=(0.005, 0.0)))
    picture = shot(conditions, pose_at(40, np.random.default_rng(1)), 1)
    traces = []
    for sigma_mm in (0.0, 0.05):
        with TagDetector(MATRIX, np.zeros(0), [TAG], SIZE, {TAG.id: sigma_mm}) as detector:
            traces.append(np.trace(detector.detect(picture)[TAG.id].covariance))
    assert traces[0] > 5 * traces[1]


@pytest.mark.parametrize("side_px", [14, 16, 20])
def test_small_tags_are_found_in_a_small_photograph(side_px):
    rng = np.random.default_rng(side_px)
    scene = np.full((600, 800), 150, np.uint8)
    matrix = np.array([[1000.0, 0, 31.5], [0, 1000.0, 31.5], [0, 0, 1]])
    truth = {}
    for k in range(8):
        turn = Pose.from_rotvec([*rng.uniform(-0.3, 0.3, 2), rng.uniform(0, 6.28)], np.zeros(3))
        pose = Pose(turn.rotation, np.array([0, 0, 10 * 1000 / side_px]))
        x, y = 40 + 180 * (k % 4), 90 + 200 * (k // 4)
        tile = photograph(DICTIONARY, k, 10.0, pose, matrix, (64, 64), Conditions(), rng)
        scene[y : y + 64, x : x + 64] = tile
        camera = CameraModel(matrix, np.zeros(0), (64, 64))
        truth[k] = camera.project(pose @ square_corners(10.0)) + np.array([x, y])
    found = {tag.id: tag.corners_px for tag in find_tags(scene, ["apriltag_36h11"])}
    assert set(found) <= set(truth)
    assert len(found) >= 7
    for k, corners in found.items():
        assert np.abs(corners - truth[k]).max() < 1.5
