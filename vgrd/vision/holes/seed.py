"""Where a circle may be: Circle Hough in a rectified view of a plane, and rings around a centre."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array
from vgrd.vision.holes.view import Circle, PlaneView, ring, turn_angles

_RADIUS_PX = (10.0, 40.0)  # of the hole in the rectified view: enough for a start, and quick
_LARGEST_PX = 1600  # side of the rectified view: what a search of many radii may take of time
_CANDIDATES = 6  # of the circles with most votes: the hole, its chamfer, its neighbours
_MARGIN_RADII = 1.4  # around the centre's places: a rim 15 % too large, and what surrounds it
_CANNY = 350.0  # upper threshold; a guess: a third of Sobel's answer to a sharp step of 255
_VOTES = 0.25  # of half the circumference; a guess: fewer find false circles too, which cost time
_RADIUS_SLACK = 0.05  # beyond the tolerance: the transform's own error of the radius
_REACH_SLACK = 0.1  # of the reach: the transform's own error of the place
_RINGS = np.linspace(0.55, 1.6, 211)  # radii, of the hole's: beyond lies another hole; every 0.005
_RING_ANGLES = 240  # of a ring: the median ignores what hides less than half of it
_SAME_RIM_PX = 2.5  # width of a blurred rim, 3 sigma of 0.8 px
_STRETCH_PERCENT = (2, 98)  # levels that become black and white: not those of few bright pixels


def circles_near(
    view: PlaneView, expected: Circle, reach_mm: float, tolerance: float
) -> list[Circle]:
    """Circles with the expected radius, up to the tolerance, and their centre within reach; best first."""
    scale = _scale(view, expected, reach_mm)
    half = reach_mm + _MARGIN_RADII * expected.radius
    n = int(2 * half * scale)
    ticks = (np.arange(n) + 0.5) / scale - half
    places = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2) + expected.centre
    flat = _normalised(view.levels_at(places, 1 / scale).reshape(n, n))
    radius = expected.radius * scale
    candidates = cv2.HoughCircles(
        flat,
        cv2.HOUGH_GRADIENT,
        dp=1.0,
        minDist=radius,
        param1=_CANNY,
        param2=_VOTES * np.pi * radius,
        minRadius=int((1 - tolerance) * radius * (1 - _RADIUS_SLACK)),
        maxRadius=int(np.ceil((1 + tolerance) * radius * (1 + _RADIUS_SLACK))),
    )
    if candidates is None:
        return []
    circles = [
        Circle((np.array([x, y]) + 0.5) / scale - half + expected.centre, float(r) / scale)
        for x, y, r in np.reshape(candidates, (-1, 3))[:_CANDIDATES]
    ]
    limit_mm = (1 + _REACH_SLACK) * reach_mm
    return [c for c in circles if np.linalg.norm(c.centre - expected.centre) <= limit_mm]


def rims_around(view: PlaneView, circle: Circle) -> list[tuple[float, float]]:
    """Rims with the same centre: radius in mm, and contrast as a share of the circle's."""
    directions = ring(turn_angles(_RING_ANGLES))
    places = circle.centre + (circle.radius * _RINGS)[:, None, None] * directions
    step_mm = circle.radius * float(_RINGS[1] - _RINGS[0])
    levels = view.levels_at(places.reshape(-1, 2), step_mm).reshape(len(_RINGS), -1)
    px_per_ring = step_mm * view.px_per_mm(circle.centre)
    width = max(int(np.ceil(_SAME_RIM_PX / max(px_per_ring, 1e-9))), 1)
    profile = np.median(levels, axis=1)
    steps = np.abs(profile[width:] - profile[:-width])
    radii = circle.radius * (_RINGS[width:] + _RINGS[:-width]) / 2
    gap = 2 * width * step_mm
    contrast = steps[np.abs(radii - circle.radius) < gap].max(initial=0.0)
    rims = []
    remainder = np.where(np.abs(radii - circle.radius) < gap, 0.0, steps)
    while remainder.any() and contrast > 0:
        best = int(remainder.argmax())
        rims.append((float(radii[best]), float(remainder[best] / contrast)))
        remainder[np.abs(radii - radii[best]) < gap] = 0.0
    return rims


def _scale(view: PlaneView, expected: Circle, reach_mm: float) -> float:
    """Pixels per mm of the rectified view."""
    radius_px = view.px_per_mm(expected.centre) * expected.radius
    scale = float(np.clip(radius_px, *_RADIUS_PX)) / expected.radius
    return min(scale, _LARGEST_PX / (2 * (reach_mm + _MARGIN_RADII * expected.radius)))


def _normalised(levels: Array) -> NDArray[np.uint8]:
    """Grey levels stretched to 8 bits."""
    low, high = np.percentile(levels, _STRETCH_PERCENT)
    stretched = (levels - low) * (255 / max(high - low, 1.0))
    grey = np.clip(stretched, 0, 255).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), np.uint8)
