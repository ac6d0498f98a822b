"""Compiled model of a picture: the share of white that a pixel sees of a blurred raster, and its slopes.

Of the cells' lines the two nearest in either direction count. Where two cross, the share is the bivariate
normal distribution, whose correlation their angle gives: a product of two error functions instead
errs by 0.02 px at 60 degrees. Numbers in comments are the equations of docs/photometric.md.
"""

import math

from vgrd.geometry import Array
from vgrd.vision.alignment.raster_lines import distance
from vgrd.vision.images.compiling import inlined

_NEAR = 4.2  # sigma beyond which an edge is not felt: 1.3e-5 of the contrast, 0.003 grey levels
_PER_TURN = 0.15915494309189535  # 1 / (2 pi) of eq. 7
_PEAK = 0.3989422804014327  # 1 / sqrt(2 pi): the normal density at 0


@inlined
def _normal(h: float) -> tuple[float, float]:
    """Distribution and density of the normal law (Abramowitz and Stegun 26.2.17, error 8e-8)."""
    if h > _NEAR:
        return 1.0, 0.0
    if h < -_NEAR:
        return 0.0, 0.0
    density = _PEAK * math.exp(-0.5 * h * h)
    t = 1.0 / (1.0 + 0.2316419 * abs(h))  # this and the next five numbers: 26.2.17
    tail = t * (
        0.31938153 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429)))
    )
    tail *= density
    return (1.0 - tail if h >= 0 else tail), density


@inlined
def _step(here: float, before: float, after: float) -> float:
    """Step of colour over a line, in this row or, where it has none, in a row that is near."""
    if here != 0.0:
        return here
    return before if before != 0.0 else after


@inlined
def _crossing(
    N: Array, K: float, h: float, k: float, F: float, G: float, f: float, g: float, out: Array
) -> tuple[float, float, float]:
    """What the correlation of two lines adds to the share and to its slopes by their distances h and k.

    N: row of `node_table`; K: second difference of the colours; F, G, f, g: distributions and
    densities at h and k. Adds the slopes by the blur to out[2:5].
    """
    if K == 0.0 or f == 0.0 or g == 0.0:
        return 0.0, 0.0, 0.0
    rho, narrow, squares, product = N[0], N[1], h * h + k * k, 2.0 * h * k
    excess = 0.0
    for m in range(4):
        excess += N[13 + m] * math.exp((squares - product * N[5 + m]) * N[9 + m])  # 7
    turn = K * _PER_TURN * narrow
    turn *= math.exp(-0.5 * narrow * narrow * (squares - product * rho))
    for m in range(3):
        out[2 + m] += turn * N[2 + m]  # 13, the crossings
    slope_h = K * f * (_normal((k - rho * h) * narrow)[0] - G)  # 11
    slope_k = K * g * (_normal((h - rho * k) * narrow)[0] - F)
    return K * excess, slope_h, slope_k


@inlined
def share(
    cells: Array,
    ku: int,
    kv: int,
    qx: float,
    qy: float,
    U: Array,
    V: Array,
    nodes: Array,
    bloom: Array,
    scale: float,
    out: Array,
) -> float:
    """Share of white at q; bloom (3,): px, and mm of ink in x and y; scale: of `scale_at`.

    out (12,): its derivatives by q (2), S (3), bloom (3), and by the distances of q from the lines left,
    right, above and below.
    """
    rows, columns = cells.shape
    u0, v0 = max(ku - 1, 0), max(kv - 1, 0)
    u2, v2 = min(ku + 1, columns - 1), min(kv + 1, rows - 1)
    dl, dr = distance(U, ku, qx, qy), distance(U, ku + 1, qx, qy)
    dt, db = distance(V, kv, qx, qy), distance(V, kv + 1, qx, qy)
    near_l, near_r = dl * U[ku, 3] < _NEAR, dr * U[ku + 1, 3] > -_NEAR
    near_t, near_b = dt * V[kv, 3] < _NEAR, db * V[kv + 1, 3] > -_NEAR
    a0, a1, a2 = cells[v0, u0], cells[v0, ku], cells[v0, u2]
    b0, b1, b2 = cells[kv, u0], cells[kv, ku], cells[kv, u2]
    c0, c1, c2 = cells[v2, u0], cells[v2, ku], cells[v2, u2]
    l0, l1, l2 = a1 - a0, b1 - b0, c1 - c0
    r0, r1, r2 = a2 - a1, b2 - b1, c2 - c1
    # 5: the step of colour gives the direction of the bloom.
    sl, sr, st, sb = 0.0, 0.0, 0.0, 0.0
    if near_l:
        sl = _step(l1, l0 if near_t else 0.0, l2 if near_b else 0.0)
        dl -= (bloom[0] + bloom[1] * scale * U[ku, 7]) * sl
    if near_r:
        sr = _step(r1, r0 if near_t else 0.0, r2 if near_b else 0.0)
        dr -= (bloom[0] + bloom[1] * scale * U[ku + 1, 7]) * sr
    if near_t:
        st = _step(b1 - a1, b0 - a0 if near_l else 0.0, b2 - a2 if near_r else 0.0)
        dt -= (bloom[0] + bloom[2] * scale * V[kv, 7]) * st
    if near_b:
        sb = _step(c1 - b1, c0 - b0 if near_l else 0.0, c2 - b2 if near_r else 0.0)
        db -= (bloom[0] + bloom[2] * scale * V[kv + 1, 7]) * sb
    hl, hr, kt, kb = dl * U[ku, 3], dr * U[ku + 1, 3], dt * V[kv, 3], db * V[kv + 1, 3]
    Pl, fl = _normal(hl)
    Pr, fr = _normal(hr)
    Pt, ft = _normal(kt)
    Pb, fb = _normal(kb)
    t0 = a0 + l0 * Pl + r0 * Pr  # 6
    t1 = b0 + l1 * Pl + r1 * Pr
    t2 = c0 + l2 * Pl + r2 * Pr
    T = t0 + (t1 - t0) * Pt + (t2 - t1) * Pb
    gl = fl * (l0 + (l1 - l0) * Pt + (l2 - l1) * Pb)  # the slopes of 6 by the distances
    gr = fr * (r0 + (r1 - r0) * Pt + (r2 - r1) * Pb)
    gt, gb = ft * (t1 - t0), fb * (t2 - t1)
    for i in range(3):
        out[2 + i] = 0.0
    if (fl + fr) * (ft + fb) > 0.0:
        e, h, k = _crossing(nodes[ku, kv], l1 - l0, hl, kt, Pl, Pt, fl, ft, out)
        T, gl, gt = T + e, gl + h, gt + k
        e, h, k = _crossing(nodes[ku + 1, kv], r1 - r0, hr, kt, Pr, Pt, fr, ft, out)
        T, gr, gt = T + e, gr + h, gt + k
        e, h, k = _crossing(nodes[ku, kv + 1], l2 - l1, hl, kb, Pl, Pb, fl, fb, out)
        T, gl, gb = T + e, gl + h, gb + k
        e, h, k = _crossing(nodes[ku + 1, kv + 1], r2 - r1, hr, kb, Pr, Pb, fr, fb, out)
        T, gr, gb = T + e, gr + h, gb + k
    wl, wr, wt, wb = gl * U[ku, 3], gr * U[ku + 1, 3], gt * V[kv, 3], gb * V[kv + 1, 3]
    # 12
    out[0] = wl * U[ku, 0] + wr * U[ku + 1, 0] + wt * V[kv, 0] + wb * V[kv + 1, 0]
    out[1] = wl * U[ku, 1] + wr * U[ku + 1, 1] + wt * V[kv, 1] + wb * V[kv + 1, 1]
    for i in range(3):
        out[2 + i] -= (  # 13, the lines
            gl * hl * U[ku, 4 + i]
            + gr * hr * U[ku + 1, 4 + i]
            + gt * kt * V[kv, 4 + i]
            + gb * kb * V[kv + 1, 4 + i]
        )
    out[5] = -(wl * sl + wr * sr + wt * st + wb * sb)  # 14
    out[6] = -scale * (wl * sl * U[ku, 7] + wr * sr * U[ku + 1, 7])
    out[7] = -scale * (wt * st * V[kv, 7] + wb * sb * V[kv + 1, 7])
    out[8], out[9], out[10], out[11] = wl, wr, wt, wb
    return float(T)
