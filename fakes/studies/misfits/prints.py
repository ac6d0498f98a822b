"""Where a detector that trusts the file puts a tag whose print or lens is another: a fit of its edges, no pictures.

Ink makes every black field wider: each edge lies farther out in the plane of the tag. The fit moves a perfect tag until
its edges lie, across themselves, on those of the picture. As the detectors do it allows for edges that all
moved alike in the picture, by which light and lens widen them.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from vgrd.geometry import Array, Pose, hat
from vgrd.model import TagSpec

_ROUNDS = 4  # of Gauss-Newton, from a start that is off by a hundredth
_PLACES = (0.25, 0.75)  # of each cell's side: two points tell how it is turned


@dataclass(frozen=True, slots=True, eq=False)
class Print:
    """How a tag was printed: size over the stated one, and ink (2,) mm by which edges across x and y lie out."""

    size: float
    ink_mm: Array

    @property
    def is_as_stated(self) -> bool:
        """Whether nothing is wrong with it."""
        return self.size == 1 and not self.ink_mm.any()


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Points (n, 3) on the edges of a tag of size 1, outward: (n, 3) from black to white."""

    points: Array
    outward: Array


def seen_as(tag: TagSpec, printed: Print, truth: Pose, K_true: Array, K_file: Array) -> Pose:
    """camera_from_tag that fits best; truth: where the tag really is. K_*: (3, 3)."""
    edges = _edges(tag.family, tag.id)
    points = tag.size_mm * edges.points
    ink = edges.outward * [*printed.ink_mm, 0.0]
    seen = _project(truth @ (printed.size * points + ink), K_true)
    along = np.cross(edges.outward, (0, 0, 1.0))
    pose = truth
    for _ in range(_ROUNDS):
        in_camera = pose @ points
        image = _project(in_camera, K_file)
        J_image = _derivative(in_camera, K_file) @ pose.rotation
        side = np.einsum("nij,nj->ni", J_image, along)
        normal = np.stack([-side[:, 1], side[:, 0]], 1) / np.linalg.norm(side, axis=1)[:, None]
        outward = np.einsum("ni,nij,nj->n", normal, J_image, edges.outward)
        normal *= np.sign(outward)[:, None]
        J_pose = np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -hat(points)], 2)
        J = np.einsum("ni,nij,njk->nk", normal, J_image, J_pose)
        widened = np.ones((len(points), 1))
        step = np.linalg.lstsq(
            np.hstack([J, widened]), np.sum(normal * (seen - image), axis=1), rcond=None
        )[0]
        pose = pose @ Pose.exp(step[:6])
    return pose


@cache
def _edges(family: str, tag_id: int) -> _Edges:
    library = cv2.aruco.getPredefinedDictionary(
        getattr(cv2.aruco, f"DICT_APRILTAG_{family.upper()}")
    )
    side = library.markerSize + 2
    white = cv2.aruco.generateImageMarker(library, tag_id, side, borderBits=1) > 127
    white = np.pad(white, 1, constant_values=True)
    points, outward = [], []
    for axis, step in ((0, (0, 1)), (1, (1, 0))):
        nexts = white[step[0] :, step[1] :]
        change = nexts.astype(int) - white[: nexts.shape[0], : nexts.shape[1]]
        for row, column in np.argwhere(change):
            for place in _PLACES:
                at = np.array([column, row], float) + place - 1
                at[axis] = (column, row)[axis]
                points.append([*(at / side - 0.5), 0.0])
                outward.append(change[row, column] * np.eye(3)[axis])
    return _Edges(np.array(points), np.array(outward))


def _project(points: Array, K: Array) -> Array:
    rays = points @ K.T
    return np.asarray(rays[:, :2] / rays[:, 2:])


def _derivative(points: Array, K: Array) -> Array:
    """(n, 2, 3) of the projection by points (n, 3)."""
    pixels = _project(points, K)
    J = np.empty((len(points), 2, 3))
    J[:, :, :] = K[:2]
    J -= pixels[:, :, None] * K[2]
    return J / points[:, 2][:, None, None]
