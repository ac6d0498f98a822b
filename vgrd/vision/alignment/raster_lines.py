"""Compiled geometry of a raster's lines: where they run in q, how blurred they are, how they cross.

Numbers in comments are the equations of docs/photometric.md.
"""

import math

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.images.compiling import compiled, inlined

# With four points the share (7) is exact to 1e-5 for a correlation of 0.87 (lines 30 degrees
# apart), to 4e-4 for _MOST_CORRELATION.
_NODES = (  # of Gauss-Legendre on (0, 1)
    0.06943184420297371,
    0.33000947820757187,
    0.6699905217924281,
    0.9305681557970262,
)
_WEIGHTS = (  # idem
    0.17392742256872692,
    0.32607257743127307,
    0.32607257743127307,
    0.17392742256872692,
)
_PER_TURN = 0.15915494309189535  # 1 / (2 pi) of eq. 7
_LEAST_VARIANCE_PX2 = 0.01  # across a line: below that of a pixel's own square, 1/12
_MOST_CORRELATION = 0.98  # lines 11 degrees apart in a round blur: a square tilted by 84 degrees


@compiled
def line_table(Hi: Array, lines: Array, axis: int, S: Array) -> Array:
    """Lines (n, 8) in q: unit normal (2) and constant, so that n q + c is the signed distance in px.

    Then 1 / sigma across the line, the derivatives of log sigma by S (3), and what makes px of mm
    across the line (`scale_at`). Hi: plane from q, its last row positive in view; lines: their plane
    coordinates along `axis`.
    """
    table = np.empty((len(lines), 8))
    for k in range(len(lines)):
        a = Hi[axis, 0] - lines[k] * Hi[2, 0]  # 3
        b = Hi[axis, 1] - lines[k] * Hi[2, 1]
        c = Hi[axis, 2] - lines[k] * Hi[2, 2]
        norm = 1.0 / math.sqrt(a * a + b * b)
        a, b = a * norm, b * norm
        variance = S[0] * a * a + 2 * S[1] * a * b + S[2] * b * b  # 4
        variance = max(variance, _LEAST_VARIANCE_PX2)
        table[k, 0], table[k, 1], table[k, 2] = a, b, c * norm
        table[k, 3] = 1.0 / math.sqrt(variance)
        table[k, 4] = 0.5 * a * a / variance  # 4, the slopes
        table[k, 5] = a * b / variance
        table[k, 6] = 0.5 * b * b / variance
        table[k, 7] = norm
    return table


@compiled
def node_table(U: Array, V: Array, S: Array) -> Array:
    """Constants of every crossing of two lines, (columns, rows, 17).

    Correlation rho of the distances to both lines, 1 / sqrt(1 - rho^2), slopes (3) of rho by S; then
    sines, exponents and weights (4 each) of the integral of the bivariate density from 0 to rho.
    """
    table = np.empty((len(U), len(V), 17))
    for i in range(len(U)):
        for j in range(len(V)):
            a, b, c, d, both = U[i, 0], U[i, 1], V[j, 0], V[j, 1], U[i, 3] * V[j, 3]
            rho = (S[0] * a * c + S[1] * (a * d + b * c) + S[2] * b * d) * both
            rho = min(max(rho, -_MOST_CORRELATION), _MOST_CORRELATION)
            top = math.asin(rho)
            table[i, j, 0], table[i, j, 1] = rho, 1.0 / math.sqrt(1.0 - rho * rho)
            table[i, j, 2] = a * c * both - rho * (U[i, 4] + V[j, 4])  # 13, d rho / dS
            table[i, j, 3] = (a * d + b * c) * both - rho * (U[i, 5] + V[j, 5])
            table[i, j, 4] = b * d * both - rho * (U[i, 6] + V[j, 6])
            for m in range(4):
                s = math.sin(top * _NODES[m])  # 7
                table[i, j, 5 + m] = s
                table[i, j, 9 + m] = -0.5 / (1.0 - s * s)
                table[i, j, 13 + m] = _WEIGHTS[m] * top * _PER_TURN
    return table


@inlined
def strip_around(table: Array, qx: float, qy: float, start: int) -> tuple[int, float, float]:
    """Index of the strip between two lines that holds q, and the distances, px, to both.

    The index is -1 or the number of strips outside, where only one of the distances counts.
    """
    k, last = min(max(start, 0), len(table) - 2), len(table) - 1
    low, high = distance(table, k, qx, qy), -distance(table, k + 1, qx, qy)
    while low < 0 and k >= 0:
        k, high = k - 1, -low
        low = distance(table, k, qx, qy) if k >= 0 else 0.0
    while high <= 0 and k < last:
        k, low = k + 1, -high
        high = -distance(table, k + 1, qx, qy) if k < last else 0.0
    return k, low, high


@inlined
def distance(table: Array, k: int, qx: float, qy: float) -> float:
    """Signed distance, px, of q from a line."""
    return float(table[k, 0] * qx + table[k, 1] * qy + table[k, 2])


@inlined
def scale_at(Hi: Array, qx: float, qy: float) -> float:
    """What, times the last number of a line of `line_table`, is its px per mm near q (5a)."""
    return float(Hi[2, 0] * qx + Hi[2, 1] * qy + Hi[2, 2])
