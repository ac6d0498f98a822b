import os
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pkgutil import walk_packages

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

import vgrd.vision
from fakes.camera.patterns import charuco_pattern, grid_pattern, tag_pattern
from fakes.camera.pictures import Band, Look, Placed, Spot, draw, pinhole
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.orphans import die_with
from vgrd.vision.alignment import edges
from vgrd.vision.alignment.quality import disturbance
from vgrd.vision.alignment.refinement import RefinementMethod, refine
from vgrd.vision.boards.fit import fit_charuco, fit_tag_board
from vgrd.vision.images.homography import apply
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.boards import Charuco
from vgrd.vision.print.codes import square_corners
from vgrd.vision.print.raster import tag_raster
from vgrd.vision.tags.planar_pose import planar_poses
from vgrd.vision.tags.tag_finder import TagDetector

MATRIX = np.array([[12766.0, 0, 2014.8], [0, 12766.0, 1511.8], [0, 0, 1]])
CAMERA = pinhole(MATRIX, np.array([-0.08, 0.10, 2e-4, -1e-4]), (4024, 3036))
TAG = TagSpec("36h11", 7, 10.0)


def tilted_pose(degrees, seed):
    rng = np.random.default_rng(seed)
    azimuth, turn = rng.uniform(0, 2 * np.pi, 2)
    axis = np.radians(degrees) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    spin = Pose.from_rotvec((0, 0, turn))
    return Pose(
        (Pose.from_rotvec(axis) @ spin).rotation, np.array([*rng.uniform(-40, 40, 2), 600.0])
    )


def shot(pose, look=None, seed=0, figure=None):
    """Picture, the camera that sees only it."""
    picture = draw(CAMERA, [Placed(figure or tag_pattern(TAG), pose)], look, seed=seed)
    region = picture.camera
    return picture.pixels, CameraModel(region.matrix, region.distortion, region.size_px)


def measured(pose, look=None, seed=0, rough_px=1.0):
    """Refined tag from a rough start, and the errors (8,) of its corners."""
    pixels, camera = shot(pose, look, seed)
    true = camera.project(pose.apply(square_corners(TAG.size_mm)))
    rough = true + np.random.default_rng(seed).normal(0, rough_px, (4, 2))
    raster = tag_raster(TAG.family, TAG.id, TAG.size_mm)
    refined = refine(pixels, raster, rough, lens_vector(camera))
    return refined, (refined.corners_px - true).ravel(), camera


@pytest.mark.parametrize("tilt", [0, 30, 60])
def test_corners_are_as_good_as_their_covariance_says_and_to_thousandths(tilt):
    squares, errors = [], []
    for seed in range(6):
        refined, error, _ = measured(tilted_pose(tilt, seed), seed=seed)
        assert refined.method is RefinementMethod.PHOTOMETRIC
        assert 0.9 < refined.fit.chi2 < 1.1
        squares.append(error @ np.linalg.solve(refined.covariance, error))
        errors.append(error)
    assert np.sqrt(np.mean(np.square(errors))) < 0.0035
    assert 4 < np.mean(squares) < 14


def test_noise_blur_and_bloom_are_those_of_the_picture():
    refined, _, _ = measured(tilted_pose(20, 1), Look(psf_px=0.9, ink_mm=0.01))
    assert np.sqrt(np.linalg.eigvalsh(refined.fit.blur)) == pytest.approx(
        np.sqrt(0.9**2 + 1 / 12), abs=0.03
    )
    assert refined.fit.bloom_px == pytest.approx(0.01 / 600 * 12766, abs=0.02)
    level = refined.fit.noise.shot * 200 + refined.fit.noise.read
    assert level == pytest.approx(0.0209 * 200 + 0.33, rel=0.2)


@pytest.mark.parametrize("side_px", [17.0, 24.0, 36.0])
def test_the_noise_of_a_tag_without_flat_pixels_is_what_the_fit_leaves(side_px):
    farther, noisy = 212.8 / side_px, Look(shot=0.1, read=2.0)
    squares, levels = [], []
    for seed in range(12):
        near = tilted_pose(20, seed)
        pose = Pose(near.rotation, farther * near.translation)
        refined, error, _ = measured(pose, noisy, seed, rough_px=0.2)
        levels.append(refined.fit.noise.shot * 150 + refined.fit.noise.read)
        squares.append(error @ np.linalg.solve(refined.covariance, error))
    assert np.mean(levels) == pytest.approx(0.1 * 150 + 4, rel=0.15)
    assert 4 < np.mean(squares) < 12


@pytest.mark.parametrize(
    "look", [Look(ink_mm=0.01), Look(ink_mm=-0.01), Look(gamma=0.45), Look(exposure=1.35)]
)
def test_ink_gamma_and_clipping_do_not_move_the_corners(look):
    errors = [measured(tilted_pose(20, seed), look, seed)[1] for seed in range(3)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.012


@pytest.mark.parametrize(
    ("code", "look"),
    [
        ("motion", Look(motion_px=4.0, motion_rad=0.4)),
        ("shadow", Look(shadow=Band(direction_rad=0.3))),
        ("glare", Look(glare=Spot(levels=120.0, x_px=20.0, y_px=10.0))),
    ],
)
def test_what_disturbs_a_tag_is_named_and_its_corners_stay_within_their_covariance(code, look):
    for seed in range(3):
        refined, error, _ = measured(tilted_pose(25, seed), look, seed)
        assert disturbance(refined)[0] in (code, "shadow" if code == "glare" else code)
        assert np.abs(error).max() < 0.3


def test_a_clean_tag_is_not_said_to_be_disturbed():
    assert all(disturbance(measured(tilted_pose(15, s), seed=s)[0]) is None for s in range(4))


def test_both_poses_are_found_and_the_true_one_is_clearly_better():
    for seed in range(4):
        pose = tilted_pose(8, seed)
        refined, _, camera = measured(pose, seed=seed)
        poses = planar_poses(
            camera, square_corners(TAG.size_mm), refined.corners_px, refined.covariance
        )
        assert len(poses) == 2
        assert poses[0].pose.distance(pose)[1] < np.radians(0.05)
        assert poses[1].cost > poses[0].cost + 25


def test_a_charuco_board_is_measured_as_one_target():
    board = Charuco(5, 5, 4.0, 3.2, "apriltag_36h11")
    pose = tilted_pose(20, 5)
    pixels, camera = shot(pose, figure=charuco_pattern(board))
    fit = fit_charuco(pixels, board, camera)
    mm, rad = fit.poses[0].pose.distance(pose)
    assert fit.refined.method is RefinementMethod.PHOTOMETRIC
    assert mm < 0.006
    assert rad < np.radians(0.003)


def test_a_board_of_four_tags_is_measured_as_one_target():
    tags = [TagSpec("36h11", i, 9.0) for i in range(4)]
    pose = tilted_pose(20, 6)
    pixels, camera = shot(pose, figure=grid_pattern(tags, 2, 2.0))
    centres = {tag: np.array([i % 2, i // 2]) * 11.0 for i, tag in enumerate(tags)}
    fit = fit_tag_board(pixels, centres, 1.0, camera)
    mm, rad = fit.poses[0].pose.distance(pose)
    assert mm < 0.01
    assert rad < np.radians(0.003)


def test_without_a_camera_the_corners_of_a_distant_lens_are_as_good():
    pose = tilted_pose(20, 3)
    flat = pinhole(MATRIX, np.zeros(4), (4024, 3036))
    picture = draw(flat, [Placed(tag_pattern(TAG), pose)], seed=1)
    true = picture.camera.project(pose.apply(square_corners(TAG.size_mm)))
    raster = tag_raster(TAG.family, TAG.id, TAG.size_mm)
    refined = refine(picture.pixels, raster, true + 0.8, lens_vector(None))
    assert np.abs(refined.corners_px - true).max() < 0.008


def test_pictures_that_may_be_written_and_those_that_may_not_share_the_compiled_loops():
    from numba.core.registry import CPUDispatcher

    from vgrd.vision.alignment import edge_response, gathering, normal_equations, photometric
    from vgrd.vision.tags import tag_finder

    tag_finder.warm_up()
    modules = (edges, gathering, normal_equations, photometric, edge_response)
    loops = {loop for m in modules for loop in vars(m).values() if isinstance(loop, CPUDispatcher)}
    before = {loop: len(loop.signatures) for loop in loops}
    assert sum(before.values()) > 3
    drawn = np.kron(tag_raster("36h11", 0, 8.0).cells, np.ones((12, 12)))
    picture = np.pad(drawn * 150 + 50, 20, mode="edge").astype(np.uint8)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) * 96 + 31.5
    for writeable in (True, False):
        picture.setflags(write=writeable)
        assert refine(picture, tag_raster("36h11", 0, 8.0), corners, lens_vector(None)) is not None
    assert {loop: len(loop.signatures) for loop in loops} == before


def loops_compiled_after_warming_up() -> dict[str, int]:
    """How many compiled variants of each loop a detection adds; pictures are and are not writeable."""
    modules = [import_module(m.name) for m in walk_packages(vgrd.vision.__path__, "vgrd.vision.")]
    loops = {v for m in modules for v in vars(m).values() if isinstance(v, CPUDispatcher)}
    spec = TagSpec("36h11", 0, 8.0)
    matrix, size = np.array([[900.0, 0, 200], [0, 900.0, 200], [0, 0, 1]]), (400, 400)
    pose = Pose.from_rotvec((0.3, -0.2, 0.4), (0.0, 0.0, 90.0))
    camera = pinhole(matrix, np.zeros(5), size)
    picture = draw(camera, [Placed(tag_pattern(spec), pose)], Look(), seed=1).in_frame(size)
    with TagDetector(matrix, np.zeros(5), [spec], size) as detector:
        before = {loop: len(loop.signatures) for loop in loops}
        for writeable in (True, False):
            picture.setflags(write=writeable)
            assert detector.detect(picture, detector.detect(picture)).keys() == {0}
    assert sum(before.values()) > 3
    return {loop.__name__: len(loop.signatures) - before[loop] for loop in loops}


def test_no_loop_is_compiled_in_the_first_picture():
    with ProcessPoolExecutor(
        1, get_context("spawn"), initializer=die_with, initargs=(os.getpid(),)
    ) as fresh:
        added = fresh.submit(loops_compiled_after_warming_up).result()
    assert len(added) > 3
    assert {name for name, count in added.items() if count} == set()


def test_a_fit_that_one_long_edge_leads_astray_never_seeks_edges_far_outside(monkeypatch):
    farthest = []

    def watched(picture, raster, frame, q_from_target, *, wide):
        farthest.append(np.abs(apply(q_from_target, raster.corners)).max())
        return edge_offsets(picture, raster, frame, q_from_target, wide=wide)

    edge_offsets = edges.edge_offsets
    monkeypatch.setattr(edges, "edge_offsets", watched)
    rng = np.random.default_rng(2)
    raster = tag_raster("36h11", 0, 8.0)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    for _ in range(400):
        light = np.where(np.arange(480) < rng.integers(50, 400), 140.0, 30.0)
        picture = np.clip(light + rng.normal(0, 2, (480, 480)), 0, 255).astype(np.uint8)
        corners = (
            rng.uniform(100, 380, 2) + square * rng.uniform(15, 90) + rng.normal(0, 6, (4, 2))
        )
        refine(picture, raster, corners, lens_vector(None))
    assert len(farthest) > 400
    assert max(farthest) < 1000
