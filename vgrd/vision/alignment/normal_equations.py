"""Compiled normal equations of the photometric fit.

Model of a pixel's level: gain(q) T(q) + offset(q). T is the share of white under a Gaussian of covariance S, px^2
(`vgrd.vision.alignment.edge_response`). The bloom moves every edge towards white: by as many pixels (gamma and
clipping do that), and by as many mm of the plane in x and in y (ink spread). Numbers in comments are the
equations of docs/photometric.md.

Parameters, in this order: 8 of the homography (motion of q / scale: (a b c, d e f, g h 0)), 3 of S
(xx, xy, yy), 3 of the bloom, then gain and offset as polynomials of q / scale (3 or 6 terms each), then
the shares of the veils (`vgrd.vision.alignment.veil`), 0 or 3.
"""

import math

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.alignment.edge_response import share
from vgrd.vision.alignment.gathering import Cells
from vgrd.vision.alignment.raster_lines import line_table, node_table, scale_at
from vgrd.vision.images.compiling import compiled, inlined

SHAPE, BLOOM, LIGHT = 8, 11, 14  # first index of each group of parameters
_BATCH = 128  # pixels whose derivatives, 29 rows at most, take 29 KiB: they stay in a cache of 32


@compiled
def accumulate(
    q: Array,
    level: Array,
    cell: Cells,
    edges: int,
    every: int,
    Hi: Array,
    x: Array,
    y: Array,
    cells: Array,
    scale: float,
    S: Array,
    bloom: Array,
    gain: Array,
    offset: Array,
    veils: Array,
    veil: Array,
    noise: Array,
    residual: Array,
    seen: Array,
) -> tuple[Array, Array, float, int]:
    """Normal equations of one Gauss-Newton step over every `every`-th sample.

    veils (n, k): of `veils_at`; veil (k,): their shares. noise: variance of a level is noise[0] level +
    noise[1]. residual (n,): filled with the residuals in
    standard deviations; seen (edges, 13) or (0, 13): with what `share` tells of the samples near
    edges, for `side_scores`. Returns A (p, p), g (p,), chi-square, number of samples.
    """
    terms = len(gain)
    parameters = LIGHT + 2 * terms + len(veil)
    U, V = line_table(Hi, x, 0, S), line_table(Hi, y, 1, S)
    nodes = node_table(U, V, S)
    A, g = np.zeros((parameters, parameters)), np.zeros(parameters)
    J, r, w = np.zeros((parameters, _BATCH)), np.zeros(_BATCH), np.zeros(_BATCH)
    slope, mono = np.zeros(12), np.ones(6)
    chi2, count, filled = 0.0, 0, 0
    for i in range(0, len(level), every):
        X, Y = q[i, 0] / scale, q[i, 1] / scale
        mono[1], mono[2] = X, Y
        mono[3], mono[4], mono[5] = X * X, X * Y, Y * Y
        bright, dark = 0.0, 0.0
        for m in range(terms):
            bright += gain[m] * mono[m]
            dark += offset[m] * mono[m]
        if i < edges:
            ku, kv = cell[i, 0], cell[i, 1]
            px_per_mm = scale_at(Hi, q[i, 0], q[i, 1])
            T = share(cells, ku, kv, q[i, 0], q[i, 1], U, V, nodes, bloom, px_per_mm, slope)
            if len(seen) > 0:
                seen[i, 12] = T
                for m in range(12):
                    seen[i, m] = slope[m]
        else:
            T = cells[cell[i, 1], cell[i, 0]]
            slope[:] = 0.0
        for m in range(len(veil)):
            T += veil[m] * veils[i, m]  # 8a
        _fill(J, filled, slope, mono, terms, T, bright, scale, veils[i])
        model = bright * T + dark  # 8
        weight = 1.0 / (noise[0] * max(model, 0.0) + noise[1])  # 16
        r[filled], w[filled] = level[i] - model, weight
        residual[i] = r[filled] * math.sqrt(weight)
        chi2 += residual[i] * residual[i]
        count += 1
        filled += 1
        if filled == _BATCH or i + every >= len(level):
            _add(A, g, J, r, w, filled)
            filled = 0
    for m in range(parameters):
        for n in range(m):
            A[n, m] = A[m, n]
    return A, g, chi2, count


@compiled
def side_scores(
    q: Array,
    cell: Cells,
    edges: int,
    Hi: Array,
    x: Array,
    y: Array,
    cells: Array,
    scale: float,
    gain: Array,
    offset: Array,
    veils: Array,
    veil: Array,
    noise: Array,
    residual: Array,
    seen: Array,
) -> tuple[Array, Array, Array]:
    """What the residuals say of each side of a cell: that it lies elsewhere by some mm.

    residual, seen: as `accumulate` filled them from all samples. A side is the part of a line between two
    others; those of x lines come first, line by line, then those of y lines. Returns the gradient (sides,)
    of the sides' places, the information (sides, sides) on them, and that (sides, p) which they share
    with the parameters.
    """
    terms = len(gain)
    rows, columns = cells.shape
    first_y = (columns + 1) * rows
    sides = first_y + (rows + 1) * columns
    round_blur = np.array([1.0, 0.0, 1.0])  # only the directions of the lines count here
    U, V = line_table(Hi, x, 0, round_blur), line_table(Hi, y, 1, round_blur)
    g, M = np.zeros(sides), np.zeros((sides, sides))
    B = np.zeros((sides, LIGHT + 2 * terms + len(veil)))
    J, mono = np.zeros((B.shape[1], 1)), np.ones(6)
    own, felt = np.zeros(4, np.intp), np.zeros(4)
    for i in range(edges):
        X, Y = q[i, 0] / scale, q[i, 1] / scale
        mono[1], mono[2] = X, Y
        mono[3], mono[4], mono[5] = X * X, X * Y, Y * Y
        bright, dark = 0.0, 0.0
        for m in range(terms):
            bright += gain[m] * mono[m]
            dark += offset[m] * mono[m]
        ku, kv = cell[i, 0], cell[i, 1]
        per_mm = scale_at(Hi, q[i, 0], q[i, 1])
        slope, T = seen[i], seen[i, 12]
        for m in range(len(veil)):
            T += veil[m] * veils[i, m]
        _fill(J, 0, slope, mono, terms, T, bright, scale, veils[i])
        weight = 1.0 / (noise[0] * max(bright * T + dark, 0.0) + noise[1])
        own[0], own[1] = ku * rows + kv, (ku + 1) * rows + kv
        own[2], own[3] = first_y + kv * columns + ku, first_y + (kv + 1) * columns + ku
        lines = (U[ku, 7], U[ku + 1, 7], V[kv, 7], V[kv + 1, 7])
        for k in range(4):
            felt[k] = -bright * slope[8 + k] * per_mm * lines[k]
        for k in range(4):
            if felt[k] == 0.0:
                continue
            side = own[k]
            g[side] += felt[k] * math.sqrt(weight) * residual[i]
            for m in range(len(J)):
                B[side, m] += weight * felt[k] * J[m, 0]
            for m in range(4):
                M[side, own[m]] += weight * felt[k] * felt[m]
    return g, M, B


@inlined
def _fill(
    J: Array,
    k: int,
    slope: Array,
    mono: Array,
    terms: int,
    T: float,
    bright: float,
    scale: float,
    veils: Array,
) -> None:
    """Derivatives of one level by all parameters, into column k."""
    X, Y = mono[1], mono[2]
    gx, gy = -bright * slope[0] * scale, -bright * slope[1] * scale  # 10
    J[0, k], J[1, k], J[2, k] = gx * X, gx * Y, gx  # 9
    J[3, k], J[4, k], J[5, k] = gy * X, gy * Y, gy
    pull = -(gx * X + gy * Y)
    J[6, k], J[7, k] = pull * X, pull * Y
    for m in range(LIGHT - SHAPE):
        J[SHAPE + m, k] = bright * slope[2 + m]
    for m in range(terms):
        J[LIGHT + m, k] = T * mono[m]
        J[LIGHT + terms + m, k] = mono[m]
    for m in range(len(veils)):
        J[LIGHT + 2 * terms + m, k] = bright * veils[m]


@compiled
def _add(A: Array, g: Array, J: Array, r: Array, w: Array, filled: int) -> None:
    """Add a batch to the lower half of the normal equations (17)."""
    weighted = np.empty(filled)
    for m in range(len(g)):
        total = 0.0
        for k in range(filled):
            weighted[k] = J[m, k] * w[k]
            total += weighted[k] * r[k]
        g[m] += total
        for n in range(m + 1):
            square = 0.0
            for k in range(filled):
                square += weighted[k] * J[n, k]
            A[m, n] += square
