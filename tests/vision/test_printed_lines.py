"""Tags that a printer or a drawing program put onto whole dots: cells differ, the square does not."""

import cv2
import numpy as np
import pytest

from vgrd.vision.alignment.photometric import align
from vgrd.vision.alignment.refinement import RefinementMethod, refine
from vgrd.vision.images.warp import NO_LENS
from vgrd.vision.print.raster import tag_raster
from vgrd.vision.tags.detection import find_tags

SIDE, RIM, FINE = 400, 60, 4  # dots of the square and of the paper around it; samples per pixel


def seen(dictionary, number, seed, side_px=150.0):
    """Picture of a marker on whole dots, and its true corners (4, 2) as OpenCV orders them."""
    rng = np.random.default_rng(seed)
    names = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    dots = cv2.aruco.generateImageMarker(names, number, SIDE)
    paper = cv2.copyMakeBorder(dots, RIM, RIM, RIM, RIM, cv2.BORDER_CONSTANT, value=255)
    angle, whole = rng.uniform(0, 2 * np.pi), SIDE + 2 * RIM
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    quad = square * (1 + rng.uniform(-0.1, 0.1, (4, 2))) * side_px * whole / SIDE @ turn.T + 160
    ends = np.array([[0, 0], [whole, 0], [whole, whole], [0, whole]]) - 0.5
    H = cv2.getPerspectiveTransform(ends.astype(np.float32), quad.astype(np.float32))
    fine = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1.0]])
    size = (320 * FINE, 320 * FINE)
    drawn = cv2.warpPerspective(paper.astype(np.float32), fine @ H, size, borderValue=200.0)
    light = 30 + 0.7 * cv2.resize(drawn, (320, 320), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(light, (0, 0), 0.7) + rng.normal(0, 1.0, light.shape)
    corners = np.array([[0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE]]) + RIM - 0.5
    truth = cv2.perspectiveTransform(corners[None].astype(np.float64), H)[0]
    return np.clip(np.rint(blurred), 0, 255).astype(np.uint8), truth


def rms(corners, truth):
    return min(np.sqrt(np.mean((np.roll(corners, k, 0) - truth) ** 2)) for k in range(4))


@pytest.mark.parametrize(
    ("dictionary", "family"),
    [
        ("DICT_4X4_50", "4x4_50"),
        ("DICT_5X5_100", "5x5_100"),
        ("DICT_ARUCO_ORIGINAL", "original"),
        ("DICT_APRILTAG_25h9", "25h9"),
    ],
)
def test_corners_stay_those_of_the_square_when_inner_lines_are_a_dot_off(dictionary, family):
    off = []
    for number in range(4):
        picture, truth = seen(dictionary, number, number)
        (tag,) = find_tags(picture, [family])
        refined = refine(picture, tag_raster(tag.family, tag.id, 1.0), tag.corners_px, NO_LENS)
        assert refined.method is RefinementMethod.PHOTOMETRIC
        off.append(rms(refined.corners_px, truth))
    assert np.median(off) < 0.01
    assert max(off) < 0.06


def test_a_tag_whose_cells_are_whole_dots_is_aligned_as_it_stands():
    picture, truth = seen("DICT_APRILTAG_36h11", 5, 1)
    (tag,) = find_tags(picture, ["36h11"])
    raster = tag_raster("36h11", 5, 1.0)
    refined = refine(picture, raster, tag.corners_px, NO_LENS)
    alone = align(picture, raster, refined.fit.frame, refined.fit.q_from_target)
    np.testing.assert_allclose(refined.corners_px, alone.corners_px, atol=1e-3)
    assert rms(refined.corners_px, truth) < 0.006
