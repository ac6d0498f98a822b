"""Exact drawing on planes: the share of white in every pixel, through perspective, distortion and blur.

A picture is cut into blocks of a few pixels. Rays are exact at the corners of a block and bilinear
inside it; there a straight line of the plane is a straight line, and the share of a sample's box on
either side of it has a closed form. So few samples are enough: with four per pixel and axis
at a blur of 0.7 px an edge is where it should be to 2e-4 px even along a column of pixels
(tests/world/test_render_accuracy.py).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from fakes.camera.blur import Blur
from fakes.camera.patterns import Disc, Figure, Pattern
from fakes.camera.sensor import BLOCK, PixelRegion, Plane
from fakes.world.optics import Optics
from vgrd.geometry import Array, Pose

_SMALLER_BLOCKS = (4, 2, 1)  # px, the largest first: fewer blocks are faster
_LINES = 2  # of each direction, that a block can hold
_CORNER_SPLIT = 12  # a box with a corner in it is cut into so many, squared


def coverage(
    camera: Optics, camera_from_plane: Pose, figure: Figure, region: PixelRegion, blur: Blur
) -> Plane:
    """Share of white (height, width) that each pixel of a region receives from a figure on a plane.

    Area-accurate, blur included; the region's sides are whole blocks (`BLOCK`). Lines that
    are closer than a pixel are only hinted at.
    """
    pad = blur.reach_px
    samples = blur.samples
    wide_region = PixelRegion(
        region.x - pad, region.y - pad, region.width + 2 * pad, region.height + 2 * pad
    )
    fine = blur(_fine_shares(camera, camera_from_plane, figure, wide_region, samples), samples)
    cut = pad * samples
    inner = fine[cut:-cut, cut:-cut]
    return np.asarray(
        cv2.resize(inner, (region.width, region.height), interpolation=cv2.INTER_AREA)
    )


def _fine_shares(
    camera: Optics, camera_from_plane: Pose, figure: Figure, region: PixelRegion, samples: int
) -> Plane:
    """Shares of white (height * samples, width * samples) of the boxes of all samples."""
    drawn: _PatternBlocks | _DiscBlocks
    if isinstance(figure, Disc):
        block = BLOCK
        corners = _on_plane(camera, camera_from_plane, region, block)
        drawn = _DiscBlocks(figure, _four(corners))
    else:
        for block in _SMALLER_BLOCKS:
            corners = _on_plane(camera, camera_from_plane, region, block)
            drawn = _PatternBlocks(figure, _four(corners))
            if drawn.most_lines <= _LINES:
                break
    side = samples * block
    rows, columns = drawn.even.shape
    fine = np.repeat(np.repeat(drawn.even, side, 0), side, 1)
    blocks = fine.reshape(rows, side, columns, side).transpose(0, 2, 1, 3)
    blocks[drawn.mixed] = drawn.mixed_shares(side)
    return fine


def _on_plane(camera: Optics, camera_from_plane: Pose, region: PixelRegion, block: int) -> Array:
    """Homogeneous points (rows + 1, columns + 1, 3) of the plane at the corners of the blocks, mm."""
    x = region.x - 0.5 + block * np.arange(region.width // block + 1)
    y = region.y - 0.5 + block * np.arange(region.height // block + 1)
    rays = camera.rays(np.stack(np.meshgrid(x, y), -1))
    R, t = camera_from_plane.rotation, camera_from_plane.translation
    plane_from_ray = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    return np.asarray(rays @ plane_from_ray[:, :2].T + plane_from_ray[:, 2])


def _four(corners: Array) -> Array:
    """The corners (4, rows, columns, 3) of every block: top left, top right, bottom left, bottom right."""
    return np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]])


class _PatternBlocks:
    """Which fields of a pattern are in which block; `four` (4, rows, columns, 3): its corners.

    At most two lines of each direction count, so a block holds 3 x 3 fields or fewer. even (rows,
    columns): the white of blocks that hold one field; mixed: the others.
    """

    def __init__(self, pattern: Pattern, four: Array) -> None:
        xy = four[..., :2] / four[..., 2:]
        low, high = xy.min(0), xy.max(0)
        column, self.x_mm = _crossing(pattern.x_mm, low[..., 0], high[..., 0])
        row, self.y_mm = _crossing(pattern.y_mm, low[..., 1], high[..., 1])
        self.most_lines = int(max(np.ptp(column, axis=-1).max(), np.ptp(row, axis=-1).max()))
        self.even = pattern.white[row[..., 0], column[..., 0]]
        fields = pattern.white[row[..., :, None], column[..., None, :]]
        self.mixed = (fields != self.even[..., None, None]).any((-2, -1))
        self._four = four[:, self.mixed]
        self._fields = fields[self.mixed]
        self._lines = self.x_mm[self.mixed], self.y_mm[self.mixed]

    def mixed_shares(self, side: int) -> Plane:
        """Shares (n, side, side) of all samples of the mixed blocks."""
        return _field_shares(self._four, self._lines, self._fields, side)


def _crossing(lines: Array, low: Array, high: Array) -> tuple[NDArray[np.intp], Array]:
    """Fields (..., 3) and lines (..., 2) between two coordinates: the first line and the last."""
    first, last = np.searchsorted(lines, low), np.searchsorted(lines, high)
    middle = np.minimum(first + 1, last)
    two = np.stack([first, np.maximum(last - 1, first)], -1)
    return np.stack([first, middle, last], -1), lines[np.minimum(two, len(lines) - 1)]


def _field_shares(
    four: Array, lines: tuple[Array, Array], fields: Plane, side: int, *, split: bool = True
) -> Plane:
    """Shares (n, side, side) of white in boxes, from the corners (4, n, 3) of the blocks.

    lines: x and y (n, 2) mm; fields (n, 3, 3) between them. A box that holds a corner of fields is
    split into smaller ones, because there the product of two shares is not the share of both.
    """
    right, below = (_beyond_lines(four, axis, lines[axis], side) for axis in (0, 1))
    steps = np.diff(fields, axis=2)
    rows = [
        fields[:, i, 0, None, None]
        + right[0] * steps[:, i, 0, None, None]
        + right[1] * steps[:, i, 1, None, None]
        for i in range(3)
    ]
    shares = rows[0] + below[0] * (rows[1] - rows[0]) + below[1] * (rows[2] - rows[1])
    if not split:
        return np.asarray(shares)
    twisted = (np.diff(steps, axis=1) != 0).any((1, 2))
    cut = [(a > 0) & (a < 1) | (b > 0) & (b < 1) for a, b in (right, below)]
    block, i, j = np.nonzero(cut[0] & cut[1] & twisted[:, None, None])
    if block.size:
        boxes = _boxes(four[:, block], i, j, side)
        line_pairs = lines[0][block], lines[1][block]
        finer = _field_shares(boxes, line_pairs, fields[block], _CORNER_SPLIT, split=False)
        shares[block, i, j] = finer.mean((1, 2))
    return np.asarray(shares)


def _beyond_lines(four: Array, axis: int, lines: Array, side: int) -> list[Plane]:
    """Shares (n, side, side) of the boxes beyond each of two lines (n, 2) across an axis."""
    offsets = [four[..., axis] - line * four[..., 2] for line in lines.T]
    first = _half_plane(offsets[0], side)
    one_line = np.array_equal(lines[:, 0], lines[:, 1])
    return [first, first if one_line else _half_plane(offsets[1], side)]


def _boxes(four: Array, i: NDArray[np.intp], j: NDArray[np.intp], side: int) -> Array:
    """Corners (4, n, 3) of the sample boxes in row i and column j of their blocks (4, n, 3)."""
    corners = [
        np.einsum("cn,cnk->nk", _bilinear((j + right) / side, (i + below) / side), four)
        for below in (0, 1)
        for right in (0, 1)
    ]
    return np.stack(corners)


def _bilinear(x: Array, y: Array) -> Array:
    """Weights (4, ...) of the corners of a block at a place in it, 0 to 1."""
    return np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])


def _grid(side: int) -> Array:
    """Weights (4, side * side) of a block's corners at the centres of its samples."""
    centres = (np.arange(side) + 0.5) / side
    x, y = np.meshgrid(centres, centres)
    return _bilinear(x.ravel(), y.ravel())


def _half_plane(four: Array, side: int) -> Plane:
    """Share (n, side, side) of each box in which a function is positive, from its corner values (4, n)."""
    step_x = (four[1] - four[0] + four[3] - four[2]) / (2 * side)
    step_y = (four[2] - four[0] + four[3] - four[1]) / (2 * side)
    steep, flat = np.abs(step_x), np.abs(step_y)
    steep, flat = np.maximum(steep, flat), np.minimum(steep, flat)
    distance = ((four / steep).T @ _grid(side)).astype(np.float32)
    slant = (flat / steep).astype(np.float32)[:, None]
    return _positive_share(distance, slant).reshape(-1, side, side)


def _positive_share(distance: Plane, slant: Plane) -> Plane:
    """Share of a unit box on the positive side of a line.

    distance: of the centre from the line, along the axis that is nearer to the line's normal;
    slant: smaller over larger component of the normal, 0 to 1.
    """
    reach = np.maximum((1 + slant) / 2 - np.abs(distance), 0)
    corner = np.minimum(reach, slant)
    missing = reach - corner + corner * corner / (2 * np.maximum(slant, np.float32(1e-12)))
    return np.asarray(np.where(distance > 0, 1 - missing, missing))


class _DiscBlocks:
    """Which blocks the rim of a disc crosses; as `_PatternBlocks`."""

    def __init__(self, disc: Disc, four: Array) -> None:
        self._disc = disc
        xy = four[..., :2] / four[..., 2:]
        distances = np.linalg.norm(xy - disc.centre_mm, axis=-1) - disc.radius_mm
        size = np.ptp(distances, axis=0).max()
        self.mixed = np.abs(distances).min(0) < size
        self.even = np.where(distances[0] > 0, disc.outside, disc.inside).astype(np.float32)
        self._four = four[:, self.mixed]

    def mixed_shares(self, side: int) -> Plane:
        """Shares (n, side, side); the rim is a straight line in a box, moved by its mean bend."""
        four, disc = self._four, self._disc
        grid = _grid(side)
        X, Y, W = (four[..., axis].T @ grid for axis in range(3))
        x, y = X / W, Y / W
        out_x, out_y = x - disc.centre_mm[0], y - disc.centre_mm[1]
        radius = np.hypot(out_x, out_y)
        out_x, out_y = out_x / radius, out_y / radius
        along_x = (four[1] - four[0] + four[3] - four[2]) / (2 * side)
        along_y = (four[2] - four[0] + four[3] - four[1]) / (2 * side)
        slopes, bends = [], np.zeros_like(radius)
        for step_x, step_y, step_w in (along_x.T[..., None], along_y.T[..., None]):
            dx, dy = (step_x - x * step_w) / W, (step_y - y * step_w) / W
            slope = out_x * dx + out_y * dy
            bends += dx * dx + dy * dy - slope * slope
            slopes.append(np.abs(slope))
        steep, flat = np.maximum(*slopes), np.minimum(*slopes)
        distance = (radius + bends / (24 * radius) - disc.radius_mm) / steep
        share = _positive_share(distance.astype(np.float32), (flat / steep).astype(np.float32))
        white = disc.inside + (disc.outside - disc.inside) * share
        return np.asarray(white, np.float32).reshape(-1, side, side)
