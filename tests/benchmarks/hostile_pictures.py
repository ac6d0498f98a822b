"""Pictures that no camera should send, through both tag finders, in a process that may die of them.

`python -m tests.benchmarks.hostile_pictures COUNT [--first N] [--photos FOLDER]` writes the number of each
picture before it is searched; the last number of a process that crashed names the picture.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from vgrd.model import TagSpec
from vgrd.vision.images.pictures import SUFFIXES, as_8_bit, read_picture
from vgrd.vision.print.codes import marker_cells
from vgrd.vision.tags.detection import find_tags, search_tags, tags_within
from vgrd.vision.tags.tag_finder import TagDetector

FAMILIES = ("36h11", "25h9", "16h5", "4x4_50")
CAMERA_PX = (320, 240)
HUGE_PX = (3036, 4024)
HUGE_EVERY = 500  # a thorough search of 12 MP takes seconds
Pixels = np.ndarray
Rng = np.random.Generator


def picture(number: int, photos: list[Pixels]) -> Pixels:
    """Grey picture, uint8 or uint16, of any strides; the same number gives the same picture."""
    rng = np.random.default_rng((number, 29))
    if number % HUGE_EVERY == HUGE_EVERY - 1:
        return _huge(rng)
    kinds = (_noise, _stripes, _extreme, _tags, _quads, *([_photo(photos)] if photos else []))
    return _stored(rng, kinds[number % len(kinds)](rng))


def _size(rng: Rng, most: int = 400) -> tuple[int, int]:
    """Height and width, small ones as often as large ones."""
    height, width = np.exp(rng.uniform(0, np.log(most), 2)).astype(int) + 1
    return int(height), int(width)


def _noise(rng: Rng) -> Pixels:
    size = _size(rng)
    grey = rng.integers(0, 256, size)
    if rng.random() < 0.3:  # salt and pepper
        grey = np.where(rng.random(size) < 0.5, 0, 255)
    if rng.random() < 0.3:  # in blocks, whose edges the finders follow
        block = int(rng.integers(2, 12))
        grey = np.kron(grey, np.ones((block, block)))[:400, :400]
    return grey.astype(np.uint8)


def _stripes(rng: Rng) -> Pixels:
    y, x = np.indices(_size(rng))
    angle, period = rng.choice([0, 0.25, 0.5, rng.random()]) * np.pi, rng.uniform(2, 40)
    along = np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
    if rng.random() < 0.5:
        along *= np.sin(2 * np.pi * (x * np.sin(angle) - y * np.cos(angle)) / period)
    level = np.sign(along) if rng.random() < 0.7 else along
    return (127.5 + 127.4 * level).astype(np.uint8)


def _extreme(rng: Rng) -> Pixels:
    sizes = [(1, 1), (1, 2), (2, 1), (3, 3), (1, 5000), (5000, 1), (2, 9000), (16, 16), (4, 1301)]
    size = sizes[int(rng.integers(len(sizes)))] if rng.random() < 0.6 else _size(rng)
    grey = np.full(size, rng.choice([0, 255, 127, 1]), np.uint8)
    if rng.random() < 0.5:  # a single pixel, row or column differs
        row, column = rng.integers(size[0]), rng.integers(size[1])
        places = [(row, column), (row, slice(None)), (slice(None), column)]
        grey[places[int(rng.integers(3))]] = rng.integers(256)
    return grey


def _tags(rng: Rng) -> Pixels:
    """Tags, warped until they are lines, overlapping, cut by the rim, damaged."""
    canvas = np.full(_size(rng), rng.integers(60, 256), np.uint8)
    height, width = canvas.shape
    for _ in range(int(rng.integers(1, 5))):
        code = np.pad(
            marker_cells(str(rng.choice(FAMILIES)), int(rng.integers(4))), 1, constant_values=1
        )
        if rng.random() < 0.3:
            code = np.where(rng.random(code.shape) < 0.05, 1 - code, code)
        cells = np.kron(code * 220 + 10, np.ones((8, 8))).astype(np.uint8)
        side = len(cells)
        corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32)
        spread = rng.choice([0.02, 0.2, 0.7])
        middle = rng.uniform(-0.2, 1.2, 2) * (width, height)
        size = np.exp(rng.uniform(np.log(4), np.log(300)))
        onto = middle + (corners / side - 0.5 + rng.normal(0, spread, (4, 2))) * size
        warp = cv2.getPerspectiveTransform(corners, onto.astype(np.float32))
        drawn = cv2.warpPerspective(cells, warp, (width, height), flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.ones_like(cells), warp, (width, height))
        canvas = np.where(inside > 0, drawn, canvas)
    return canvas


def _quads(rng: Rng) -> Pixels:
    """Black quadrangles on white, some of them degenerate."""
    height, width = _size(rng)
    canvas = np.full((height, width), 255, np.uint8)
    for _ in range(int(rng.integers(1, 60))):
        quad = rng.integers(-20, [width + 20, height + 20], (4, 2)).astype(np.int32)
        if rng.random() < 0.2:
            quad[3] = quad[int(rng.integers(3))]
        cv2.fillPoly(canvas, [quad], float(rng.integers(256)))
    return canvas


def _photo(photos: list[Pixels]) -> Callable[[Rng], Pixels]:
    def crop(rng: Rng) -> Pixels:
        whole = photos[int(rng.integers(len(photos)))]
        height, width = (int(rng.integers(1, min(n, 500) + 1)) for n in whole.shape)
        y, x = (
            int(rng.integers(n - m + 1)) for n, m in zip(whole.shape, (height, width), strict=True)
        )
        part = whole[y : y + height, x : x + width]
        if rng.random() < 0.3:
            part = cv2.GaussianBlur(part, (0, 0), rng.uniform(0.3, 4))
        if rng.random() < 0.3:
            part = np.clip(part * rng.uniform(0.2, 4) - rng.uniform(0, 100), 0, 255)
        return np.asarray(part, np.uint8)

    return crop


def _huge(rng: Rng) -> Pixels:
    way = int(rng.integers(3))
    if way == 0:
        return np.full(HUGE_PX, rng.choice([0, 255]), np.uint8)
    if way == 1:
        return rng.integers(0, 256, HUGE_PX, dtype=np.uint8)
    return np.tile(_tags(rng), (40, 40))[: HUGE_PX[0], : HUGE_PX[1]]


def _stored(rng: Rng, grey: Pixels) -> Pixels:
    """The same levels, in memory as some camera or caller may hold them."""
    way = int(rng.integers(7))
    if way == 0:
        return np.asfortranarray(grey)
    if way == 1:
        return grey[::-1, ::-1]
    if way == 2:
        return np.repeat(np.repeat(grey, 2, 0), 3, 1)[::2, ::3]
    if way == 3:
        framed = np.pad(grey, 7)
        return framed[7:-7, 7:-7]
    if way == 4:
        return grey.astype(np.uint16) * int(rng.choice([1, 16, 257]))
    if way == 5:
        grey = grey.copy()
        grey.flags.writeable = False
    return grey


def search(pixels: Pixels, rng: Rng) -> None:
    """Both ways to look: thoroughly, as the tools do, and fast, as the cell does."""
    grey = as_8_bit(pixels)
    families = rng.choice(
        FAMILIES, 1 if pixels.size > 1e6 else int(rng.integers(1, 5)), replace=False
    )
    find_tags(grey, [str(family) for family in families], max_hamming=2)
    wanted = {("36h11", 0), ("16h5", 1)}
    search_tags(np.ascontiguousarray(grey), wanted)
    around = rng.uniform(-50, 1.2 * max(grey.shape), (4, 2))
    tags_within(np.ascontiguousarray(grey), wanted, around, rng.uniform(0, 2))


class Served:
    """The cell's detector, which remembers where tags were and gets another picture every time."""

    def __init__(self) -> None:
        matrix = np.array([[900.0, 0, 160], [0, 900, 120], [0, 0, 1]])
        tags = [TagSpec("36h11", 0, 10.0), TagSpec("16h5", 1, 10.0)]
        self.detector = TagDetector(matrix, np.array([-0.08, 0.1, 0.0, 0.0]), tags, CAMERA_PX)
        self.last = {}

    def search(self, pixels: Pixels) -> None:
        """Detect in a picture of the camera's size, filled up or cut to it."""
        height, width = CAMERA_PX[1], CAMERA_PX[0]
        if pixels.shape[0] <= 2000 and pixels.shape[1] <= 2000:
            missing = [
                (0, max(n - m, 0)) for n, m in zip((height, width), pixels.shape, strict=True)
            ]
            pixels = np.pad(pixels, missing, mode="edge")
        if pixels.shape[0] >= height and pixels.shape[1] >= width:
            self.last |= self.detector.detect(pixels[:height, :width], self.last)


def photographs(folder: Path | None) -> Iterator[Pixels]:
    """All pictures below a folder; none where it does not exist."""
    for path in sorted(folder.rglob("*") if folder and folder.is_dir() else ()):
        if path.suffix in SUFFIXES:
            yield as_8_bit(read_picture(path).pixels)


def main() -> None:
    """Search them all."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.hostile_pictures")
    parser.add_argument("count", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--photos", type=Path)
    asked = parser.parse_args()
    photos = list(photographs(asked.photos))
    served = Served()
    for number in range(asked.first, asked.count):
        os.write(1, f"{number}\n".encode())
        pixels = picture(number, photos)
        search(pixels, np.random.default_rng((number, 31)))
        served.search(pixels)
    served.detector.close()


if __name__ == "__main__":
    main()
