"""Edge fit: the homography of a raster from sub-pixel edge positions, robust against shadow and blur.

Seven times less exact than the photometric fit, but it needs neither the light nor the point spread to
be as modelled: it starts that fit from a coarse detection, and stands in for it where it does not fit.
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

_WIDEST_PX, _FINE_PX = 7.0, 3.0
_OF_CELL = 0.42  # of the smallest cell that a profile may reach into
_STEP_PX = 1.5  # between profiles along an edge
_COARSE_STEP = 0.25  # of the smallest cell, where only a start is wanted
_CORNER_PX = 2.5  # kept free of profiles at the ends of an edge
_FEWEST_EDGES = 8
_REWEIGHTINGS = 4
_STILL_PX = 0.3  # a start that is as good as this needs no second step
_LEAST_STEP = 8.0  # grey levels between both sides of an edge
_NO_EDGE = math.inf
_EDGE_FLOOR_PX = 0.01  # systematic error of one edge, whatever its scatter


@dataclass(frozen=True, slots=True, eq=False)
class EdgeFit:
    """Corners (4, 2) px, their covariance (8, 8) from the scatter between edges, and how many edges agree."""

    corners_px: Array
    covariance: Array
    q_from_target: Array
    rms_px: float
    used: float


def coarse_homography(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array
) -> tuple[Array, float] | None:
    """The homography from a start that may be off by a third of a cell, and the share of edges seen.

    None when too few are there.
    """
    found = _fit(picture, raster, frame, q_from_target, (True, True, False))
    return None if found is None else (found[0], found[-1] / len(edge_segments(raster)))


def fit_edges(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array
) -> EdgeFit | None:
    """Fit all black-and-white edges from a start good to 2 px; None when too few are there.

    Ends where it has strayed.
    """
    found = _fit(picture, raster, frame, q_from_target, (False, False))
    if found is None:
        return None
    H, scale, covariance, rms, agreeing = found
    corners_px, covariance = to_pixels(frame, apply(H, raster.corners), covariance[:8, :8], scale)
    return EdgeFit(corners_px, covariance, H, rms, agreeing / len(edge_segments(raster)))


def _fit(
    picture: Grey, raster: Raster, frame: LocalFrame, q_from_target: Array, wide: tuple[bool, ...]
) -> tuple[Array, float, Array, float, float] | None:
    """Homography after a step for each of `wide`; scale of the steps, what `_step` tells of the last."""
    H = normalised(q_from_target)
    corners = apply(H, raster.corners)
    scale = _extent(corners)
    for is_wide in wide:
        found = edge_offsets(picture, raster, frame, H, wide=is_wide)
        if len(np.unique(found[3])) < _FEWEST_EDGES:
            return None
        try:
            change, covariance, rms, agreeing = _step(*found, scale)
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
    """Whether a corner went farther from where it started, (4, 2) in the q plane, than the tag's half.

    No longer a step of a fit: edges would be sought far outside of the picture, and for very long.
    """
    shift = float(np.abs(apply(q_from_target, raster.corners) - start).max())
    return not shift <= _extent(start)


def edge_offsets(
    picture: Grey, raster: Raster, frame: LocalFrame, H: Array, *, wide: bool
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Find where the edges are: offsets (n,) px along unit normals to white (n, 2), at points q (n, 2).

    Last: which of `edge_segments` they belong to (n,). wide: the start may be off by a third of a cell.
    """
    cell = _cell_px(raster, H)
    width = max(min(_FINE_PX, _OF_CELL * cell), 1.5)
    step = max(_STEP_PX, _COARSE_STEP * cell) if wide else _STEP_PX
    if wide:
        width = max(min(_WIDEST_PX, _OF_CELL * cell), width)
    Fi = np.asarray(np.linalg.inv(frame.F), dtype=np.float64)
    free, segments = min(_CORNER_PX, 0.25 * cell), edge_segments(raster)
    return _profiles(picture, frame.lens, frame.r0, Fi, H, segments, width, free, step)


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
        spread = max(1.4826 * float(np.median(np.abs(r))), 0.02)
        weight = 1 / (1 + (r / (3 * spread)) ** 2) ** 2
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
            agreeing += heaviest > 0.25
            score[:], total[:], heaviest = 0.0, 0.0, 0.0
    return meat, float(agreeing)


@lru_cache(maxsize=64)
def edge_segments(raster: Raster) -> Array:
    """Edges (n, 6) between cells: x0, y0, x1, y1 mm, and the direction (2) across, towards white."""
    cells, x, y = raster.cells, raster.x, raster.y
    found: list[tuple[float, ...]] = []
    steps = np.diff(cells, axis=1)
    for row, column in np.argwhere(steps != 0).tolist():
        sign = float(np.sign(steps[row, column]))
        found.append((x[column + 1], y[row], x[column + 1], y[row + 1], sign, 0.0))
    steps = np.diff(cells, axis=0)
    for row, column in np.argwhere(steps.T != 0)[:, ::-1].tolist():
        sign = float(np.sign(steps[row, column]))
        found.append((x[column], y[row + 1], x[column + 1], y[row + 1], 0.0, sign))
    return np.array(found)


@compiled
def _level(picture: Grey, x: float, y: float) -> float:
    i, j = int(x), int(y)
    a, b = x - i, y - j
    top = picture[j, i] * (1 - a) + picture[j, i + 1] * a
    low = picture[j + 1, i] * (1 - a) + picture[j + 1, i + 1] * a
    return float(top * (1 - b) + low * b)


@compiled
def _shift(picture: Grey, px: float, py: float, ux: float, uy: float, profile: Array) -> float:
    """How far the edge is from a pixel along (ux, uy), px; infinite without an edge. profile: for work."""
    half = len(profile) // 2
    for i in range(2 * half + 1):
        s = 0.5 * (i - half)
        profile[i] = _level(picture, px + s * ux, py + s * uy)
    low, high = (profile[0] + profile[1]) / 2, (profile[-1] + profile[-2]) / 2
    if high - low < _LEAST_STEP:
        return _NO_EDGE
    area = 0.0
    for i in range(2 * half + 1):
        area += min(max((profile[i] - low) / (high - low), -0.5), 1.5)
    return 0.5 * (half + 0.5 - area)


@compiled
def _profiles(
    picture: Grey,
    lens: Array,
    r0: Array,
    Fi: Array,
    H: Array,
    segments: Array,
    width: float,
    free: float,
    step: float,
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Measure edges along their normals: points q (n, 2), normals to white (n, 2), offsets (n,), edge (n,)."""
    height, columns = picture.shape
    room = 0
    ends = np.empty((len(segments), 4))
    for k in range(len(segments)):
        for m in range(2):
            at = q_at(H, segments[k, 2 * m], segments[k, 2 * m + 1])
            ends[k, 2 * m], ends[k, 2 * m + 1] = at
        room += 2 + int(math.hypot(ends[k, 2] - ends[k, 0], ends[k, 3] - ends[k, 1]) / step)
    q, normal, offset = np.empty((room, 2)), np.empty((room, 2)), np.empty(room)
    edge = np.empty(room, np.intp)
    half = int(2 * width)
    profile = np.empty(2 * half + 1)
    n = 0
    for k in range(len(segments)):
        dx, dy = ends[k, 2] - ends[k, 0], ends[k, 3] - ends[k, 1]
        length = math.hypot(dx, dy)
        if length - 2 * free < _STEP_PX:
            continue
        pieces = max(int((length - 2 * free) / step), 1)
        nx, ny = -dy / length, dx / length
        X, Y = segments[k, 0] + segments[k, 4] * 1e-3, segments[k, 1] + segments[k, 5] * 1e-3
        ax, ay = q_at(H, X, Y)
        if (ax - ends[k, 0]) * nx + (ay - ends[k, 1]) * ny < 0:
            nx, ny = -nx, -ny
        for m in range(pieces):
            along = (free + (length - 2 * free) * (m + 0.5) / pieces) / length
            qx, qy = ends[k, 0] + along * dx, ends[k, 1] + along * dy
            px, py = pixel_at(lens, r0, Fi, qx, qy)
            ux, uy = pixel_at(lens, r0, Fi, qx + nx, qy + ny)
            ux, uy = ux - px, uy - py
            reach = width + 1.5
            if px < reach or py < reach or px > columns - 2 - reach or py > height - 2 - reach:
                continue
            shift = _shift(picture, px, py, ux, uy, profile)
            if abs(shift) > 0.8 * width:
                continue
            q[n, 0], q[n, 1], normal[n, 0], normal[n, 1] = qx, qy, nx, ny
            offset[n], edge[n] = shift, k
            n += 1
    return q[:n], normal[:n], offset[:n], edge[:n]
