"""Small algebra of homographies (3, 3) that is shared by the fits.

Motion of the q plane, 8 parameters: q / scale moves by (a b c; d e f; g h 0).
"""

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.images.warp import LocalFrame


def apply(H: Array, points: Array) -> Array:
    """Images (n, 2) of points (n, 2)."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def normalised(H: Array) -> Array:
    """The same homography, its last row positive at the origin."""
    return np.asarray(H / H[2, 2])


def inverse(H: Array) -> Array:
    """The way back, its last row positive at the origin."""
    return normalised(np.asarray(np.linalg.inv(H), dtype=np.float64))


def from_points(points: Array, images: Array) -> Array:
    """Homography that maps four points (4, 2) onto four others; raises LinAlgError for three on a line."""
    centre, size = points.mean(0), float(np.abs(points - points.mean(0)).max())
    there, extent = images.mean(0), float(np.abs(images - images.mean(0)).max())
    (x, y), (u, v) = ((points - centre) / size).T, ((images - there) / extent).T
    zeros, ones = np.zeros(4), np.ones(4)
    A = np.vstack(
        [
            np.stack([x, y, ones, zeros, zeros, zeros, -u * x, -u * y], -1),
            np.stack([zeros, zeros, zeros, x, y, ones, -v * x, -v * y], -1),
        ]
    )
    h = np.linalg.solve(A, np.concatenate([u, v]))
    plane = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, size]]) / size
    back = np.array([[extent, 0, there[0]], [0, extent, there[1]], [0, 0, 1.0]])
    return normalised(back @ np.append(h, 1.0).reshape(3, 3) @ plane)


def motion_at(x: float, y: float) -> Array:
    """Motion (2, 8) of a point of the scaled q plane by the parameters (9 in docs/photometric.md)."""
    return np.array([[x, y, 1, 0, 0, 0, -x * x, -x * y], [0, 0, 0, x, y, 1, -x * y, -y * y]])


def moved(H: Array, change: Array, scale: float) -> Array:
    """The homography after a motion (8,) of the q plane."""
    to_scale = np.diag([1 / scale, 1 / scale, 1.0])
    motion = np.eye(3) + np.append(change, 0.0).reshape(3, 3)
    return normalised(np.diag([scale, scale, 1.0]) @ motion @ to_scale @ H)


def to_pixels(frame: LocalFrame, q: Array, covariance: Array, scale: float) -> tuple[Array, Array]:
    """Pixels (4, 2) of corners q (4, 2) and their covariance (8, 8), from that of the parameters (19)."""
    J = np.concatenate(
        [
            slope @ motion_at(*corner) * scale
            for slope, corner in zip(frame.pixel_slopes(q), q / scale, strict=True)
        ]
    )
    return frame.pixels_of(q), np.asarray(J @ covariance @ J.T)
