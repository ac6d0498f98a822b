"""Printed targets: what a detector reads off them, and that every length is exact."""

import ctypes
import re
import struct
import sys
from dataclasses import replace

import cv2
import numpy as np
import pypdfium2
import pytest

from vgrd.errors import InputError
from vgrd.vision.print.boards import Charuco, SingleTag, detect_board
from vgrd.vision.print.sheet import MM_PER_INCH, pdf, pixels, png, svg, write_sheet
from vgrd.vision.print.targets import TagGrid, checked_tag, config_lines, target_sheet
from vgrd.vision.tags.detection import find_tags

DPI = 200
PX_PER_MM = DPI / MM_PER_INCH
TAGS = [("36h11", 17), ("25h9", 3), ("16h5", 2), ("4x4_50", 7), ("apriltag_36h11", 17)]


def rendered(sheet, dpi=DPI):
    page = pypdfium2.PdfDocument(pdf(sheet))[0]
    return np.asarray(page.render(scale=dpi / 72, grayscale=True).to_numpy()).squeeze()


def widths_px(paper, side_px):
    """Ink along the rows and columns of the tag's outer border, as a length."""
    dark = 255.0 - paper
    y, x = np.nonzero(dark > 250)
    rows = dark[y.min() + 2 : y.min() + 8].sum(1) / 255
    columns = dark[:, x.min() + 2 : x.min() + 8].sum(0) / 255
    assert abs(len(np.unique(y)) - side_px) < 3
    return np.concatenate([rows, columns])


@pytest.mark.parametrize(("dictionary", "tag_id"), TAGS)
def test_a_printed_tag_is_read_upright_with_its_id_at_its_size(dictionary, tag_id):
    sheet = target_sheet(checked_tag(dictionary, tag_id, 25.3), "127x127")
    for paper in (pixels(sheet, DPI), rendered(sheet)):
        found = [t for t in find_tags(paper, [dictionary]) if t.id == tag_id]
        assert len(found) == 1
        corners = found[0].corners_px
        np.testing.assert_allclose(corners[1] - corners[0], [25.3 * PX_PER_MM, 0], atol=0.6)
        np.testing.assert_allclose(corners[3] - corners[0], [0, 25.3 * PX_PER_MM], atol=0.6)


@pytest.mark.parametrize("size_mm", [10.0, 25.3, 57.19])
def test_ink_of_the_png_is_as_wide_as_the_size_says_to_a_hundredth_of_a_pixel(size_mm):
    paper = pixels(target_sheet(checked_tag("36h11", 0, size_mm), "bare"), DPI)
    side = size_mm * PX_PER_MM
    np.testing.assert_allclose(widths_px(paper, side), side, atol=0.01)


def test_ink_of_the_pdf_is_as_wide_as_the_size_says_to_a_tenth_of_a_pixel():
    side = 25.3 * PX_PER_MM
    sheet = target_sheet(checked_tag("36h11", 0, 25.3), "127x127")  # whole pixels: not rescaled
    paper = rendered(replace(sheet, rasters=sheet.rasters[:1], texts=()))
    np.testing.assert_allclose(widths_px(paper, side), side, atol=0.1)


def drawn_points_mm(page):
    """Corner points (n, 2) of every filled path of a PDF page, mm, y down from the page's top."""
    height, raw = page.get_height(), pypdfium2.raw
    x, y = ctypes.c_float(), ctypes.c_float()
    for path in page.get_objects([raw.FPDF_PAGEOBJ_PATH]):
        matrix = path.get_matrix()
        points = []
        for number in range(raw.FPDFPath_CountSegments(path)):
            raw.FPDFPathSegment_GetPoint(raw.FPDFPath_GetPathSegment(path, number), x, y)
            right, up = matrix.on_point(x.value, y.value)
            points.append((right, height - up))
        yield np.array(points) / 72 * MM_PER_INCH


@pytest.mark.parametrize(
    ("target", "page"),
    [
        (SingleTag("36h11", 0, 25.3), "a4"),
        (SingleTag("4x4_50", 7, 1000 / 7), "bare"),
        (TagGrid("36h11", 3, 2, 61.7, 17.3), "a3"),
        (Charuco(7, 10, 33.3, 22.2, "5x5_100"), "a3"),
    ],
)
def test_the_pdf_draws_every_square_where_the_sheet_has_it_to_half_a_micrometre(target, page):
    sheet = target_sheet(target, page)
    drawn = list(drawn_points_mm(pypdfium2.PdfDocument(pdf(sheet))[0]))
    assert len(drawn) == len(sheet.rasters)
    for points, raster in zip(drawn, sheet.rasters, strict=True):
        black = np.argwhere(raster.cells)
        cell = np.array([raster.width_mm, raster.height_mm]) / raster.cells.shape[::-1]
        corner = np.array([raster.x_mm, raster.y_mm])
        low, high = corner + black.min(0)[::-1] * cell, corner + (black.max(0)[::-1] + 1) * cell
        np.testing.assert_allclose(points.min(0), low, atol=5e-4, rtol=0)
        np.testing.assert_allclose(points.max(0), high, atol=5e-4, rtol=0)
        lines = (points - corner) / cell
        np.testing.assert_allclose(lines * cell, np.rint(lines) * cell, atol=5e-4, rtol=0)


def test_the_pdf_asks_the_viewer_not_to_scale_it_and_is_the_same_each_time():
    sheet = target_sheet(SingleTag("36h11", 0, 25), "a4")
    assert b"/PrintScaling /None" in pdf(sheet)
    assert pdf(sheet) == pdf(sheet)


def test_without_reportlab_a_pdf_is_refused_with_the_remedy_and_the_others_are_written(
    tmp_path, monkeypatch
):
    sheet = target_sheet(SingleTag("36h11", 0, 9), "bare")
    monkeypatch.setitem(sys.modules, "reportlab.pdfgen.canvas", None)
    with pytest.raises(InputError, match=r"pip install 'vgrd\[print\]'.*\.svg or \.png"):
        write_sheet(sheet, tmp_path / "a.pdf", 300)
    for name in ("a.svg", "a.png"):
        write_sheet(sheet, tmp_path / name, 300)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg"]


def test_corners_of_apriltags_in_the_png_are_where_the_sheet_says():
    sheet = target_sheet(checked_tag("36h11", 5, 30.0), "127x127")
    raster = sheet.rasters[0]
    paper = cv2.GaussianBlur(pixels(sheet, DPI), (0, 0), 0.7)
    corners = find_tags(paper, ["36h11"])[0].corners_px
    place = np.array([raster.x_mm, raster.y_mm]) * PX_PER_MM - 0.5
    expected = place + 30.0 * PX_PER_MM * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_allclose(corners, expected, atol=0.1)


def test_the_page_of_the_pdf_and_the_bar_have_their_size():
    sheet = target_sheet(checked_tag("36h11", 0, 25), "a4")
    page = pypdfium2.PdfDocument(pdf(sheet))[0]
    np.testing.assert_allclose(np.array(page.get_size()) / 72 * MM_PER_INCH, [210, 297], atol=1e-3)
    text = page.get_textpage().get_text_bounded()
    assert "AprilTag 36h11, id 0, 25 mm" in text
    assert "size_mm = ____" in text
    paper = pixels(sheet, DPI)
    bar = sheet.rasters[1]
    row = 255.0 - paper[int((bar.y_mm + 0.15) * PX_PER_MM)]
    assert row.sum() / row.max() == pytest.approx(100 * PX_PER_MM, abs=0.1)


def test_the_svg_draws_the_same_outline_in_mm():
    sheet = target_sheet(SingleTag("36h11", 0, 25.3), "a4")
    text = svg(sheet)
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in text
    path = re.search(r'<path[^>]* d="([^"]*)"', text).group(1)
    numbers = np.array(re.findall(r"[-\d.]+", path), dtype=float).reshape(-1, 2)
    np.testing.assert_allclose(np.ptp(numbers, axis=0), 25.3, atol=1e-4)
    loops = [
        np.array(re.findall(r"[-\d.]+", loop), dtype=float).reshape(-1, 2)
        for loop in path.split("Z")[:-1]
    ]
    area = abs(sum(cv2.contourArea(loop.astype(np.float32), oriented=True) for loop in loops))
    black = sheet.rasters[0].cells
    assert area == pytest.approx(25.3**2 * black.mean(), rel=1e-4)


@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (7, 6), (4, 4)])
def test_a_charuco_board_is_found_by_opencv_with_every_corner_in_place(columns, rows):
    board = Charuco(columns, rows, 20.0, 15.0, "5x5_100")
    sheet = target_sheet(board, "210x210")
    found = detect_board(cv2.GaussianBlur(pixels(sheet, DPI), (0, 0), 0.7), board)
    assert len(found.pixels) == found.total
    raster = sheet.rasters[0]
    place = found.points_in_target[:, :2] + [raster.x_mm, raster.y_mm]
    np.testing.assert_allclose(found.pixels, place * PX_PER_MM - 0.5, atol=0.1)


@pytest.mark.parametrize("dictionary", ["36h11", "4x4_50"])
def test_the_tags_of_a_board_are_where_its_corners_say(dictionary):
    grid = TagGrid(dictionary, 4, 3, 20.0, 5.0, first_id=6)
    sheet = target_sheet(grid, "bare")
    found = find_tags(pixels(sheet, DPI), [dictionary])
    corners = grid.corners()
    assert [tag.id for tag in found] == sorted(corners)
    rim = np.array([sheet.rasters[0].x_mm, sheet.rasters[0].y_mm])
    for tag in found:
        expected = (corners[tag.id][:, :2] + rim) * PX_PER_MM - 0.5
        np.testing.assert_allclose(tag.corners_px, expected, atol=0.6)


def test_a_png_tells_its_resolution():
    data = png(target_sheet(SingleTag("36h11", 0, 10), "bare"), 600)
    place = data.index(b"pHYs")
    assert struct.unpack(">IIB", data[place + 4 : place + 13]) == (23622, 23622, 1)
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) is not None


def test_a_wide_board_turns_the_page():
    sheet = target_sheet(TagGrid("36h11", 6, 2, 30.0, 8.0), "a4")
    assert (sheet.width_mm, sheet.height_mm) == (297, 210)


def test_the_config_lines_are_toml_with_the_keys_of_the_cell_file():
    lines = config_lines(SingleTag("36h11", 3, 25.0))
    assert lines == ('family = "36h11"', "id = 3", "size_mm = 25.0")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: checked_tag("36h11", 587, 25), "36h11 has the ids 0 to 586"),
        (lambda: checked_tag("37h11", 0, 25), "known: 16h5, 25h9"),
        (lambda: checked_tag("36h11", 0, -1), "edge of the black square"),
        (lambda: TagGrid("36h11", 20, 30, 5, 2), "end with id 599"),
        (lambda: TagGrid("36h11", 2, 3, 20, 1), "at least one cell"),
        (lambda: target_sheet(SingleTag("36h11", 0, 200), "a4"), "needs 320.0 x 352.0 mm"),
        (lambda: target_sheet(SingleTag("36h11", 0, 20), "b7"), "page 'b7' is unknown"),
        (lambda: pixels(target_sheet(SingleTag("36h11", 0, 9), "a3"), 4800), "choose another"),
    ],
)
def test_what_cannot_be_printed_is_refused_with_the_remedy(make, message):
    with pytest.raises(InputError, match=re.escape(message)):
        make()


def test_an_unknown_kind_of_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.pdf, \.svg or \.png"):
        write_sheet(target_sheet(SingleTag("36h11", 0, 9), "bare"), tmp_path / "a.gif", 300)
