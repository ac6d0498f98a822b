"""A printed page: rasters of black cells and lines of text at exact places, as PDF, SVG or PNG.

Places in mm from the page's upper left corner, x right, y down. PDF and SVG draw every raster as
one outline, so that no hairline shows between cells; the PNG holds the exact share of ink of every
pixel, so that edges stay where they are at any resolution.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.errors import InputError
from vgrd.geometry import Array

MM_PER_INCH = 25.4  # by definition
_POINTS_PER_MM = 72 / MM_PER_INCH  # PDF's default unit is 1/72 inch (ISO 32000-1, 8.3.2.3)
_MAX_PIXELS = 400_000_000  # bytes of memory; A3 at 1200 dpi has 278 million
Cells = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SheetRaster:
    """Cells (rows, columns), True is black, that fill a rectangle."""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float
    cells: Cells


@dataclass(frozen=True, slots=True)
class Text:
    """A line of plain text; x, y: left end of its base line; height: of the letters' em."""

    x_mm: float
    y_mm: float
    height_mm: float
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A page and what is on it; rasters must not overlap."""

    width_mm: float
    height_mm: float
    rasters: tuple[SheetRaster, ...]
    texts: tuple[Text, ...]


def write_sheet(sheet: Sheet, path: Path, dpi: int) -> None:
    """Write .pdf, .svg or .png (dpi: of the PNG); InputError where that cannot be."""
    suffix = path.suffix.lower()
    match suffix:
        case ".pdf":
            data = pdf(sheet)
        case ".svg":
            data = svg(sheet).encode("utf-8")
        case ".png":
            data = png(sheet, dpi)
        case _:
            raise InputError(f"{path}: name a file that ends with .pdf, .svg or .png")
    try:
        path.write_bytes(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def svg(sheet: Sheet) -> str:
    """The sheet as SVG whose user unit is one mm."""
    size = f"{_mm(sheet.width_mm)}mm", f"{_mm(sheet.height_mm)}mm"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" '
        f'viewBox="0 0 {_mm(sheet.width_mm)} {_mm(sheet.height_mm)}">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for raster in sheet.rasters:
        outline = "".join(
            "M" + "L".join(f"{_mm(x)} {_mm(y)}" for x, y in loop) + "Z"
            for loop in _outlines(raster)
        )
        lines.append(f'<path fill="black" fill-rule="evenodd" d="{outline}"/>')
    lines += [
        f'<text x="{_mm(text.x_mm)}" y="{_mm(text.y_mm)}" font-size="{_mm(text.height_mm)}" '
        f'font-family="Helvetica, Arial, sans-serif">{escape(text.text)}</text>'
        for text in sheet.texts
    ]
    return "\n".join([*lines, "</svg>", ""])


def pdf(sheet: Sheet) -> bytes:
    """The sheet as a PDF page that asks the viewer not to scale it when printing.

    The same sheet gives the same bytes. Raises InputError when reportlab is not installed.
    """
    try:
        from reportlab.pdfgen.canvas import FILL_EVEN_ODD, Canvas
    except ImportError as error:
        raise InputError(
            "a PDF needs reportlab: pip install 'vgrd[print]', or name a file that ends with .svg or .png"
        ) from error
    scale, height = _POINTS_PER_MM, sheet.height_mm
    stream = BytesIO()
    size = (scale * sheet.width_mm, scale * height)
    canvas = Canvas(stream, pagesize=size, pageCompression=1, invariant=1)
    canvas.setViewerPreference("PrintScaling", "None")
    for raster in sheet.rasters:
        path = canvas.beginPath()
        for loop in _outlines(raster):
            (x, y), *rest = [(scale * x, scale * (height - y)) for x, y in loop]
            path.moveTo(x, y)
            for x, y in rest:
                path.lineTo(x, y)
            path.close()
        canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_EVEN_ODD)
    for text in sheet.texts:
        canvas.setFont("Helvetica", scale * text.height_mm)
        canvas.drawString(scale * text.x_mm, scale * (height - text.y_mm), text.text)
    canvas.save()
    return stream.getvalue()


def png(sheet: Sheet, dpi: int) -> bytes:
    """The sheet as a grey PNG that holds its resolution."""
    stream = cv2.imencode(".png", pixels(sheet, dpi))[1].tobytes()
    per_m = round(dpi * 1000 / MM_PER_INCH)
    body = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    header_end = 33  # signature and the header chunk
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return stream[:header_end] + chunk + stream[header_end:]


def pixels(sheet: Sheet, dpi: int) -> NDArray[np.uint8]:
    """Grey picture (h, w) of the sheet; raises InputError when it would be too large."""
    per_mm = dpi / MM_PER_INCH
    width, height = round(sheet.width_mm * per_mm), round(sheet.height_mm * per_mm)
    if width * height > _MAX_PIXELS or min(width, height) < 1:
        raise InputError(f"a picture of {width} x {height} px: choose another --dpi, or PDF")
    paper = np.full((height, width), 255, dtype=np.uint8)
    for raster in sheet.rasters:
        rows, columns = raster.cells.shape
        y0, Y = _shares(raster.y_mm * per_mm, raster.height_mm * per_mm, rows, height)
        x0, X = _shares(raster.x_mm * per_mm, raster.width_mm * per_mm, columns, width)
        region = paper[y0 : y0 + len(Y), x0 : x0 + len(X)]
        ink = Y @ raster.cells.astype(np.float64) @ X.T
        region -= np.rint(255 * ink).astype(np.uint8).clip(0, region)
    for text in sheet.texts:
        _letter(paper, text, per_mm)
    return paper


def _shares(start: float, length: float, cells: int, limit: int) -> tuple[int, Array]:
    """First pixel, and how much of each pixel (n, cells) every cell covers."""
    edges = start + length / cells * np.arange(cells + 1)
    first = int(max(np.floor(edges[0]), 0))
    pixel = np.arange(first, min(int(np.ceil(edges[-1])), limit))[:, None]
    covered = np.minimum(pixel + 1, edges[1:]) - np.maximum(pixel, edges[:-1])
    return first, covered.clip(0, 1)


def _letter(paper: NDArray[np.uint8], text: Text, per_mm: float) -> None:
    """Write in OpenCV's font, whose capitals are 21 units high: 0.7 of the em."""
    scale = 0.7 * text.height_mm * per_mm / 21
    origin = (round(text.x_mm * per_mm), round(text.y_mm * per_mm))
    thickness = max(1, round(0.08 * text.height_mm * per_mm))
    cv2.putText(
        paper, text.text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, (0,), thickness, cv2.LINE_AA
    )


def _outlines(raster: SheetRaster) -> Iterator[list[tuple[float, float]]]:
    """Closed outlines of the black cells, mm; holes run the other way round."""
    rows, columns = raster.cells.shape
    edges = _boundary(raster.cells)
    while edges:
        start = point = next(iter(edges))
        loop = []
        while True:
            loop.append(point)
            ends = edges[point]
            following = ends.pop()
            if not ends:
                del edges[point]
            point = following
            if point == start:
                break
        yield [
            (
                raster.x_mm + x * raster.width_mm / columns,
                raster.y_mm + y * raster.height_mm / rows,
            )
            for x, y in _turns(loop)
        ]


def _boundary(cells: Cells) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Edges between black and white by their first end, black to the right of them."""
    grid = np.pad(cells, 1)
    edges = defaultdict(list)
    for y, x in np.argwhere(cells).tolist():
        if not grid[y, x + 1]:
            edges[x, y].append((x + 1, y))
        if not grid[y + 1, x + 2]:
            edges[x + 1, y].append((x + 1, y + 1))
        if not grid[y + 2, x + 1]:
            edges[x + 1, y + 1].append((x, y + 1))
        if not grid[y + 1, x]:
            edges[x, y + 1].append((x, y))
    return edges


def _turns(loop: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The points of a closed loop at which it turns."""
    previous, following = [loop[-1], *loop[:-1]], [*loop[1:], loop[0]]
    return [
        point
        for point, (px, py), (nx, ny) in zip(loop, previous, following, strict=True)
        if px != nx and py != ny
    ]


def _mm(value: float) -> str:
    return f"{value:.5f}".rstrip("0").rstrip(".")
