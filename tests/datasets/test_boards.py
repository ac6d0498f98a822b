"""Boards rendered by OpenCV, seen through a known homography."""

import cv2
import numpy as np
import pytest

from vgrd.errors import InputError, TagNotSeen
from vgrd.vision.print.boards import Charuco, Chessboard, CircleGrid, SingleTag, detect_board

PX_PER_MM = 6.0
MARGIN_MM = 20.0
SIZE = (1000, 800)
HOMOGRAPHY = np.array([[0.62, 0.16, 90.0], [-0.12, 0.66, 160.0], [1.2e-4, 6e-5, 1.0]])
HALF_TURN = np.array([[-1.0, 0, SIZE[0] - 1], [0, -1.0, SIZE[1] - 1], [0, 0, 1]])


def canvas(width_mm, height_mm):
    """White sheet with a margin around the target."""
    shape = [round((side + 2 * MARGIN_MM) * PX_PER_MM) for side in (height_mm, width_mm)]
    return np.full(shape, 255, np.uint8)


def place(sheet, drawing):
    m = round(MARGIN_MM * PX_PER_MM)
    sheet[m : m + drawing.shape[0], m : m + drawing.shape[1]] = drawing
    return sheet


def draw_charuco(target, legacy=False):
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        target.square_mm,
        target.marker_mm,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100),
    )
    board.setLegacyPattern(legacy)
    size = [round(n * target.square_mm * PX_PER_MM) for n in (target.columns, target.rows)]
    sheet = place(canvas(*(s / PX_PER_MM for s in size)), board.generateImage(size))
    return sheet, np.zeros(2)


def draw_chessboard(target):
    cell = round(target.square_mm * PX_PER_MM)
    squares = np.indices((target.rows + 1, target.columns + 1)).sum(0) % 2
    drawing = np.kron(squares, np.ones((cell, cell))).astype(np.uint8) * 255
    height, width = (side / PX_PER_MM for side in drawing.shape)
    return place(canvas(width, height), drawing), np.full(2, target.square_mm)


def draw_circles(target):
    span = (2 * target.columns + 2) * target.spacing_mm, (target.rows + 1) * target.spacing_mm
    sheet = canvas(*span)
    for row in range(target.rows):
        for column in range(target.columns):
            x = 2 * column + row % 2 if target.asymmetric else column
            centre = (np.array([x, row]) + 1) * target.spacing_mm + MARGIN_MM
            fixed = np.round((centre * PX_PER_MM - 0.5) * 256).astype(int)
            radius = round(0.3 * target.spacing_mm * PX_PER_MM * 256)
            cv2.circle(sheet, tuple(map(int, fixed)), radius, 0, -1, cv2.LINE_AA, 8)
    return sheet, np.full(2, target.spacing_mm)


def draw_tag(target):
    dictionary = {
        "36h11": cv2.aruco.DICT_APRILTAG_36h11,
        "4x4_50": cv2.aruco.DICT_4X4_50,
        "5x5_100": cv2.aruco.DICT_5X5_100,
        "6x6_250": cv2.aruco.DICT_6X6_250,
    }[target.dictionary]
    side = round(target.size_mm * PX_PER_MM)
    drawing = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(dictionary), target.id, side
    )
    if target.dictionary == "36h11":  # OpenCV's AprilTags stand on their heads
        drawing = drawing[::-1, ::-1]
    return place(canvas(target.size_mm, target.size_mm), drawing), np.full(2, target.size_mm / 2)


def draw(target):
    match target:
        case Charuco():
            return draw_charuco(target)
        case Chessboard():
            return draw_chessboard(target)
        case CircleGrid():
            return draw_circles(target)
        case _:
            return draw_tag(target)


def view(sheet, homography):
    seen = cv2.warpPerspective(
        sheet,
        homography,
        SIZE,
        flags=cv2.INTER_AREA,
        borderValue=200,
        borderMode=cv2.BORDER_CONSTANT,
    )
    blurred = cv2.GaussianBlur(seen, (0, 0), 0.8).astype(float)
    noise = np.random.default_rng(0).normal(0, 2, blurred.shape)
    return (blurred + noise).clip(0, 255).astype(np.uint8)


def truth(points_in_target, origin, homography):
    """Pixels (n, 2) of target points: the origin lies at `origin` + margin on the sheet."""
    on_sheet = (points_in_target[:, :2] + origin + MARGIN_MM) * PX_PER_MM - 0.5
    return cv2.perspectiveTransform(on_sheet[None], homography)[0]


CASES = {
    "charuco": (Charuco(6, 5, 25, 18, "5x5_100"), 0.25),
    "chessboard": (Chessboard(7, 6, 18), 0.25),
    "circles": (CircleGrid(7, 5, 15), 0.25),
    "asymmetric circles": (CircleGrid(4, 9, 12, asymmetric=True), 0.25),
    "apriltag": (SingleTag("36h11", 7, 90), 0.25),
    "aruco 4x4": (SingleTag("4x4_50", 3, 90), 0.4),
    "aruco 5x5": (SingleTag("5x5_100", 3, 90), 0.4),
    "aruco 6x6": (SingleTag("6x6_250", 3, 90), 0.4),
}


@pytest.mark.parametrize("name", CASES)
def test_a_rendered_target_is_found_where_it_is(name):
    target, tolerance_px = CASES[name]
    sheet, origin = draw(target)
    found = detect_board(view(sheet, HOMOGRAPHY), target)
    assert len(found.pixels) == found.total == len(found.points_in_target)
    error = np.linalg.norm(
        found.pixels - truth(found.points_in_target, origin, HOMOGRAPHY), axis=1
    )
    assert np.sqrt((error**2).mean()) < tolerance_px


@pytest.mark.parametrize(
    "name", ["charuco", "chessboard", "asymmetric circles", "apriltag", "aruco 4x4"]
)
def test_a_half_turn_of_a_target_that_has_a_direction_is_recognised(name):
    target, tolerance_px = CASES[name]
    sheet, origin = draw(target)
    turned = HALF_TURN @ HOMOGRAPHY
    found = detect_board(view(sheet, turned), target)
    error = np.linalg.norm(found.pixels - truth(found.points_in_target, origin, turned), axis=1)
    assert np.sqrt((error**2).mean()) < tolerance_px


def test_a_charuco_board_of_the_layout_before_opencv_4_6_is_found():
    target = Charuco(6, 6, 25, 18, "5x5_100")
    sheet, _ = draw_charuco(target, legacy=True)
    assert len(detect_board(view(sheet, HOMOGRAPHY), target).pixels) == 25


@pytest.mark.parametrize("name", CASES)
def test_an_empty_picture_is_refused_with_the_reason(name):
    target, _ = CASES[name]
    with pytest.raises(TagNotSeen, match=r"no |not in the picture"):
        detect_board(np.full((400, 500), 180, np.uint8), target)


def test_another_tag_in_the_picture_is_named():
    sheet, _ = draw_tag(SingleTag("36h11", 7, 90))
    with pytest.raises(TagNotSeen, match=r"other ids seen: \[7\]"):
        detect_board(view(sheet, HOMOGRAPHY), SingleTag("36h11", 8, 90))


def test_a_board_with_too_few_visible_corners_says_how_many():
    target = Charuco(6, 5, 25, 18, "5x5_100")
    sheet, _ = draw(target)
    picture = view(sheet, HOMOGRAPHY)
    picture[:, 330:] = 200
    with pytest.raises(TagNotSeen, match=r"of 20 corners"):
        detect_board(picture, target)


def test_a_board_that_cannot_exist_is_an_input_error():
    with pytest.raises(InputError, match="marker_mm = 20"):
        Charuco(5, 7, 10, 20, "4x4_50")
    with pytest.raises(InputError, match="hold 70 markers, dictionary 4x4_50 has 50"):
        Charuco(10, 14, 20, 10, "4x4_50")


def test_a_colour_picture_is_an_input_error():
    with pytest.raises(InputError, match="grey"):
        detect_board(np.zeros((100, 100, 3), np.uint8), Chessboard(5, 4, 10))
