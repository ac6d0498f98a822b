import gc
import time

import cv2
import numpy as np
import pytest

from fakes.camera.patterns import tag_cells, tag_pattern
from fakes.camera.pictures import Look, Placed, draw, pinhole
from fakes.camera.render import Renderer
from fakes.world.layout import Layout
from fakes.world.poses import frozen_snapshot, look_poses, retracted_pose, touch_pose
from fakes.world.world import WorldSnapshot
from vgrd.devices import Region, full_scale
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.vision.print.codes import square_corners
from vgrd.vision.tags.planar_pose import planar_poses
from vgrd.vision.tags.tag_finder import TagDetector

LAYOUT = Layout()
OPTICS = LAYOUT.optics


def make(tags=(LAYOUT.tag_a, LAYOUT.tag_b), size=OPTICS.size_px):
    return TagDetector(OPTICS.matrix, OPTICS.distortion, tags, size)


@pytest.fixture(scope="module")
def detector():
    with make() as ours:
        yield ours


@pytest.fixture(scope="module")
def shots():
    """Poses of every kind with their pictures: (snapshot, pixels)."""
    renderer = Renderer(LAYOUT)
    standing = [(pose, 0.0) for pose in look_poses(LAYOUT, 6)]
    touching = [(touch_pose(LAYOUT, name), 0.0) for name in ("P1", "P3", "P6")]
    spinning = [(retracted_pose(), angle) for angle in (1.0, 3.0, 5.0)]
    taken = []
    for i, (pose, angle) in enumerate(standing + touching + spinning):
        snapshot = WorldSnapshot(frozen_snapshot(pose).flange, angle, exposure=i)
        taken.append((snapshot, renderer.render(snapshot)))
    return taken


@pytest.fixture(scope="module")
def seen(detector, shots):
    """Observation and true pose of both tags in all shots, and the times of detection."""
    pairs, cold_s, warm_s = [], [], []
    for snapshot, pixels in shots:
        started = time.perf_counter()
        found = detector.detect(pixels)
        cold_s.append(time.perf_counter() - started)
        started = time.perf_counter()
        again = detector.detect(pixels, found)
        warm_s.append(time.perf_counter() - started)
        assert sorted(found) == sorted(again) == [0, 1]
        for tag_id, name in ((0, "a"), (1, "b")):
            truth = LAYOUT.base_from_camera.inverse() @ snapshot.base_from_tag(name, LAYOUT)
            pairs.append((again[tag_id], truth))
    print(f"cold {np.median(cold_s) * 1e3:.0f} ms, warm {np.median(warm_s) * 1e3:.0f} ms")  # noqa: T201
    return pairs


def test_positions_and_rotations_are_as_accurate_as_promised(seen):
    shifts = np.array([o.camera_from_tag.translation - t.translation for o, t in seen])
    turns = np.degrees([o.camera_from_tag.distance(t)[1] for o, t in seen])
    assert np.sqrt(np.mean(shifts[:, :2] ** 2)) < 0.001
    assert np.sqrt(np.mean(shifts[:, 2] ** 2)) < 0.008
    assert np.sqrt(np.mean(turns**2)) < 0.004


def test_covariances_match_the_scatter(seen):
    errors = [(o.camera_from_tag @ t.inverse()).log() for o, t in seen]
    squares = [
        e @ np.linalg.solve(o.covariance, e) / 6 for e, (o, _) in zip(errors, seen, strict=True)
    ]
    assert 0.6 < np.mean(squares) < 1.5


def test_the_covariance_of_a_pose_is_that_of_its_corners_through_a_left_perturbation(seen):
    observation, _ = seen[0]
    camera = CameraModel(OPTICS.matrix, OPTICS.distortion, OPTICS.size_px)
    square = square_corners(observation.tag.size_mm)
    root = np.random.default_rng(0).normal(size=(8, 8)) * 1e-3
    corner_covariance = root @ root.T + 1e-6 * np.eye(8)
    corners = OPTICS.project(observation.camera_from_tag @ square)
    best = planar_poses(camera, square, corners, corner_covariance)[0]
    pose, step = best.pose, 1e-6
    assert pose.distance(observation.camera_from_tag)[1] < 1e-6
    J = np.column_stack(
        [
            (
                OPTICS.project((Pose.exp(step * axis) @ pose) @ square)
                - OPTICS.project((Pose.exp(-step * axis) @ pose) @ square)
            ).ravel()
            / (2 * step)
            for axis in np.eye(6)
        ]
    )
    information = J.T @ np.linalg.solve(corner_covariance, J)
    scale = 1 / np.sqrt(np.diag(information))
    found = np.linalg.inv(best.covariance)
    assert np.allclose(
        found * np.outer(scale, scale), information * np.outer(scale, scale), atol=1e-4
    )


def test_corners_come_in_the_models_order_in_opencvs_convention(seen):
    for observation, truth in seen:
        half = observation.tag.size_mm / 2
        square = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
        error = observation.corners_px - OPTICS.project(truth @ square)
        assert np.abs(error).max() < 0.012


def test_a_covered_tag_is_not_detected_and_found_again_afterwards(detector, shots):
    renderer = Renderer(LAYOUT)
    snapshot, pixels = shots[-1]
    found = detector.detect(pixels)
    hidden = WorldSnapshot(snapshot.flange, snapshot.table_angle_rad, covered=("b",))
    blind = detector.detect(renderer.render(hidden), found)
    assert sorted(blind) == [0]
    assert sorted(detector.detect(pixels, blind)) == [0, 1]


def test_tracking_falls_back_to_the_whole_picture(detector, shots):
    earlier = detector.detect(shots[0][1])
    assert sorted(detector.detect(shots[-1][1], earlier)) == [0, 1]


def test_an_out_of_focus_tag_is_seen_with_a_larger_covariance(detector):
    pose = look_poses(LAYOUT, 1)[0]
    renderer = Renderer(LAYOUT)
    away = LAYOUT.base_from_camera.rotation[:, 2]
    depth = (LAYOUT.base_from_camera.inverse() @ pose @ LAYOUT.wrist_from_tag_a).translation[2]
    sharp, blurred = (
        detector.detect(
            renderer.render(
                frozen_snapshot(Pose(pose.rotation, pose.translation + away * (wanted - depth)))
            )
        )
        for wanted in (LAYOUT.optics.focus_mm, 415.0)
    )
    assert 0 in sharp
    assert 0 not in blurred or blurred[0].rms_px > sharp[0].rms_px


def test_sixteen_bit_pictures_give_the_same_poses(detector, shots):
    pixels = shots[0][1]
    eight = detector.detect(pixels)
    sixteen = detector.detect(full_scale(pixels.astype(np.uint16) * 16, 12))
    for tag_id, observation in eight.items():
        mm, rad = observation.camera_from_tag.distance(sixteen[tag_id].camera_from_tag)
        assert mm < 0.03
        assert rad < 5e-4


def small_picture(*tags, size=(800, 600), edge_px=120):
    """Flat tags side by side on white, without noise."""
    picture = np.full(size[::-1], 200, np.uint8)
    for i, tag in enumerate(tags):
        cells = (tag_cells(tag.family, tag.id) * 180 + 20).astype(np.uint8)
        marker = cv2.resize(cells, (edge_px, edge_px), interpolation=cv2.INTER_NEAREST)
        x = 80 + i * 250
        picture[100 : 100 + edge_px, x : x + edge_px] = marker
    return picture


def small_detector(*tags):
    matrix = np.array([[1000.0, 0, 400], [0, 1000.0, 300], [0, 0, 1]])
    return TagDetector(matrix, np.zeros(0), tags, (800, 600))


def test_a_tag_that_appears_twice_is_ambiguous():
    tag, other = TagSpec("36h11", 5, 20.0), TagSpec("36h11", 6, 20.0)
    with small_detector(tag, other) as detector:
        assert sorted(detector.detect(tilted(small_picture(tag, other)))) == [5, 6]
        assert sorted(detector.detect(tilted(small_picture(tag, other, tag)))) == [6]


def test_tags_of_another_id_are_ignored():
    tag, other = TagSpec("36h11", 5, 20.0), TagSpec("36h11", 6, 20.0)
    with small_detector(tag) as detector:
        assert detector.detect(tilted(small_picture(other))) == {}


def test_a_damaged_code_is_rejected():
    tag = TagSpec("36h11", 5, 20.0)
    picture = small_picture(tag)
    cell = picture[100 + 30 : 100 + 45, 80 + 30 : 80 + 45]
    cell[:] = 220 - cell
    with small_detector(tag) as detector:
        assert detector.detect(tilted(picture)) == {}


def test_a_tag_that_does_not_fit_a_pose_is_rejected():
    tag = TagSpec("36h11", 5, 20.0)
    picture = tilted(small_picture(tag))
    stretched = cv2.resize(picture, (800, 450))
    squeezed = np.full_like(picture, 200)
    squeezed[:450] = stretched
    with small_detector(tag) as detector:
        assert detector.detect(squeezed) == {}


def test_two_poses_that_fit_equally_well_are_not_reported_as_one():
    tag = TagSpec("36h11", 5, 4.0)
    far = small_picture(tag, edge_px=48)
    for seed in range(5):
        noisy = far + np.random.default_rng(seed).normal(0, 6, far.shape)
        with small_detector(tag) as detector:
            for observation in detector.detect(np.clip(noisy, 0, 255).astype(np.uint8)).values():
                assert observation.camera_from_tag.rotation[2, 2] > np.cos(np.radians(5))


def test_a_picture_of_another_size_names_both_sizes(detector):
    with pytest.raises(InputError, match=r"100 x 90 px.*4024 x 3036"):
        detector.detect(np.zeros((90, 100), np.uint8))


def test_an_unknown_family_and_an_id_used_twice_are_refused():
    with pytest.raises(InputError, match="known: 16h5"):
        make([TagSpec("99h9", 0, 25.0)])
    with pytest.raises(InputError, match="id of its own"):
        make([TagSpec("36h11", 0, 25.0), TagSpec("36h11", 0, 10.0)])


def test_a_closed_detector_says_so():
    detector = small_detector(TagSpec("36h11", 5, 20.0))
    detector.close()
    detector.close()
    gc.collect()
    with pytest.raises(InputError, match="closed"):
        detector.detect(np.zeros((600, 800), np.uint8))


def tilted(picture):
    """The picture of a plane that leans by 30 deg, taken by `small_detector`'s camera."""
    matrix = np.array([[1000.0, 0, 400], [0, 1000.0, 300], [0, 0, 1]])
    lean = Pose.from_rotvec((0.5, 0.15, 0.1)).rotation
    at_depth = np.column_stack([lean[:, 0], lean[:, 1], (0.0, 0.0, 1.2)])
    homography = matrix @ at_depth @ np.linalg.inv(matrix)
    return cv2.warpPerspective(picture, homography, (800, 600), borderValue=200)


def test_a_tag_that_moved_a_little_is_never_taken_for_where_it_was():
    rng = np.random.default_rng(9)
    spec, size = TagSpec("36h11", 5, 20.0), (700, 700)
    matrix = np.array([[2500.0, 0, 350], [0, 2500.0, 350], [0, 0, 1]])
    camera = pinhole(matrix, np.zeros(5), size)

    def picture(pose):
        placed = Placed(tag_pattern(spec), pose)
        return draw(camera, [placed], Look(), seed=rng, margin_px=30).in_frame(size)

    with TagDetector(matrix, np.zeros(5), [spec], size) as detector:
        for _ in range(60):
            tilt = rng.uniform(-0.5, 0.5, 3)
            before = Pose.from_rotvec(tilt, (rng.uniform(-15, 15), rng.uniform(-15, 15), 400.0))
            known = detector.detect(picture(before))
            step = (*rng.uniform(-4, 4, 2), 0.0)
            moved = Pose.from_rotvec((0.0, 0.0, rng.uniform(-0.3, 0.3)), step) @ before
            sight = detector.examine(picture(moved), known)[spec.id]
            assert sight.observation is not None, sight.findings
            mm, rad = sight.observation.camera_from_tag.distance(moved)
            assert mm < 0.2
            assert rad < 0.01


def test_a_region_gives_the_same_tags_in_coordinates_of_the_whole_picture(detector, shots):
    """Followed or searched for, and what an earlier region held does not shine through."""
    for _, pixels in shots:
        whole = detector.detect(pixels)
        for seen in whole.values():
            region = around(seen.corners_px, pixels.shape[::-1])
            part = pixels[region.y : region.y + region.height, region.x : region.x + region.width]
            for earlier in ({}, whole):
                again = detector.detect(part, earlier, region)[seen.tag.id]
                assert np.abs(again.corners_px - seen.corners_px).max() < 0.02
                assert again.camera_from_tag.distance(seen.camera_from_tag)[0] < 0.02
        elsewhere = Region(0, 0, 400, 300)
        assert detector.detect(np.full((300, 400), 90, np.uint8), whole, elsewhere) == {}


def around(corners_px, size_px):
    low = np.maximum(np.floor(corners_px.min(0)) - 120, 0).astype(int)
    high = np.minimum(np.ceil(corners_px.max(0)) + 120, size_px).astype(int)
    return Region(*low.tolist(), *(high - low).tolist())


def test_a_region_that_the_camera_cannot_send_is_refused(detector):
    for region in (Region(0, 0, 10, 10), Region(-1, 0, 20, 20), Region(4010, 0, 20, 20)):
        with pytest.raises(InputError, match="size_px"):
            detector.detect(np.zeros((20, 20), np.uint8), None, region)
