"""A target that a person sees and the program does not: the cause is named, with the remedy."""

import ctypes
from pathlib import Path

import cv2
import numpy as np
import pyapriltags
import pytest

from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.solving.datasets.boards import load_board
from vgrd.vision.boards.fit import fit_board
from vgrd.vision.boards.inspection import inspect_board
from vgrd.vision.images.pictures import Picture
from vgrd.vision.inspection import inspect_picture
from vgrd.vision.print.boards import Charuco, Chessboard, CircleGrid, SingleTag
from vgrd.vision.print.codes import detectable_family, dictionary_of
from vgrd.vision.print.targets import AprilGrid, TagGrid
from vgrd.vision.tags.detection import find_tags
from vgrd.vision.tags.seeing import see_target

CASES = Path(__file__).parents[3] / "shared" / "data" / "cases" / "tags"
SIZE = (1000, 800)
CAMERA = CameraModel(np.array([[1100.0, 0, 500], [0, 1100, 400], [0, 0, 1]]), np.zeros(0), SIZE)
PX_PER_MM = 10
RIM_MM = 20


def seen(sheet, pose, *, paper=225, noise=1.5):
    """Picture (h, w) of a sheet with PX_PER_MM whose first pixel's corner lies at (-RIM, -RIM) mm."""
    mm = 1 / PX_PER_MM
    mm_from_px = np.array([[mm, 0, mm / 2 - RIM_MM], [0, mm, mm / 2 - RIM_MM], [0, 0, 1]])
    H = CAMERA.matrix @ np.column_stack([pose.rotation[:, :2], pose.translation]) @ mm_from_px
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]]) @ H
    ink = 30 + (paper - 30) * (sheet / 255.0)
    large = cv2.warpPerspective(
        ink, fine, (4 * SIZE[0], 4 * SIZE[1]), flags=cv2.INTER_AREA, borderValue=paper
    )
    drawn = cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    drawn += np.random.default_rng(0).normal(0, noise, drawn.shape)
    return drawn.round().clip(0, 255).astype(np.uint8)


def at(width_mm, height_mm, rotvec=(0.3, -0.25, 0.1), distance=330.0):
    """A pose that shows the middle of a board of this extent."""
    R = Pose.from_rotvec(rotvec).rotation
    return Pose(R, np.array([0, 0, distance]) - R @ np.array([width_mm / 2, height_mm / 2, 0]))


def blank(width_mm, height_mm):
    shape = [round((mm + 2 * RIM_MM) * PX_PER_MM) for mm in (height_mm, width_mm)]
    return np.full(shape, 255, np.uint8)


def stick(sheet, picture, x_mm, y_mm):
    x, y = (round((mm + RIM_MM) * PX_PER_MM) for mm in (x_mm, y_mm))
    sheet[y : y + picture.shape[0], x : x + picture.shape[1]] = picture


def tag_sheet(columns, rows, size_mm, gap_mm, *, turned=False, ids=None):
    """Tags 36h11 row by row from the top; OpenCV draws AprilTags upside down, turned: leave them so."""
    sheet = blank(columns * (size_mm + gap_mm), rows * (size_mm + gap_mm))
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for place, number in enumerate(ids or range(columns * rows)):
        row, column = divmod(place, columns)
        drawn = cv2.aruco.generateImageMarker(codes, number, round(size_mm * PX_PER_MM))
        drawn = drawn if turned else drawn[::-1, ::-1]
        stick(sheet, drawn, column * (size_mm + gap_mm), row * (size_mm + gap_mm))
    return sheet


def kalibr_sheet(columns, rows, size_mm, gap_mm, border=2, first=0, joints=True):
    """As kalibr_create_target_pdf lays it out: ids from the bottom left, squares at all corners."""
    sheet = blank(columns * (size_mm + gap_mm), rows * (size_mm + gap_mm))
    side, gap = round(size_mm * PX_PER_MM), round(gap_mm * PX_PER_MM)
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        x, y = column * (size_mm + gap_mm), (rows - 1 - row) * (size_mm + gap_mm)
        drawn = cv2.aruco.generateImageMarker(codes, first + number, side, borderBits=border)
        stick(sheet, drawn[::-1, ::-1], x, y)  # OpenCV draws AprilTags upside down
        for dx in (-gap_mm, size_mm):
            for dy in (-gap_mm, size_mm):
                if joints:
                    stick(sheet, np.zeros((gap, gap), np.uint8), x + dx, y + dy)
    return sheet


def charuco_sheet(columns, rows, dictionary, first=0, square=24, marker=18):
    codes = dictionary_of(dictionary)
    ids = np.arange(first, first + columns * rows // 2)
    board = cv2.aruco.CharucoBoard((columns, rows), square, marker, codes, ids)
    size = (columns * square * PX_PER_MM, rows * square * PX_PER_MM)
    sheet = blank(columns * square, rows * square)
    stick(sheet, board.generateImage(size), 0, 0)
    return sheet


def told(grey, target):
    with pytest.raises(TagNotSeen) as error:
        see_target(grey, target)
    return str(error.value)


def test_an_aprilgrid_of_kalibr_is_measured():
    grid = AprilGrid("36h11_border2", 4, 3, 30.0, 9.0)
    pose = at(150, 110)
    grey = seen(kalibr_sheet(4, 3, 30, 9), pose)
    report = inspect_board(grey, "k", grid, CAMERA)
    assert not report.findings
    xi = (report.pose @ pose.inverse()).log()
    assert xi @ np.linalg.solve(report.fit.covariance, xi) < 30
    found = see_target(grey, grid)
    assert len(found.pixels) == found.total == 48
    error = CAMERA.project(pose @ found.points_in_target) - found.pixels
    assert np.sqrt((error**2).mean()) < 0.1


def test_the_border_of_two_cells_is_named_and_that_of_one_is_another_family():
    tags = TagGrid("36h11", 4, 3, 30.0, 9.0)
    grey = seen(kalibr_sheet(4, 3, 30, 9), at(150, 110))
    assert 'type = "aprilgrid"' in told(grey, tags)
    with pytest.raises(TagNotSeen, match="black border is two cells wide"):
        fit_board(grey, tags, CAMERA)
    plain = seen(kalibr_sheet(4, 3, 30, 9, border=1, joints=False), at(150, 110))
    assert "36h11 are in the picture" in told(plain, AprilGrid("36h11_border2", 4, 3, 30.0, 9.0))


def test_nothing_is_read_between_the_edges_of_a_wide_border():
    """At twice its size this picture had three tags, of sides half-way between those of both edges."""
    pose = at(150, 110, rotvec=(0.01, 0.25, -0.35), distance=518)
    grey = seen(kalibr_sheet(4, 3, 30, 9), pose)
    assert find_tags(grey, ["36h11"]) == []
    assert len(find_tags(grey, ["36h11_border2"])) == 12
    narrow = seen(kalibr_sheet(4, 3, 30, 9, border=1, joints=False), pose)
    assert len(find_tags(narrow, ["36h11"])) == 12


def test_a_board_file_of_kalibrs_words_is_read(tmp_path):
    path = tmp_path / "april.toml"
    text = 'type = "aprilgrid"\ncolumns = 6\nrows = 6\nsize_mm = 88\nspacing = 0.3\n'
    path.write_text(text)
    board = load_board(path)
    assert board.gap_mm == pytest.approx(26.4)
    assert [board.id_at(5, 0), board.id_at(0, 0), board.id_at(0, 5)] == [0, 30, 35]
    path.write_text(text + "gap_mm = 3\n")
    with pytest.raises(InputError, match="one of both"):
        load_board(path)


@pytest.mark.parametrize(
    ("sheet", "board", "cause"),
    [
        ({}, TagGrid("36h11", 3, 4, 24.0, 6.0), "look swapped: write columns = 4, rows = 3"),
        ({"turned": True}, TagGrid("36h11", 4, 3, 24.0, 6.0), "id 0 on: every tag is turned by half"),
        ({"turned": True}, TagGrid("36h11", 3, 4, 24.0, 6.0), "rows = 3; every tag is turned by half"),
        ({}, TagGrid("36h11", 6, 6, 24.0, 6.0), "lie as those of a board with columns = 4, first_id = 0"),
        ({}, TagGrid("36h11", 4, 3, 24.0, 6.0, 1), "lie as those of a board with columns = 4, first_id = 0"),
        ({}, AprilGrid("36h11", 4, 3, 24.0, 6.0), 'count from the top left: write type = "tags"'),
        ({"ids": [7, 3, 11, 0, 9, 1, 5, 10, 2, 8, 4, 6]}, TagGrid("36h11", 4, 3, 24.0, 6.0),
         "correct columns, rows, first_id and type"),
    ],
)  # fmt: skip
def test_tags_that_lie_on_another_layout_are_refused_with_that_layout(sheet, board, cause):
    grey = seen(tag_sheet(4, 3, 24, 6, **sheet), at(114, 84))
    assert cause in told(grey, board)


def test_a_swapped_aprilgrid_of_kalibr_is_refused():
    grey = seen(kalibr_sheet(4, 3, 30, 9), at(150, 110))
    message = told(grey, AprilGrid("36h11_border2", 3, 4, 30.0, 9.0))
    assert "look swapped: write columns = 4, rows = 3" in message


def test_neither_a_wide_lens_nor_a_tag_of_another_board_hides_the_layout():
    ids = [
        *range(11),
        40,
    ]  # the last is no tag of the board, and the last of the board is elsewhere
    sheet = tag_sheet(4, 3, 24, 6, ids=ids)
    stray = tag_sheet(1, 1, 12, 0, ids=[11])[RIM_MM * PX_PER_MM :, RIM_MM * PX_PER_MM :][
        :120, :120
    ]
    stick(sheet, stray, -15, -15)
    pose = at(114, 84)
    grey = seen(sheet, pose)
    board = TagGrid("36h11", 4, 3, 24.0, 6.0)
    found = see_target(grey, board)
    assert len(found.pixels) == 44
    assert np.abs(CAMERA.project(pose @ found.points_in_target) - found.pixels).max() < 0.3
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    r2 = ((x - 500) ** 2 + (y - 400) ** 2) / 640**2
    wide = cv2.remap(  # the rim of the picture is drawn in by 25 %
        seen(tag_sheet(4, 3, 24, 6), at(114, 84, distance=190)),
        (500 + (x - 500) * (1 + 0.25 * r2)).astype(np.float32),
        (400 + (y - 400) * (1 + 0.25 * r2)).astype(np.float32),
        cv2.INTER_LINEAR,
        borderValue=225,
    )
    assert len(see_target(wide, board).pixels) >= 40


def test_swapped_columns_and_rows_are_named():
    grey = seen(charuco_sheet(5, 7, "5x5_100"), at(120, 168, distance=420))
    message = told(grey, Charuco(7, 5, 24, 18, "5x5_100"))
    assert "columns and rows look swapped" in message
    assert "write columns = 5, rows = 7" in message


@pytest.mark.parametrize(
    ("change", "target", "cause"),
    [
        (lambda grey: 255 - grey, Charuco(5, 4, 24, 18, "4x4_50"), "black and white are swapped"),
        (lambda grey: grey[:, ::-1], Charuco(5, 4, 24, 18, "4x4_50"), "as in a mirror"),
        (lambda grey: grey, Charuco(5, 4, 24, 18, "6x6_250"), "4x4_50 are in the picture (id 0 to 9)"),
        (lambda grey: grey, Charuco(4, 3, 24, 18, "4x4_50"), "not of inner corners: as 5 x 4 squares 12"),
        (lambda grey: grey, Charuco(6, 5, 24, 18, "4x4_50"), "too large: as 5 x 4 squares 12 corners fit"),
        (lambda grey: grey, Charuco(4, 4, 24, 18, "4x4_50"), "one too few: as 5 x 4 squares 12 corners"),
        (lambda grey: grey, Charuco(5, 4, 24, 18, "4x4_50", 4), "begin with id 0; is first_id = 0 meant"),
        (lambda grey: grey // 20, Charuco(5, 4, 24, 18, "4x4_50"), "the picture is dark, its white is at 11"),
        (lambda grey: np.maximum(grey, 250), Charuco(5, 4, 24, 18, "4x4_50"), "the picture is too bright"),
        (lambda grey: grey, SingleTag("4x4_50", 33, 18), "seen with id 0 to 9, the target has id 33"),
    ],
)  # fmt: skip
def test_the_cause_is_named(change, target, cause):
    grey = seen(charuco_sheet(5, 4, "4x4_50"), at(120, 96))
    assert cause in told(np.ascontiguousarray(change(grey)), target)


def test_a_first_id_that_is_not_0_is_named():
    grey = seen(charuco_sheet(5, 4, "4x4_50", first=20), at(120, 96))
    assert "is first_id = 20 meant" in told(grey, Charuco(5, 4, 24, 18, "4x4_50"))
    board = Charuco(5, 4, 24.0, 18.0, "4x4_50", first_id=20)
    assert len(see_target(grey, board).pixels) == 12
    report = inspect_board(grey, "b", board, CAMERA)
    assert not report.findings
    assert report.pose.distance(at(120, 96))[0] < 0.1
    grid = seen(kalibr_sheet(3, 2, 30, 9, border=1, first=12, joints=False), at(110, 70))
    assert "is first_id = 12 meant" in told(grid, TagGrid("36h11", 3, 2, 30.0, 9.0))


def lone_tag(rim_mm):
    """A tag 36h11 of 40 mm with a white rim, on a dark plate."""
    sheet = np.full_like(blank(60, 60), 60)
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    drawn = cv2.aruco.generateImageMarker(codes, 5, 400)
    rim = round(rim_mm * PX_PER_MM)
    paper = cv2.copyMakeBorder(drawn, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)
    stick(sheet, paper, 10 - rim_mm, 10 - rim_mm)
    return sheet


def messages(grey, families):
    report = inspect_picture(Picture(grey, is_turned=False), families, None, None)
    return [tag.tag.id for tag in report.tags], " ".join(f.message for f in report.findings)


def test_a_thin_white_rim_is_named():
    ids, _ = messages(seen(lone_tag(5.0), at(60, 60), paper=225), ["36h11"])
    assert ids == [5]
    ids, told_by_detect = messages(seen(lone_tag(1.0), at(60, 60), paper=225), ["36h11"])
    assert ids == []
    assert "the white rim of id 5 is thin or dark" in told_by_detect


def test_an_inverted_tag_and_one_of_another_family_are_named():
    grey = seen(lone_tag(8.0), at(60, 60))
    assert "black and white are swapped" in messages(255 - grey, ["36h11"])[1]
    assert "36h11 are in the picture (id 5)" in messages(grey, ["4x4_50"])[1]
    empty = np.full((400, 500), 180, np.uint8)
    assert messages(empty, ["36h11"])[1] == "no tag found; looked for 36h11"


def test_a_chessboard_counted_in_squares_is_named():
    sheet = blank(8 * 15, 6 * 15)
    squares = np.kron(np.indices((6, 8)).sum(0) % 2, np.ones((150, 150))) * 255
    stick(sheet, squares.astype(np.uint8), 0, 0)
    grey = seen(sheet, at(120, 90))
    assert len(see_target(grey, Chessboard(7, 5, 15)).pixels) == 35
    squares_told = told(grey, Chessboard(8, 6, 15))
    assert "those of inner corners, not of squares: columns = 7, rows = 5 fit" in squares_told
    for columns, rows in ((6, 4), (7, 4), (8, 5)):
        other = told(grey, Chessboard(columns, rows, 15))
        assert "other columns and rows is seen: columns = 7, rows = 5 fit" in other


def circles_seen(columns, rows):
    sheet = blank(columns * 20, rows * 20)
    for x in range(columns):
        for y in range(rows):
            centre = tuple(round((20 * i + 10 + RIM_MM) * PX_PER_MM) for i in (x, y))
            cv2.circle(sheet, centre, 60, (0,), -1)
    return seen(sheet, at(columns * 20, rows * 20, rotvec=(0.1, 0.1, 0)))


def test_circles_that_are_skipped_are_told():
    """OpenCV finds four of the five rows as 4 x 7 and leaves out one between."""
    assert "lie on no grid of 4 x 7" in told(circles_seen(7, 5), CircleGrid(4, 7, 20))


def test_white_circles_and_grids_that_go_on_are_named():
    grey = circles_seen(6, 5)
    assert len(see_target(grey, CircleGrid(6, 5, 20)).pixels) == 30
    for columns, rows, word in ((6, 4, "rows"), (5, 5, "columns"), (5, 4, "rows")):
        message = told(grey, CircleGrid(columns, rows, 20))
        assert f"goes on beyond {columns} x {rows}: it has more {word}" in message
    assert "white on black" in told(255 - grey, CircleGrid(6, 5, 20))


def test_a_board_whose_markers_were_rounded_to_pixels_is_whole():
    """OpenCV draws a marker of 22 mm into 176 px of 29.33 px a cell: lines err by a third of a pixel."""
    board = cv2.aruco.CharucoBoard((7, 5), 30, 22, dictionary_of("4x4_50"))
    drawn = board.generateImage((7 * 30 * 8, 5 * 30 * 8))
    sheet = cv2.copyMakeBorder(drawn, 160, 160, 160, 160, cv2.BORDER_CONSTANT, value=255)
    pose = at(210, 150, distance=460)
    mm = 1 / 8
    mm_from_px = np.array([[mm, 0, mm / 2 - 20], [0, mm, mm / 2 - 20], [0, 0, 1]])
    H = CAMERA.matrix @ np.column_stack([pose.rotation[:, :2], pose.translation]) @ mm_from_px
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]]) @ H
    large = cv2.warpPerspective(
        30 + sheet * 0.76, fine, (4 * SIZE[0], 4 * SIZE[1]), flags=cv2.INTER_AREA, borderValue=224
    )
    grey = cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    grey = (grey + np.random.default_rng(0).normal(0, 1.5, grey.shape)).clip(0, 255)
    report = inspect_board(grey.astype(np.uint8), "b", Charuco(7, 5, 30.0, 22.0, "4x4_50"), CAMERA)
    assert "partial" not in {finding.code for finding in report.findings}
    assert report.pose.distance(pose)[0] < 0.2


@pytest.mark.parametrize("family", ["standard41h12", "circle21h7"])
def test_tags_with_codes_around_their_border_are_found_by_all_commands(family):
    sheet = blank(60, 60)
    name = {"standard41h12": "tagStandard41h12", "circle21h7": "tagCircle21h7"}[family]
    cells, across = library_cells(name, 3)
    size_mm, start = 40 * across / len(cells), 40 * (len(cells) - across) / 2 / len(cells)
    stick(sheet, np.kron(cells * 255, np.ones((400 // len(cells),) * 2)).astype(np.uint8), 10, 10)
    pose = at(60, 60, rotvec=(0.3, -0.2, 0.1), distance=250)
    grey = seen(sheet, pose)
    ids, _ = messages(grey, [detectable_family(f"tag{family}")])
    assert ids == [3]
    found = see_target(grey, SingleTag(family, 3, size_mm))
    side = 400 // len(cells) * len(cells) / PX_PER_MM  # whole pixels a cell
    centre = Pose.from_rotvec((0, 0, 0), (10 + side / 2, 10 + side / 2, 0))
    scale = side / 40
    error = CAMERA.project(pose @ centre @ (scale * found.points_in_target)) - found.pixels
    assert np.abs(error).max() < 1.5
    assert start > 0


def library_cells(family, tag_id):
    """Cells (n, n), 1 white, of a tag by the library's own table, and how many its border spans."""
    detector = pyapriltags.Detector(families=family)
    pointer = ctypes.cast(
        detector.tag_families[family], ctypes.POINTER(pyapriltags.apriltags._ApriltagFamily)
    )
    kind = pointer.contents
    total, across = kind.total_width, kind.width_at_border
    start = (total - across) // 2
    reach = np.abs(np.indices((total, total)) - (total - 1) / 2).max(0)
    cells = np.ones((total, total))
    dark = (
        (reach < across / 2 + 1) & (reach > across / 2)
        if kind.reversed_border
        else ((reach < across / 2) & (reach > across / 2 - 1))
    )
    cells[dark] = 0
    for i in range(kind.nbits):
        row, column = kind.bit_y[i] + start, kind.bit_x[i] + start
        cells[row, column] = kind.codes[tag_id] >> (kind.nbits - 1 - i) & 1
    return cells, across


def test_the_cases_of_others_are_named():
    if not CASES.is_dir():
        pytest.skip(f"{CASES} is not there: it is no part of the repository")
    camera = CameraModel(
        np.array([[1200.0, 0, 640], [0, 1200, 480], [0, 0, 1]]), np.zeros(0), (1280, 960)
    )

    def report(picture, board):
        grey = cv2.imread(str(CASES / picture), cv2.IMREAD_GRAYSCALE)
        found = inspect_board(grey, "b", board, camera)
        return found.pose, " ".join(finding.message for finding in found.findings)

    pose, told_of_it = report("charuco7x5-px8.png", load_board(CASES / "b7x5.toml"))
    assert pose is not None
    assert told_of_it == ""
    pose, told_of_it = report("charuco6x8-new.png", load_board(CASES / "b6x8-swapped.toml"))
    assert pose is None
    assert "columns and rows look swapped" in told_of_it
    _, told_of_it = report("kalibr-aprilgrid.png", load_board(CASES / "kalibr.toml"))
    assert "border is two cells wide" in told_of_it
    pose, told_of_it = report("kalibr-aprilgrid.png", AprilGrid("36h11_border2", 4, 3, 30.0, 9.0))
    assert pose is not None
    assert told_of_it == ""
