"""Edge fit: the homography of a raster from sub-pixel edge positions, robust against shadow and blur.

Its corners err by 2.4 times as much as those of the photometric fit (drawn clean tags of 213 px), but it
needs neither the light nor the point spread to be as modelled. So it gives that fit its start, and
replaces it where the picture is not as modelled.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.images.compiling import compiled
from vgrd.vision.images.homography import apply, moved, normalised, to_pixels
from vgrd.vision.images.warp import LocalFrame, pixel_at, q_at
from vgrd.vision.print.raster import Raster

_WIDEST_PX = 7.0  # half a profile, from a detection: a third of a cell of 21 px
_FINE_PX = 3.0  # half a profile, from a good start: 3.7 sigma of the usual blur of 0.8 px
_NARROWEST_PX = 1.5  # half a profile: three samples on either side
_OF_CELL = 0.42  # of the smallest cell that a profile may reach into: the next edge is still far
_STEP_PX = 1.5  # between profiles along an edge: nearer ones share their pixels
_COARSE_STEP = 0.25  # of the smallest cell, where only a start is wanted
_CORNER_PX = 2.5  # without profiles at the ends of an edge: 3 sigma of blur from the corner
_CORNER_OF_CELL = 0.25  # at most that, so that half of a small cell's side is left
_FEWEST_EDGES = 8  # each tells of its place and its direction: 16 numbers for 9 unknowns
_REWEIGHTINGS = 4  # from there to 12 no corner moves by more than 0.001 px (drawn tags)
_STILL_PX = 0.3  # a start that is as good as this needs no second step
_LEAST_STEP = 8.0  # grey levels between both sides of an edge: 4 sigma of white's noise at 40 dB
_NO_EDGE = math.inf
_SPACING_PX = 0.5  # of the samples of a profile: its pixels are interpolated linearly
_OVERSHOOT = 0.5  # of the step, beyond either side: what a reflex may add to a profile
_TRUSTED_SHARE = 0.8  # of half a profile: an edge farther off has no flat level beside it
_EDGE_FLOOR_PX = 0.01  # systematic error of one edge, whatever its scatter
NORMAL_OF_MAD = 1.4826  # sigma of a normal law over its median absolute deviation, 1 / 0.6745
PROFILE_NOISE_PX = 0.02  # of one profile at 40 dB: drawn tags scatter by 0.015 to 0.019
OUTLIER_SIGMAS = 3.0  # where a residual counts a quarter (Geman and McClure)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeFit:
    """Corners (4, 2) px and their covariance (8, 8), from the scatter between edges.

    rms_px: of the weighted offsets of the edges; edge_share: share of the edges that agree.
    """

    corners_px: Array
    covariance: Array
    q_from_target: Array
    rms_px: float
    edge_share: float


def coarse_homography(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array
) -> tuple[Array, float] | None:
    """The homography from a start that may be off by a third of a cell, and the share of edges that agree.

    None when the picture shows fewer than 8 edges.
    """
    fit = _fit(picture, raster, frame, q_from_target, (True, True, False))
    return None if fit is None else (fit[0], fit[-1] / len(edge_segments(raster)))


def fit_edges(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array
) -> EdgeFit | None:
    """Fit all black-and-white edges from a start good to 2 px; None when fewer than 8 are seen.

    A fit that strays from its start ends there; the caller asks `has_strayed`.
    """
    fit = _fit(picture, raster, frame, q_from_target, (False, False))
    if fit is None:
        return None
    H, scale, covariance, rms, agreeing = fit
    corners_px, covariance = to_pixels(frame, apply(H, raster.corners), covariance[:8, :8], scale)
    return EdgeFit(corners_px, covariance, H, rms, agreeing / len(edge_segments(raster)))


def _fit(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array, wide: tuple[bool, ...]
) -> tuple[Array, float, Array, float, float] | None:
    """One step for each of `wide`: homography, scale of the steps, then the last results of `_step`."""
    H = normalised(q_from_target)
    corners = apply(H, raster.corners)
    scale = _extent(corners)
    for is_wide in wide:
        measurements = edge_offsets(picture, raster, frame, H, wide=is_wide)
        if len(np.unique(measurements[3])) < _FEWEST_EDGES:
            return None
        try:
            change, covariance, rms, agreeing = _step(*measurements, scale)
        except np.linalg.LinAlgError:
            return None
        H = moved(H, change[:8], scale)
        if has_strayed(H, raster, corners):
            break
        if is_wide and np.abs(change[:8]).max() * scale < _STILL_PX:
            break
    return H, scale, covariance, rms, agreeing


def _extent(corners: Array) -> float:
    """Largest distance of corners (4, 2) from their middle along an axis, px."""
    return float(np.abs(corners - corners.mean(0)).max())


def has_strayed(q_from_target: Array, raster: Raster, start: Array) -> bool:
    """Whether a corner moved from its start (4, 2), in the q plane, by more than half of the tag.

    Such a fit must end: it would look for edges far outside of the picture, for seconds.
    """
    shift = float(np.abs(apply(q_from_target, raster.corners) - start).max())
    return not shift <= _extent(start)


def edge_offsets(
    picture: Grey, raster: Raster, frame: LocalFrame, H: Array, *, wide: bool
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Measure the edges: points q (n, 2), unit normals towards white (n, 2), offsets (n,) px, edges (n,).

    An offset is how far the edge lies along the normal; an edge is an index of `edge_segments`. wide: the
    start may be off by a third of a cell.
    """
    cell = _cell_px(raster, H)
    width = max(min(_FINE_PX, _OF_CELL * cell), _NARROWEST_PX)
    step = max(_STEP_PX, _COARSE_STEP * cell) if wide else _STEP_PX
    if wide:
        width = max(min(_WIDEST_PX, _OF_CELL * cell), width)
    Fi = np.asarray(np.linalg.inv(frame.F), dtype=np.float64)
    margin, segments = min(_CORNER_PX, _CORNER_OF_CELL * cell), edge_segments(raster)
    return _profiles(picture, frame.lens, frame.r0, Fi, H, segments, width, margin, step)


def shows_edges(raster: Raster, H: Array) -> bool:
    """Whether the raster's cells are large enough for `edge_offsets` to see their sides."""
    cell = _cell_px(raster, H)
    return cell - 2 * min(_CORNER_PX, _CORNER_OF_CELL * cell) >= _STEP_PX


def _cell_px(raster: Raster, H: Array) -> float:
    """Shortest side of the smallest cell, px."""
    corners = apply(H, raster.corners)
    sides = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1)
    extent = np.linalg.norm(raster.corners[1] - raster.corners[0])
    return float(sides.min() / extent * raster.smallest_cell)


@compiled
def edge_slopes(q: Array, normal: Array, scale: float) -> Array:
    """Derivative (n, 9) of the offsets of edges by the motion of the q plane (8) and the bloom."""
    J = np.empty((len(q), 9))
    for i in range(len(q)):
        x, y = q[i, 0] / scale, q[i, 1] / scale
        u, v = normal[i, 0] * scale, normal[i, 1] * scale
        along = u * x + v * y
        J[i, 0], J[i, 1], J[i, 2] = u * x, u * y, u
        J[i, 3], J[i, 4], J[i, 5] = v * x, v * y, v
        J[i, 6], J[i, 7], J[i, 8] = -along * x, -along * y, 1.0
    return J


@compiled
def _step(
    q: Array, normal: Array, offset: Array, edge: NDArray[np.intp], scale: float
) -> tuple[Array, Array, float, float]:
    """One robust step over 8 parameters of the homography and the bloom.

    Returns the step (9,), its sandwich covariance (an edge errs as a whole), the weighted rms of
    the offsets, px, and how many edges agree.
    """
    n = len(offset)
    J, r, weight = edge_slopes(q, normal, scale), offset.copy(), np.ones(n)
    change, A = np.zeros(9), np.zeros((9, 9))
    for _ in range(_REWEIGHTINGS):
        spread = max(NORMAL_OF_MAD * float(np.median(np.abs(r))), PROFILE_NOISE_PX)
        weight = 1 / (1 + (r / (OUTLIER_SIGMAS * spread)) ** 2) ** 2
        JW = J * weight.reshape(-1, 1)
        A = JW.T @ J
        change = change + np.linalg.solve(A, JW.T @ r)
        r = offset - J @ change
    meat, agreeing = _meat(J, r, weight, edge)
    rms = math.sqrt(np.sum(weight * r * r) / np.sum(weight))
    bread = np.linalg.inv(A)
    return change, bread @ meat @ bread, rms, agreeing


@compiled
def _meat(J: Array, r: Array, weight: Array, edge: NDArray[np.intp]) -> tuple[Array, float]:
    """Scatter (9, 9) of the scores of whole edges, and how many edges agree."""
    meat, score, total = np.zeros((9, 9)), np.zeros(9), np.zeros(9)
    agreeing, heaviest = 0, 0.0
    for i in range(len(r)):
        for m in range(9):
            score[m] += J[i, m] * weight[i] * r[i]
            total[m] += J[i, m] * weight[i]
        heaviest = max(heaviest, weight[i])
        if i == len(r) - 1 or edge[i + 1] != edge[i]:
            meat += np.outer(score, score) + np.outer(total, total) * _EDGE_FLOOR_PX**2
            agreeing += heaviest > 0.25  # within OUTLIER_SIGMAS
            score[:], total[:], heaviest = 0.0, 0.0, 0.0
    return meat, float(agreeing)


@lru_cache(maxsize=64)
def edge_segments(raster: Raster) -> Array:
    """Edges (n, 6) between cells: x0, y0, x1, y1 mm, and the direction (2) across, towards white."""
    cells, x, y = raster.cells, raster.x, raster.y
    segments: list[tuple[float, ...]] = []
    steps = np.diff(cells, axis=1)
    for row, column in np.argwhere(steps != 0).tolist():
        sign = float(np.sign(steps[row, column]))
        segments.append((x[column + 1], y[row], x[column + 1], y[row + 1], sign, 0.0))
    steps = np.diff(cells, axis=0)
    for row, column in np.argwhere(steps.T != 0)[:, ::-1].tolist():
        sign = float(np.sign(steps[row, column]))
        segments.append((x[column], y[row + 1], x[column + 1], y[row + 1], 0.0, sign))
    return np.array(segments)


@compiled
def _level(picture: Grey, x: float, y: float) -> float:
    i, j = int(x), int(y)
    a, b = x - i, y - j
    top = picture[j, i] * (1 - a) + picture[j, i + 1] * a
    low = picture[j + 1, i] * (1 - a) + picture[j + 1, i + 1] * a
    return float(top * (1 - b) + low * b)


@compiled
def _shift(picture: Grey, px: float, py: float, ux: float, uy: float, profile: Array) -> float:
    """Distance, px, of the edge from a pixel along (ux, uy); infinite without an edge.

    The area under the step tells it. profile: an array of odd length to work in.
    """
    half = len(profile) // 2
    for i in range(2 * half + 1):
        s = _SPACING_PX * (i - half)
        profile[i] = _level(picture, px + s * ux, py + s * uy)
    low, high = (profile[0] + profile[1]) / 2, (profile[-1] + profile[-2]) / 2
    if high - low < _LEAST_STEP:
        return _NO_EDGE
    area = 0.0
    for i in range(2 * half + 1):
        area += min(max((profile[i] - low) / (high - low), -_OVERSHOOT), 1 + _OVERSHOOT)
    return _SPACING_PX * (half + 0.5 - area)


@compiled
def _profiles(
    picture: Grey,
    lens: Array,
    r0: Array,
    Fi: Array,
    H: Array,
    segments: Array,
    width: float,
    margin: float,
    step: float,
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """The results of `edge_offsets`. margin: px without profiles at both ends of an edge."""
    height, columns = picture.shape
    room = 0
    ends = np.empty((len(segments), 4))
    for k in range(len(segments)):
        for m in range(2):
            qx, qy = q_at(H, segments[k, 2 * m], segments[k, 2 * m + 1])
            ends[k, 2 * m], ends[k, 2 * m + 1] = qx, qy
        room += 2 + int(math.hypot(ends[k, 2] - ends[k, 0], ends[k, 3] - ends[k, 1]) / step)
    q, normal, offset = np.empty((room, 2)), np.empty((room, 2)), np.empty(room)
    edge = np.empty(room, np.intp)
    half = int(2 * width)
    profile = np.empty(2 * half + 1)
    n = 0
    for k in range(len(segments)):
        dx, dy = ends[k, 2] - ends[k, 0], ends[k, 3] - ends[k, 1]
        length = math.hypot(dx, dy)
        if length - 2 * margin < _STEP_PX:
            continue
        pieces = max(int((length - 2 * margin) / step), 1)
        nx, ny = -dy / length, dx / length
        # The normal is turned to white: to where a point 0.001 mm from the edge is mapped.
        X, Y = segments[k, 0] + segments[k, 4] * 1e-3, segments[k, 1] + segments[k, 5] * 1e-3
        ax, ay = q_at(H, X, Y)
        if (ax - ends[k, 0]) * nx + (ay - ends[k, 1]) * ny < 0:
            nx, ny = -nx, -ny
        for m in range(pieces):
            along = (margin + (length - 2 * margin) * (m + 0.5) / pieces) / length
            qx, qy = ends[k, 0] + along * dx, ends[k, 1] + along * dy
            px, py = pixel_at(lens, r0, Fi, qx, qy)
            ux, uy = pixel_at(lens, r0, Fi, qx + nx, qy + ny)
            ux, uy = ux - px, uy - py
            reach = width + 1.5  # for the bilinear samples, and a pixel that is not q's
            if px < reach or py < reach or px > columns - 2 - reach or py > height - 2 - reach:
                continue
            shift = _shift(picture, px, py, ux, uy, profile)
            if abs(shift) > _TRUSTED_SHARE * width:
                continue
            q[n, 0], q[n, 1], normal[n, 0], normal[n, 1] = qx, qy, nx, ny
            offset[n], edge[n] = shift, k
            n += 1
    return q[:n], normal[:n], offset[:n], edge[:n]
