"""Light that a lens throws farther than a Gaussian, or nearer: shares of wider blurs of the same drawing.

Wings of a lens, a disc out of focus and dirt on a window are no Gaussian. Beside large white paper their
light moves all outer edges alike, which no blur, bloom or scatter of the sides explains. So the share of
white of a pixel is T + sum of v_i (T_i - T), T_i: the drawing blurred once more; the v_i are unknowns. Numbers
in comments are the equations of docs/photometric.md.
"""

import math

import cv2
import numpy as np

from vgrd.geometry import Array
from vgrd.vision.alignment.gathering import Cells, local_map
from vgrd.vision.alignment.raster_lines import line_table, strip_around
from vgrd.vision.images.compiling import compiled
from vgrd.vision.images.homography import inverse
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster

WIDTHS = (2.0, 4.0, 8.0)  # of the blurs in units of the first one: octaves
_RIM = 2.0  # of the widest blur, around the pixels; what lies farther out has 5 % of it
_BLOCK = 8  # px that are mapped linearly, as `gather` maps 16


def no_veils(pixels: int) -> Array:
    """The differences (n, 0) of a model without veils."""
    return np.zeros((pixels, 0))


def veils_at(
    frame: LocalFrame,
    raster: Raster,
    q_from_target: Array,
    pixel: Cells,
    share: Array,
    sigma: float,
) -> Array:
    """Differences (n, 3), T_i - T, at pixels (n, 2), column and row, whose share of white T (n,) is known.

    sigma: of the first blur, px. Paper beyond the raster is as white as its rim.
    """
    rim = math.ceil(_RIM * WIDTHS[-1] * sigma)
    low, high = pixel.min(0) - rim, pixel.max(0) + rim + 1
    drawn = _drawn(
        frame.lens,
        frame.r0,
        frame.F,
        inverse(q_from_target),
        raster.x,
        raster.y,
        raster.cells,
        low[0],
        low[1],
        (high[1] - low[1], high[0] - low[0]),
    )
    column, row = (pixel - low).T
    drawn[row, column] = share
    veils = [
        cv2.GaussianBlur(drawn, (0, 0), width * sigma, borderType=cv2.BORDER_REPLICATE)[
            row, column
        ]
        for width in WIDTHS
    ]
    return np.column_stack(veils) - share[:, None]


@compiled
def _drawn(
    lens: Array,
    r0: Array,
    F: Array,
    Hi: Array,
    x: Array,
    y: Array,
    cells: Array,
    left: int,
    top: int,
    shape: tuple[int, int],
) -> Array:
    """The raster's share of white at the middles of pixels (height, width), without any blur."""
    isotropic = np.array([1.0, 0.0, 1.0])
    U, V = line_table(Hi, x, 0, isotropic), line_table(Hi, y, 1, isotropic)
    rows, columns = cells.shape
    drawn = np.empty(shape)
    for top_of in range(0, shape[0], _BLOCK):
        for left_of in range(0, shape[1], _BLOCK):
            middle = 0.5 * (_BLOCK - 1)
            qx, qy, a, b, c, d = local_map(
                lens, r0, F, left + left_of + middle, top + top_of + middle
            )
            ku, kv = columns // 2, rows // 2
            for j in range(top_of, min(top_of + _BLOCK, shape[0])):
                for i in range(left_of, min(left_of + _BLOCK, shape[1])):
                    dx, dy = i - left_of - middle, j - top_of - middle
                    at_x, at_y = qx + a * dx + b * dy, qy + c * dx + d * dy
                    ku, _, _ = strip_around(U, at_x, at_y, ku)
                    kv, _, _ = strip_around(V, at_x, at_y, kv)
                    ku, kv = min(max(ku, 0), columns - 1), min(max(kv, 0), rows - 1)
                    drawn[j, i] = cells[kv, ku]
    return drawn
