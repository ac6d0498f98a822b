"""Compiled choice of the pixels that a raster is fitted to: all near its edges, some of the flat ones.

Numbers in comments are the equations of docs/photometric.md.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.raster_lines import distance, line_table, strip_around
from vgrd.vision.images.compiling import compiled, inlined
from vgrd.vision.images.warp import pixel_at, q_at, ray, slopes

Cells = NDArray[np.intp]

_BLOCK = 16  # px: judged as a whole first, and mapped linearly to q; (2) removes what that misses
_PART = 4  # px: judged next; 16 flat pixels tell no more of the light's slope than one of them
_PAPER_PX = 2.0  # paper beyond the outer edges' reach: a few flat pixels of white, no clutter
_RIM_SHARE = 0.4  # of the outermost cell, left out at its outer side where it is narrow
_AWAY, _FLAT, _MIXED = 0, 1, 2  # what `_kind` says of a square
_TO_CORNER = math.sqrt(0.5)  # of a square's side


@compiled
def gather(
    picture: Grey,
    lens: Array,
    r0: Array,
    F: Array,
    H: Array,
    Hi: Array,
    raster: tuple[Array, Array, Array],
    reach: float,
) -> tuple[Array, Array, Cells, Cells, int, int, Array]:
    """Choose the pixels of a target: all within `reach` px of an edge, then one flat one per part.

    raster: x lines, y lines, cells. Returns q (n, 2), level (n,), cell (n, 2) and pixel (n, 2) as (column, row), the
    number of edge pixels, the number of pixels that would lie outside the picture, and for the noise
    (m, 3) of flat pixels: colour, level, second difference along the row.
    """
    x, y, cells = raster
    isotropic = np.array([1.0, 0.0, 1.0])
    U, V = line_table(Hi, x, 0, isotropic), line_table(Hi, y, 1, isotropic)
    left, top, right, bottom = _bounds(lens, r0, F, H, x, y, picture.shape)
    room = max(right - left + _BLOCK, 0) * max(bottom - top + _BLOCK, 0)
    rough_q, spot = np.empty((room, 2)), np.empty((room, 4), np.intp)
    flat = np.empty(room, np.intp)
    count = 0
    for block_y in range(top, bottom, _BLOCK):
        for block_x in range(left, right, _BLOCK):
            middle_x, middle_y = block_x + 0.5 * (_BLOCK - 1), block_y + 0.5 * (_BLOCK - 1)
            local = local_map(lens, r0, F, middle_x, middle_y)
            kind = _kind(U, V, cells, local[0], local[1], _TO_CORNER * (_BLOCK - 1) + reach)
            if kind == _AWAY:
                continue
            for py in range(block_y, block_y + _BLOCK, _PART):
                for px in range(block_x, block_x + _BLOCK, _PART):
                    dx = px + 0.5 * (_PART - 1) - block_x - 0.5 * (_BLOCK - 1)
                    dy = py + 0.5 * (_PART - 1) - block_y - 0.5 * (_BLOCK - 1)
                    qx = local[0] + local[2] * dx + local[3] * dy
                    qy = local[1] + local[4] * dx + local[5] * dy
                    part_kind = kind
                    if kind == _MIXED:
                        part_kind = _kind(U, V, cells, qx, qy, _TO_CORNER * (_PART - 1) + reach)
                    if part_kind != _AWAY:
                        part_map = (qx, qy, local[2], local[3], local[4], local[5])
                        is_flat = part_kind == _FLAT
                        count = _scan(
                            U,
                            V,
                            cells,
                            part_map,
                            px,
                            py,
                            is_flat,
                            reach,
                            rough_q,
                            spot,
                            flat,
                            count,
                        )
    return _read(picture, lens, r0, F, rough_q, spot, flat, count, cells)


@compiled
def _bounds(
    lens: Array, r0: Array, F: Array, H: Array, x: Array, y: Array, shape: tuple[int, int]
) -> tuple[int, int, int, int]:
    """Rectangle of pixels that holds the raster: left, top, right, bottom.

    At most one picture beyond the picture's own rim, so that a wild homography costs no memory.
    """
    Fi = np.asarray(np.linalg.inv(F), dtype=np.float64)
    low_x, low_y, high_x, high_y = 1e9, 1e9, -1e9, -1e9  # farther out than any picture's pixel
    for X in (x[0], x[-1]):
        for Y in (y[0], y[-1]):
            qx, qy = q_at(H, X, Y)
            px, py = pixel_at(lens, r0, Fi, qx, qy)
            low_x, high_x = min(low_x, px), max(high_x, px)
            low_y, high_y = min(low_y, py), max(high_y, py)
    height, width = shape
    return (
        math.floor(max(low_x, -1.0 * width)),
        math.floor(max(low_y, -1.0 * height)),
        math.ceil(min(high_x, 2.0 * width)),
        math.ceil(min(high_y, 2.0 * height)),
    )


@compiled
def local_map(
    lens: Array, r0: Array, F: Array, px: float, py: float
) -> tuple[float, float, float, float, float, float]:
    """Q at a pixel, and its derivative by the pixel, row by row."""
    x, y = ray(lens, px, py)
    a, b, c, d = slopes(lens, x, y)
    det = 1.0 / (a * d - b * c)
    return (
        F[0, 0] * (x - r0[0]) + F[0, 1] * (y - r0[1]),
        F[1, 0] * (x - r0[0]) + F[1, 1] * (y - r0[1]),
        (F[0, 0] * d - F[0, 1] * c) * det,
        (F[0, 1] * a - F[0, 0] * b) * det,
        (F[1, 0] * d - F[1, 1] * c) * det,
        (F[1, 1] * a - F[1, 0] * b) * det,
    )


@inlined
def _kind(U: Array, V: Array, cells: Array, qx: float, qy: float, radius: float) -> int:
    """Whether what lies within `radius` px of q is off the raster, of one colour, or mixed."""
    rows, columns = cells.shape
    ku, _, _ = strip_around(U, qx, qy, columns // 2)
    kv, _, _ = strip_around(V, qx, qy, rows // 2)
    if not (0 <= ku < columns and 0 <= kv < rows):
        for table in (U, V):
            first = table[0, 0] * qx + table[0, 1] * qy + table[0, 2]
            last = table[-1, 0] * qx + table[-1, 1] * qy + table[-1, 2]
            if first < -radius or last > radius:
                return _AWAY
        return _MIXED
    if distance(U, 0, qx, qy) < radius or -distance(U, columns, qx, qy) < radius:
        return _MIXED
    if distance(V, 0, qx, qy) < radius or -distance(V, rows, qx, qy) < radius:
        return _MIXED
    return _MIXED if _varies(U, V, cells, ku, kv, qx, qy, radius) else _FLAT


@inlined
def _scan(
    U: Array,
    V: Array,
    cells: Array,
    part_map: tuple[float, float, float, float, float, float],
    px: int,
    py: int,
    is_flat: bool,
    reach: float,
    rough_q: Array,
    spot: Cells,
    flat: NDArray[np.intp],
    count: int,
) -> int:
    """Add the pixels of one part to rough_q, spot and flat; returns how many they hold now.

    part_map: q of the part's middle and its derivative by the pixel. spot: (x, y, column, row). flat: 0
    near an edge, 1 for a flat pixel, 2 for the first pixel of a part that is all flat.
    """
    rows, columns = cells.shape
    ku, kv = columns // 2, rows // 2
    middle = 0.5 * (_PART - 1)
    side = 1 if is_flat else _PART
    for j in range(side):
        for i in range(side):
            dx, dy = i - middle, j - middle
            qx = part_map[0] + part_map[2] * dx + part_map[3] * dy
            qy = part_map[1] + part_map[4] * dx + part_map[5] * dy
            ku, left, right = strip_around(U, qx, qy, ku)
            kv, above, below = strip_around(V, qx, qy, kv)
            if not (0 <= ku < columns and 0 <= kv < rows):
                continue
            edge = not is_flat and _varies(U, V, cells, ku, kv, qx, qy, reach)  # 15
            if not edge and (i > 0 or j > 0):
                continue
            if _usable(ku, columns, left, right, reach) and _usable(kv, rows, above, below, reach):
                rough_q[count, 0], rough_q[count, 1] = qx, qy
                spot[count, 0], spot[count, 1] = px + i, py + j
                spot[count, 2], spot[count, 3] = ku, kv
                flat[count] = 0 if edge else 2 if is_flat else 1
                count += 1
    return count


@inlined
def _usable(k: int, strips: int, low: float, high: float, reach: float) -> bool:
    """Whether a pixel in strip k is far enough from the raster's rim, and not far out on the paper."""
    rim = min(reach, _RIM_SHARE * (low + high))
    if k == 0:
        return low > rim and high < reach + _PAPER_PX
    if k == strips - 1:
        return high > rim and low < reach + _PAPER_PX
    return True


@inlined
def _varies(
    U: Array, V: Array, cells: Array, ku: int, kv: int, qx: float, qy: float, radius: float
) -> bool:
    """Whether cells of different colour lie within `radius` px of q, which is in the cell (ku, kv).

    Where cells are small, more than the next ones do.
    """
    u0, u1 = _strips_within(U, ku, qx, qy, radius)
    v0, v1 = _strips_within(V, kv, qx, qy, radius)
    colour = cells[kv, ku]
    for v in range(v0, v1 + 1):
        for u in range(u0, u1 + 1):
            if cells[v, u] != colour:
                return True
    return False


@inlined
def _strips_within(table: Array, k: int, qx: float, qy: float, radius: float) -> tuple[int, int]:
    """First and last strip between lines that are within `radius` px of q, which is in strip k."""
    first, last = k, k
    while first > 0 and distance(table, first, qx, qy) < radius:
        first -= 1
    while last < len(table) - 2 and -distance(table, last + 1, qx, qy) < radius:
        last += 1
    return first, last


@compiled
def _read(
    picture: Grey,
    lens: Array,
    r0: Array,
    F: Array,
    rough_q: Array,
    spot: Cells,
    flat: NDArray[np.intp],
    count: int,
    cells: Array,
) -> tuple[Array, Array, Cells, Cells, int, int, Array]:
    """Levels and exact q of the chosen pixels, those near edges first; returns what `gather` does."""
    height, width = picture.shape
    Fi = np.asarray(np.linalg.inv(F), dtype=np.float64)
    q, level = np.empty((count, 2)), np.empty(count)
    cell, pixel = np.empty((count, 2), np.intp), np.empty((count, 2), np.intp)
    bends = np.empty((2 * _PART * count, 3))
    edges, total, lost, bend_count = 0, 0, 0, 0
    for is_flat_turn in (False, True):
        for i in range(count):
            if (flat[i] > 0) != is_flat_turn:
                continue
            px, py = spot[i, 0], spot[i, 1]
            if px < 0 or py < 0 or px >= width or py >= height:
                lost += 1
                continue
            x, y = rough_q[i, 0], rough_q[i, 1]
            u, v = pixel_at(lens, r0, Fi, x, y)
            q[total, 0], q[total, 1] = x + (px - u), y + (py - v)  # 2: q moves as pixels do
            level[total] = picture[py, px]
            cell[total, 0], cell[total, 1] = spot[i, 2], spot[i, 3]
            pixel[total, 0], pixel[total, 1] = px, py
            total += 1
            if is_flat_turn:
                colour = cells[spot[i, 3], spot[i, 2]]
                side = _PART if flat[i] > 1 else 1
                bend_count = _bend(picture, px, py, side, colour, bends, bend_count)
        if not is_flat_turn:
            edges = total
    chosen = (q[:total], level[:total], cell[:total], pixel[:total])
    return chosen[0], chosen[1], chosen[2], chosen[3], edges, lost, bends[:bend_count]


@compiled
def _bend(
    picture: Grey, px: int, py: int, side: int, colour: float, bends: Array, count: int
) -> int:
    """Add second differences along the rows of a flat square of pixels; returns how many there are now.

    Every second row, since rows of one light tell the same.
    """
    height, width = picture.shape
    first, last = (px, px + 1) if side == 1 else (px + 1, px + side - 1)
    if first < 1 or last >= width or py + side > height:
        return count
    for y in range(py, py + side, 2):
        for x in range(first, last):
            level = float(picture[y, x])
            bends[count, 0], bends[count, 1] = colour, level
            bends[count, 2] = float(picture[y, x - 1]) - 2 * level + float(picture[y, x + 1])
            count += 1
    return count
