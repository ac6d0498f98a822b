"""The smallest circle around points, as figure 10 of the paper draws it."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array

_IN_LINE = 1e-9  # sine of an angle so sharp that two of its corners do as well


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """center: (2,), in the unit of the points, as the diameter."""

    center: Array
    diameter: float


def smallest_circle(points: Array) -> Circle:
    """The smallest circle that holds all points (n, 2); exact.

    Two or three points on its edge determine it, so its centre is a middle of two or the circumcentre of
    three; around any other centre the farthest point asks for more. Takes n^4 steps: for tens of points.
    """
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 2 or not len(p) or not np.isfinite(p).all():
        raise InputError(f"a circle goes around finite points (n, 2), got shape {p.shape}")
    centers = np.vstack([p, _middles(p), _circumcenters(p)])
    radii = np.linalg.norm(centers[:, None] - p, axis=2).max(axis=1)
    best = int(np.argmin(radii))
    return Circle(centers[best], 2 * float(radii[best]))


def _middles(p: Array) -> Array:
    """Middles (k, 2) of all pairs."""
    i, j = np.triu_indices(len(p), 1)
    return np.asarray((p[i] + p[j]) / 2)


def _circumcenters(p: Array) -> Array:
    """Centres (k, 2) of the circles through all triples that are not in line."""
    triples = p[np.array(list(combinations(range(len(p)), 3)), dtype=int).reshape(-1, 3)]
    b, c = triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0]
    cross = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    squares_b, squares_c = np.sum(b * b, axis=1), np.sum(c * c, axis=1)
    wide = np.abs(cross) > _IN_LINE * np.sqrt(squares_b * squares_c)
    x = (c[:, 1] * squares_b - b[:, 1] * squares_c)[wide] / (2 * cross[wide])
    y = (b[:, 0] * squares_c - c[:, 0] * squares_b)[wide] / (2 * cross[wide])
    return np.asarray(triples[wide, 0] + np.column_stack([x, y]))
