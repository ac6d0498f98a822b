"""Intrinsics of simulated cameras: true within their covariance, and better than the print of the board."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vgrd.errors import InputError, TooFewObservations
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.intrinsics.effect import effect_on_coordinates
from vgrd.vision.intrinsics.estimate import calibrate_intrinsics
from vgrd.vision.intrinsics.fit import BoardView

SIZE = (1600, 1200)
CAMERA = CameraModel(
    np.array([[2400.0, 0, 812], [0, 2403, 590], [0, 0, 1]]),
    np.array([-0.08, 0.1, 2e-4, -1e-4]),
    SIZE,
)
TRUTH = np.concatenate([CAMERA.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], CAMERA.distortion])
COLUMNS, ROWS, SQUARE = 9, 7, 22.0


def board():
    y, x = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    return np.column_stack([x - 4, y - 3, 0 * x]) * SQUARE


def simulated(seed, *, noise_px=0.02, print_mm=0.02, pictures=14, tilt_deg=(5, 40)):
    rng = np.random.default_rng(seed)
    real = board() + rng.normal(0, print_mm, (COLUMNS * ROWS, 3))
    views = []
    while len(views) < pictures:
        axis, yaw = rng.uniform(0, 2 * np.pi, 2)
        tilt = np.radians(rng.uniform(*tilt_deg)) * np.array([np.cos(axis), np.sin(axis), 0])
        R = Pose.from_rotvec(tilt).rotation @ Pose.from_rotvec([0, 0, yaw]).rotation
        z = rng.uniform(550, 700)
        centre = rng.uniform([400, 300], [1200, 900])
        sight = np.append((centre - CAMERA.matrix[:2, 2]) / 2400, 1.0)
        pixels = CAMERA.project(Pose(R, z * sight) @ real)
        inside = ((pixels > 2) & (pixels < np.array(SIZE) - 3)).all(1)
        if inside.mean() > 0.6:
            seen = pixels[inside] + rng.normal(0, noise_px, (inside.sum(), 2))
            views.append(BoardView(f"{len(views)}.png", np.flatnonzero(inside), seen))
    return views


def errors(result):
    K = result.camera.matrix
    values = np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], result.camera.distortion])
    return values - TRUTH


def opencv(views):
    points = [board()[view.ids].astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    K = cv2.calibrateCamera(points, pixels, SIZE, None, None, flags=cv2.CALIB_FIX_K3)[1]
    return K[[0, 1, 0, 1], [0, 1, 2, 2]] - TRUTH[:4]


def test_without_noise_the_camera_is_found_exactly():
    views = simulated(0, noise_px=0, print_mm=0)
    result = calibrate_intrinsics(board(), views, SIZE)
    np.testing.assert_allclose(errors(result)[:4], 0, atol=2e-3)
    assert result.rms_px < 1e-4


def test_the_covariance_is_honest_with_estimated_noise():
    squares = []
    for seed in range(12):
        result = calibrate_intrinsics(board(), simulated(seed, pictures=9), SIZE)
        e = errors(result)
        squares.append(e @ np.linalg.solve(result.covariance, e))
    # Mean of 12 chi-squares of 8 freedoms: 8 +- 1.16.
    assert 8 - 3 * 1.16 < np.mean(squares) < 8 + 3 * 1.16


def test_refined_board_points_beat_a_board_that_is_believed_eightfold():
    ours, theirs = [], []
    for seed in range(4):
        views = simulated(seed, noise_px=0.01, print_mm=0.03)
        ours.append(errors(calibrate_intrinsics(board(), views, SIZE))[:4])
        theirs.append(opencv(views))
    assert np.all(8 * np.std(ours, axis=0) < np.std(theirs, axis=0))


def test_noise_of_pixels_and_of_the_print_are_told_apart():
    result = calibrate_intrinsics(board(), simulated(3), SIZE)
    assert result.bundle.noise.pixel_px == pytest.approx(0.02, rel=0.1)
    assert result.bundle.noise.print_mm == pytest.approx(0.02, rel=0.25)
    given = calibrate_intrinsics(board(), simulated(3), SIZE, print_mm=0.05)
    assert given.bundle.noise.print_mm == 0.05


def test_the_held_out_error_is_that_of_a_fit_without_the_picture():
    views = simulated(5)
    result = calibrate_intrinsics(board(), views, SIZE, print_mm=0.02)
    without = calibrate_intrinsics(board(), views[1:], SIZE, print_mm=0.02)
    camera, points = without.camera, without.points_in_board
    _, w, t = cv2.solvePnP(points[views[0].ids], views[0].pixels, camera.matrix, camera.distortion)
    w, t = cv2.solvePnPRefineLM(
        points[views[0].ids], views[0].pixels, camera.matrix, camera.distortion, w, t
    )
    pixels = cv2.projectPoints(points[views[0].ids], w, t, camera.matrix, camera.distortion)[0]
    direct = np.sqrt(np.mean((pixels[:, 0] - views[0].pixels) ** 2))
    assert result.reports[0].held_out_px == pytest.approx(direct, rel=0.02)
    assert result.held_out_px > result.rms_px


@pytest.mark.parametrize("distortion", [0, 5, 8])
def test_other_lengths_of_distortion_fit_too(distortion):
    result = calibrate_intrinsics(
        board(), simulated(1, noise_px=0.02, pictures=16), SIZE, distortion=distortion
    )
    assert result.camera.distortion.size == distortion
    assert result.covariance.shape == (4 + distortion, 4 + distortion)
    if distortion:
        assert result.rms_px < 0.022
        rays = np.column_stack(
            [*np.random.default_rng(0).uniform(-0.2, 0.2, (2, 50)), np.ones(50)]
        )
        off = result.camera.project(rays) - CAMERA.project(rays)
        assert np.abs(off - off.mean(0)).max() < 1.0
    else:
        assert result.rms_px > 0.1


def test_a_bad_picture_is_left_out_and_named():
    views = simulated(2)
    rng = np.random.default_rng(0)
    moved = views[3].pixels + rng.normal(0, 0.7, views[3].pixels.shape)
    other = rng.uniform(0, 1200, views[5].pixels.shape)
    views[3], views[5] = replace(views[3], pixels=moved), replace(views[5], pixels=other)
    views.append(BoardView("few.png", np.arange(5), views[0].pixels[:5]))
    result = calibrate_intrinsics(board(), views, SIZE)
    reasons = {report.name: report.reason for report in result.reports if not report.used}
    assert set(reasons) == {"3.png", "5.png", "few.png"}
    assert "where others are by" in reasons["3.png"]
    assert "no common plane" in reasons["5.png"]
    assert "only 5 points" in reasons["few.png"]
    e = errors(result)
    assert e @ np.linalg.solve(result.covariance, e) < 27  # chi-square of 8, 1 in 1000


def test_a_wrong_corner_is_dropped_and_its_picture_stays():
    views = simulated(4)
    pixels = views[2].pixels.copy()
    pixels[7] += [0.6, -0.5]
    views[2] = replace(views[2], pixels=pixels)
    result = calibrate_intrinsics(board(), views, SIZE)
    assert all(report.used for report in result.reports)
    assert [report.dropped for report in result.reports] == [0, 0, 1] + 11 * [0]


def test_pictures_without_tilt_leave_the_focal_length_uncertain():
    good = calibrate_intrinsics(board(), simulated(6), SIZE)
    frontal = calibrate_intrinsics(board(), simulated(6, tilt_deg=(0, 2)), SIZE)
    assert frontal.sigmas["fx"] > 5 * good.sigmas["fx"]


def test_too_few_usable_pictures_are_refused_with_every_reason():
    views = [*simulated(0, pictures=3), BoardView("bad.png", np.arange(3), np.zeros((3, 2)))]
    with pytest.raises(TooFewObservations, match=r"3 usable.*bad\.png: only 3 points"):
        calibrate_intrinsics(board(), views, SIZE)
    with pytest.raises(InputError, match="one of"):
        calibrate_intrinsics(board(), views, SIZE, distortion=3)


def test_the_effect_in_mm_is_what_wrong_intrinsics_do():
    result = calibrate_intrinsics(board(), simulated(0), SIZE)
    effect = effect_on_coordinates(result.camera, result.covariance, 600, 25)
    double = effect_on_coordinates(result.camera, 4 * result.covariance, 600, 25)
    assert double.xy_mm == pytest.approx(2 * effect.xy_mm)
    # A focal length off by 0.1 % moves both tags' depth alike: far less than 0.6 mm remains.
    focal = np.zeros((8, 8))
    focal[:2, :2] = 2.4**2
    alone = effect_on_coordinates(CAMERA, focal, 600, 25)
    assert 0.001 < alone.z_mm < 0.2
    assert effect.z_mm > effect.xy_mm > 0
