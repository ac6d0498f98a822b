"""The compiled loops of the photometric fit: choose the pixels, predict their levels, sum the normal equations.

Model of a pixel's level: gain(q) T(q) + offset(q), T the share of white under a Gaussian of covariance S
(px^2). Of the cells' lines the two nearest in either direction count; where they cross, T is the
bivariate normal distribution, whose correlation the angle of the lines gives. A product of two error
functions instead errs by 0.02 px at 60 degrees. "Bloom" moves every edge towards white by as many
pixels: ink spread, gamma and clipping.

Parameters, in this order: 8 of the homography (motion of q / scale: (a b c, d e f, g h 0)), 3 of S
(xx, xy, yy), bloom, then gain and offset as polynomials of q / scale (3 or 6 terms each).
"""

import math

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array
from vgrd.vision.compiling import compiled
from vgrd.vision.warp import project, ray, slopes

Cells = NDArray[np.intp]
SHAPE, BLOOM, LIGHT = 8, 11, 12  # first index of each group of parameters
_BLOCK = 8  # px; blocks without an edge are passed over
_BATCH = 128  # samples whose derivatives are kept in the processor's cache
_NEAR = 4.2  # sigma beyond which an edge is not felt
_PAPER_PX = 2.0  # paper used beyond the reach of the outer edges
# Gauss-Legendre nodes and weights on (0, 1), four points
_NODES = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262)
_WEIGHTS = (0.17392742256872692, 0.32607257743127307, 0.32607257743127307, 0.17392742256872692)


@compiled
def line_table(Hi: Array, at: Array, axis: int, S: Array) -> Array:
    """Lines (n, 7) in q: unit normal (2) and constant, so that n q + c is the signed distance in px.

    Then 1 / sigma across the line and the derivatives of log sigma by S (3). Hi: plane from q, its
    last row positive in view; at: plane coordinates of the lines along `axis`.
    """
    table = np.empty((len(at), 7))
    for k in range(len(at)):
        a = Hi[axis, 0] - at[k] * Hi[2, 0]
        b = Hi[axis, 1] - at[k] * Hi[2, 1]
        c = Hi[axis, 2] - at[k] * Hi[2, 2]
        norm = 1.0 / math.sqrt(a * a + b * b)
        a, b = a * norm, b * norm
        variance = max(S[0] * a * a + 2 * S[1] * a * b + S[2] * b * b, 0.01)
        table[k, 0], table[k, 1], table[k, 2] = a, b, c * norm
        table[k, 3] = 1.0 / math.sqrt(variance)
        table[k, 4] = 0.5 * a * a / variance
        table[k, 5] = a * b / variance
        table[k, 6] = 0.5 * b * b / variance
    return table


@compiled
def _cell_of(table: Array, qx: float, qy: float, start: int) -> int:
    """Index of the strip between two lines that holds q; -1 and the number of strips outside."""
    k, last = min(max(start, 0), len(table) - 2), len(table) - 1
    while k >= 0 and table[k, 0] * qx + table[k, 1] * qy + table[k, 2] < 0:
        k -= 1
    while k < last and table[k + 1, 0] * qx + table[k + 1, 1] * qy + table[k + 1, 2] >= 0:
        k += 1
    return k


@compiled
def _gaps(table: Array, k: int, qx: float, qy: float) -> tuple[float, float]:
    """Distances, px, to the two lines of strip k, both positive inside."""
    low = table[k, 0] * qx + table[k, 1] * qy + table[k, 2]
    high = table[k + 1, 0] * qx + table[k + 1, 1] * qy + table[k + 1, 2]
    return low, -high


@compiled
def _usable(table: Array, k: int, low: float, high: float, reach: float) -> bool:
    """Whether a place is far enough from the rim of the raster, and not far out on the paper."""
    last = len(table) - 2
    if k < 0 or k > last:
        return False
    rim = min(reach, 0.4 * (low + high))
    if k == 0:
        return low > rim and high < reach + _PAPER_PX
    if k == last:
        return high > rim and low < reach + _PAPER_PX
    return True


@compiled
def _varies(cells: Array, ku: int, kv: int, near: tuple[bool, bool, bool, bool]) -> bool:
    """Whether cells of different colour lie within reach."""
    rows, columns = cells.shape
    here = cells[kv, ku]
    for v in range(kv - 1 if near[2] and kv > 0 else kv, min(kv + (2 if near[3] else 1), rows)):
        for u in range(
            ku - 1 if near[0] and ku > 0 else ku, min(ku + (2 if near[1] else 1), columns)
        ):
            if cells[v, u] != here:
                return True
    return False


@compiled
def gather(
    picture: NDArray[np.uint8],
    lens: Array,
    r0: Array,
    F: Array,
    H: Array,
    Hi: Array,
    x: Array,
    y: Array,
    cells: Array,
    reach: float,
    stride: int,
) -> tuple[Array, Array, Cells, int, int, Array]:
    """Choose the pixels of a target: all within `reach` px of an edge, then some of the flat ones.

    Returns q (n, 2), level (n,), cell (n, 2) as (column, row), the number of edge pixels, the number of
    places that lay outside the picture, and (m, 4) colour, mean level, noise variance (second differences
    along rows) and number of pixels of flat places.
    """
    height, width = picture.shape
    isotropic = np.array([1.0, 0.0, 1.0])
    U, V = line_table(Hi, x, 0, isotropic), line_table(Hi, y, 1, isotropic)
    Fi = np.linalg.inv(F)
    x0, y0, x1, y1 = 1e9, 1e9, -1e9, -1e9
    for X in (x[0], x[-1]):
        for Y in (y[0], y[-1]):
            w = H[2, 0] * X + H[2, 1] * Y + H[2, 2]
            qx = (H[0, 0] * X + H[0, 1] * Y + H[0, 2]) / w
            qy = (H[1, 0] * X + H[1, 1] * Y + H[1, 2]) / w
            px, py = project(
                lens, r0[0] + Fi[0, 0] * qx + Fi[0, 1] * qy, r0[1] + Fi[1, 0] * qx + Fi[1, 1] * qy
            )
            x0, x1, y0, y1 = min(x0, px), max(x1, px), min(y0, py), max(y1, py)
    left, top = math.floor(max(x0, -2.0 * width)), math.floor(max(y0, -2.0 * height))
    right, bottom = math.ceil(min(x1, 3.0 * width)), math.ceil(min(y1, 3.0 * height))
    room = max(0, right - left + _BLOCK) * max(0, bottom - top + _BLOCK)
    q, level = np.empty((room, 2)), np.empty(room)
    cell = np.empty((room, 2), np.intp)
    flat_q, flat_level = np.empty((room // 2 + 64, 2)), np.empty(room // 2 + 64)
    flat_cell = np.empty((room // 2 + 64, 2), np.intp)
    blocks = np.empty((room // _BLOCK**2 + 64, 4))
    edges, flats, lost, plain = 0, 0, 0, 0
    radius = 0.7072 * _BLOCK + reach
    ku, kv = 0, 0
    for by in range(top, bottom, _BLOCK):
        for bx in range(left, right, _BLOCK):
            cx, cy = bx + 0.5 * (_BLOCK - 1), by + 0.5 * (_BLOCK - 1)
            rx, ry = ray(lens, cx, cy)
            a, b, c, d = slopes(lens, rx, ry)
            det = 1.0 / (a * d - b * c)
            mxx = (F[0, 0] * d - F[0, 1] * c) * det
            mxy = (F[0, 1] * a - F[0, 0] * b) * det
            myx = (F[1, 0] * d - F[1, 1] * c) * det
            myy = (F[1, 1] * a - F[1, 0] * b) * det
            qcx = F[0, 0] * (rx - r0[0]) + F[0, 1] * (ry - r0[1])
            qcy = F[1, 0] * (rx - r0[0]) + F[1, 1] * (ry - r0[1])
            ku, kv = _cell_of(U, qcx, qcy, ku), _cell_of(V, qcx, qcy, kv)
            inside = 0 <= ku < len(x) - 1 and 0 <= kv < len(y) - 1
            if not inside:
                far = (
                    U[0, 0] * qcx + U[0, 1] * qcy + U[0, 2] < -radius
                    or U[-1, 0] * qcx + U[-1, 1] * qcy + U[-1, 2] > radius
                    or V[0, 0] * qcx + V[0, 1] * qcy + V[0, 2] < -radius
                    or V[-1, 0] * qcx + V[-1, 1] * qcy + V[-1, 2] > radius
                )
                if far:
                    continue
            step = 1
            if inside:
                l0, l1 = _gaps(U, ku, qcx, qcy)
                l2, l3 = _gaps(V, kv, qcx, qcy)
                near = (l0 < radius, l1 < radius, l2 < radius, l3 < radius)
                rim = (
                    (near[0] and ku == 0)
                    or (near[1] and ku == len(x) - 2)
                    or (near[2] and kv == 0)
                    or (near[3] and kv == len(y) - 2)
                )
                if not rim and not _varies(cells, ku, kv, near):
                    step = stride
            seen, bends, levels, colour = 0, 0.0, 0.0, -1.0
            for py in range(by, by + _BLOCK, step):
                run = 0
                for px in range(bx, bx + _BLOCK, step):
                    dx, dy = px - cx, py - cy
                    qx, qy = qcx + mxx * dx + mxy * dy, qcy + myx * dx + myy * dy
                    ku, kv = _cell_of(U, qx, qy, ku), _cell_of(V, qx, qy, kv)
                    if ku < 0 or kv < 0 or ku > len(x) - 2 or kv > len(y) - 2:
                        continue
                    l0, l1 = _gaps(U, ku, qx, qy)
                    l2, l3 = _gaps(V, kv, qx, qy)
                    if not (_usable(U, ku, l0, l1, reach) and _usable(V, kv, l2, l3, reach)):
                        continue
                    near = (l0 < reach, l1 < reach, l2 < reach, l3 < reach)
                    edge = step == 1 and _varies(cells, ku, kv, near)
                    visible = 1 <= px < width - 1 and 0 <= py < height
                    run = 0 if edge else run + 1
                    if cells[kv, ku] != colour:
                        colour, seen, bends, levels = cells[kv, ku], 0, 0.0, 0.0
                    if visible and (run > 2 or step > 1):
                        back = (
                            0 if step > 1 else 1
                        )  # the middle of three that are known to be flat
                        here = float(picture[py, px - back])
                        bend = (
                            float(picture[py, px - back - 1])
                            - 2 * here
                            + float(picture[py, px - back + 1])
                        )
                        seen, bends, levels = seen + 1, bends + bend * bend, levels + here
                    if not edge and ((px % stride) != 0 or (py % stride) != 0) and step == 1:
                        continue
                    if px < 0 or py < 0 or px >= width or py >= height:
                        lost += 1
                        continue
                    # one step of Newton's method makes the block's linear map exact
                    sx, sy = (
                        r0[0] + Fi[0, 0] * qx + Fi[0, 1] * qy,
                        r0[1] + Fi[1, 0] * qx + Fi[1, 1] * qy,
                    )
                    ex, ey = project(lens, sx, sy)
                    ex, ey = px - ex, py - ey
                    qx, qy = qx + mxx * ex + mxy * ey, qy + myx * ex + myy * ey
                    if edge:
                        q[edges, 0], q[edges, 1], level[edges] = qx, qy, picture[py, px]
                        cell[edges, 0], cell[edges, 1] = ku, kv
                        edges += 1
                    elif flats < len(flat_level):
                        flat_q[flats, 0], flat_q[flats, 1] = qx, qy
                        flat_level[flats] = picture[py, px]
                        flat_cell[flats, 0], flat_cell[flats, 1] = ku, kv
                        flats += 1
            if seen > 3 and plain < len(blocks):
                blocks[plain, 0], blocks[plain, 1] = colour, levels / seen
                blocks[plain, 2], blocks[plain, 3] = bends / (6 * seen), seen
                plain += 1
    total = edges + flats
    q[edges:total], level[edges:total] = flat_q[:flats], flat_level[:flats]
    cell[edges:total] = flat_cell[:flats]
    return q[:total], level[:total], cell[:total], edges, lost, blocks[:plain]


@compiled
def _normal(h: float) -> tuple[float, float]:
    """Distribution and density of the normal law (Abramowitz and Stegun 26.2.17, error 8e-8)."""
    if h > _NEAR:
        return 1.0, 0.0
    if h < -_NEAR:
        return 0.0, 0.0
    density = 0.3989422804014327 * math.exp(-0.5 * h * h)
    t = 1.0 / (1.0 + 0.2316419 * abs(h))
    tail = t * (
        0.31938153 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429)))
    )
    tail *= density
    return (1.0 - tail if h >= 0 else tail), density


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
            rho = min(max(rho, -0.98), 0.98)
            top = math.asin(rho)
            table[i, j, 0], table[i, j, 1] = rho, 1.0 / math.sqrt(1.0 - rho * rho)
            table[i, j, 2] = a * c * both - rho * (U[i, 4] + V[j, 4])
            table[i, j, 3] = (a * d + b * c) * both - rho * (U[i, 5] + V[j, 5])
            table[i, j, 4] = b * d * both - rho * (U[i, 6] + V[j, 6])
            for m in range(4):
                s = math.sin(top * _NODES[m])
                table[i, j, 5 + m] = s
                table[i, j, 9 + m] = -0.5 / (1.0 - s * s)
                table[i, j, 13 + m] = _WEIGHTS[m] * top * 0.15915494309189535
    return table


@compiled
def _step(here: float, before: float, after: float) -> float:
    """Step of colour over a line, in this row or, where it has none, in a row that is near."""
    if here != 0.0:
        return here
    return before if before != 0.0 else after


@compiled
def _share(
    cells: Array,
    ku: int,
    kv: int,
    qx: float,
    qy: float,
    U: Array,
    V: Array,
    nodes: Array,
    bloom: float,
    out: Array,
) -> float:
    """Share of white at q; out (6,): its derivatives by q (2), S (3) and bloom."""
    rows, columns = cells.shape
    u0, v0 = max(ku - 1, 0), max(kv - 1, 0)
    u2, v2 = min(ku + 1, columns - 1), min(kv + 1, rows - 1)
    dl = U[ku, 0] * qx + U[ku, 1] * qy + U[ku, 2]
    dr = U[ku + 1, 0] * qx + U[ku + 1, 1] * qy + U[ku + 1, 2]
    dt = V[kv, 0] * qx + V[kv, 1] * qy + V[kv, 2]
    db = V[kv + 1, 0] * qx + V[kv + 1, 1] * qy + V[kv + 1, 2]
    near_l, near_r = dl * U[ku, 3] < _NEAR, dr * U[ku + 1, 3] > -_NEAR
    near_t, near_b = dt * V[kv, 3] < _NEAR, db * V[kv + 1, 3] > -_NEAR
    a0, a1, a2 = cells[v0, u0], cells[v0, ku], cells[v0, u2]
    b0, b1, b2 = cells[kv, u0], cells[kv, ku], cells[kv, u2]
    c0, c1, c2 = cells[v2, u0], cells[v2, ku], cells[v2, u2]
    l0, l1, l2 = a1 - a0, b1 - b0, c1 - c0
    r0, r1, r2 = a2 - a1, b2 - b1, c2 - c1
    # The steps of colour give the direction of the bloom.
    sl, sr, st, sb = 0.0, 0.0, 0.0, 0.0
    if near_l:
        sl = _step(l1, l0 if near_t else 0.0, l2 if near_b else 0.0)
        dl -= bloom * sl
    if near_r:
        sr = _step(r1, r0 if near_t else 0.0, r2 if near_b else 0.0)
        dr -= bloom * sr
    if near_t:
        st = _step(b1 - a1, b0 - a0 if near_l else 0.0, b2 - a2 if near_r else 0.0)
        dt -= bloom * st
    if near_b:
        sb = _step(c1 - b1, c0 - b0 if near_l else 0.0, c2 - b2 if near_r else 0.0)
        db -= bloom * sb
    hl, hr, kt, kb = dl * U[ku, 3], dr * U[ku + 1, 3], dt * V[kv, 3], db * V[kv + 1, 3]
    Pl, fl = _normal(hl)
    Pr, fr = _normal(hr)
    Pt, ft = _normal(kt)
    Pb, fb = _normal(kb)
    t0 = a0 + l0 * Pl + r0 * Pr
    t1 = b0 + l1 * Pl + r1 * Pr
    t2 = c0 + l2 * Pl + r2 * Pr
    T = t0 + (t1 - t0) * Pt + (t2 - t1) * Pb
    gl = fl * (l0 + (l1 - l0) * Pt + (l2 - l1) * Pb)
    gr = fr * (r0 + (r1 - r0) * Pt + (r2 - r1) * Pb)
    gt, gb = ft * (t1 - t0), fb * (t2 - t1)
    for i in range(3):
        out[2 + i] = 0.0
    if (fl + fr) * (ft + fb) > 0.0:
        for node in range(4):
            if node == 0:
                K, h, k, F, G, f, g = l1 - l0, hl, kt, Pl, Pt, fl, ft
            elif node == 1:
                K, h, k, F, G, f, g = r1 - r0, hr, kt, Pr, Pt, fr, ft
            elif node == 2:
                K, h, k, F, G, f, g = l2 - l1, hl, kb, Pl, Pb, fl, fb
            else:
                K, h, k, F, G, f, g = r2 - r1, hr, kb, Pr, Pb, fr, fb
            if K == 0.0 or f == 0.0 or g == 0.0:
                continue
            N = nodes[ku + node % 2, kv + node // 2]
            rho, narrow, squares, product = N[0], N[1], h * h + k * k, 2.0 * h * k
            for m in range(4):
                T += K * N[13 + m] * math.exp((squares - product * N[5 + m]) * N[9 + m])
            turn = K * 0.15915494309189535 * narrow
            turn *= math.exp(-0.5 * narrow * narrow * (squares - product * rho))
            for m in range(3):
                out[2 + m] += turn * N[2 + m]
            more_h = K * f * (_normal((k - rho * h) * narrow)[0] - G)
            more_k = K * g * (_normal((h - rho * k) * narrow)[0] - F)
            if node == 0 or node == 2:
                gl += more_h
            else:
                gr += more_h
            if node < 2:
                gt += more_k
            else:
                gb += more_k
    wl, wr, wt, wb = gl * U[ku, 3], gr * U[ku + 1, 3], gt * V[kv, 3], gb * V[kv + 1, 3]
    out[0] = wl * U[ku, 0] + wr * U[ku + 1, 0] + wt * V[kv, 0] + wb * V[kv + 1, 0]
    out[1] = wl * U[ku, 1] + wr * U[ku + 1, 1] + wt * V[kv, 1] + wb * V[kv + 1, 1]
    for i in range(3):
        out[2 + i] -= (
            gl * hl * U[ku, 4 + i]
            + gr * hr * U[ku + 1, 4 + i]
            + gt * kt * V[kv, 4 + i]
            + gb * kb * V[kv + 1, 4 + i]
        )
    out[5] = -(wl * sl + wr * sr + wt * st + wb * sb)
    return float(T)


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
    bloom: float,
    gain: Array,
    offset: Array,
    noise: Array,
    residual: Array,
) -> tuple[Array, Array, float, int]:
    """Normal equations of one Gauss-Newton step over every `every`-th sample.

    noise: variance of a level is noise[0] level + noise[1]. residual (n,): filled with the residuals in
    standard deviations. Returns A (p, p), g (p,), chi-square, number of samples.
    """
    terms = len(gain)
    parameters = LIGHT + 2 * terms
    U, V = line_table(Hi, x, 0, S), line_table(Hi, y, 1, S)
    nodes = node_table(U, V, S)
    A, g = np.zeros((parameters, parameters)), np.zeros(parameters)
    J, weighted = np.zeros((parameters, _BATCH)), np.zeros(_BATCH)
    r, w = np.zeros(_BATCH), np.zeros(_BATCH)
    d = np.zeros(6)
    mono = np.ones(6)
    chi2, count, filled = 0.0, 0, 0
    total = len(level)
    for i in range(0, total, every):
        qx, qy = q[i, 0], q[i, 1]
        X, Y = qx / scale, qy / scale
        mono[1], mono[2] = X, Y
        if terms == 6:
            mono[3], mono[4], mono[5] = X * X, X * Y, Y * Y
        bright, dark = 0.0, 0.0
        for m in range(terms):
            bright += gain[m] * mono[m]
            dark += offset[m] * mono[m]
        if i < edges:
            T = _share(cells, cell[i, 0], cell[i, 1], qx, qy, U, V, nodes, bloom, d)
            gx, gy = -bright * d[0] * scale, -bright * d[1] * scale
            J[0, filled], J[1, filled], J[2, filled] = gx * X, gx * Y, gx
            J[3, filled], J[4, filled], J[5, filled] = gy * X, gy * Y, gy
            pull = -(gx * X + gy * Y)
            J[6, filled], J[7, filled] = pull * X, pull * Y
            for m in range(4):
                J[SHAPE + m, filled] = bright * d[2 + m]
        else:
            T = cells[cell[i, 1], cell[i, 0]]
            for m in range(LIGHT):
                J[m, filled] = 0.0
        model = bright * T + dark
        weight = 1.0 / (noise[0] * max(model, 0.0) + noise[1])
        r[filled], w[filled] = level[i] - model, weight
        for m in range(terms):
            J[LIGHT + m, filled] = T * mono[m]
            J[LIGHT + terms + m, filled] = mono[m]
        residual[i] = r[filled] * math.sqrt(weight)
        chi2 += weight * r[filled] * r[filled]
        count += 1
        filled += 1
        if filled == _BATCH or i + every >= total:
            for m in range(parameters):
                slope = 0.0
                for k in range(filled):
                    weighted[k] = J[m, k] * w[k]
                    slope += weighted[k] * r[k]
                g[m] += slope
                for n in range(m + 1):
                    square = 0.0
                    for k in range(filled):
                        square += weighted[k] * J[n, k]
                    A[m, n] += square
            filled = 0
    for m in range(parameters):
        for n in range(m):
            A[n, m] = A[m, n]
    return A, g, chi2, count
