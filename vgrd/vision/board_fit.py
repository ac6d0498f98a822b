"""Boards as one photometric target: ChArUco boards and grids of tags, all of their pixels at once.

The raster ends at the board's rim; nothing is assumed about what lies around it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.devices import Grey
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.vision.boards import Charuco, detect_board
from vgrd.vision.codes import marker_cells
from vgrd.vision.finding import find_tags
from vgrd.vision.homography import apply
from vgrd.vision.planar import PlanarPose, planar_poses
from vgrd.vision.raster import Raster, joined
from vgrd.vision.refining import Refined, refine
from vgrd.vision.warp import lens_vector

_LEAST_POINTS = 4


@dataclass(frozen=True, slots=True, eq=False)
class BoardFit:
    """A measured board: its refined outer corners and all poses, best first."""

    refined: Refined
    poses: list[PlanarPose]


def charuco_raster(board: Charuco, *, legacy: bool = False) -> Raster:
    """Raster of a ChArUco board, origin in its outer corner, x along its columns, y along its rows.

    legacy: OpenCV's layout before 4.6, which differs for an even number of rows.
    """
    shift = 1 if legacy and board.rows % 2 == 0 else 0
    squares: Array = (np.indices((board.rows, board.columns)).sum(0) + shift) % 2 * 1.0
    x = board.square_mm * np.arange(board.columns + 1.0)
    y = board.square_mm * np.arange(board.rows + 1.0)
    parts: list[tuple[Array, Array, Array]] = [(squares, x, y)]
    inset = (board.square_mm - board.marker_mm) / 2
    for marker, (row, column) in enumerate(np.argwhere(squares == 1).tolist()):
        corner = board.square_mm * np.array([column, row]) + inset
        parts.append(_part(board.dictionary, marker, board.marker_mm, corner))
    return joined(parts, (x[[0, -1]], y[[0, -1]]))


def tag_board_raster(tags: Mapping[TagSpec, Array], margin_mm: float) -> Raster:
    """Raster of tags at the places of their centres (2,) mm, with white paper of `margin_mm` around."""
    parts = [
        _part(tag.family, tag.id, tag.size_mm, np.asarray(centre) - tag.size_mm / 2)
        for tag, centre in tags.items()
    ]
    x = np.array(
        [min(p[1][0] for p in parts) - margin_mm, max(p[1][-1] for p in parts) + margin_mm]
    )
    y = np.array(
        [min(p[2][0] for p in parts) - margin_mm, max(p[2][-1] for p in parts) + margin_mm]
    )
    return joined(parts, (x, y))


def fit_charuco(picture: Grey, board: Charuco, camera: CameraModel) -> BoardFit:
    """Measure a ChArUco board, in either of OpenCV's layouts. Raises TagNotSeen."""
    seen = detect_board(picture, board)
    return _fitted(
        picture,
        camera,
        seen.points_in_target[:, :2],
        seen.pixels,
        [charuco_raster(board, legacy=legacy) for legacy in (False, True)],
    )


def fit_tag_board(
    picture: Grey, tags: Mapping[TagSpec, Array], margin_mm: float, camera: CameraModel
) -> BoardFit:
    """Measure a board of tags at the places of their centres. Raises TagNotSeen."""
    place = {(tag.family, tag.id): (tag, np.asarray(centre)) for tag, centre in tags.items()}
    points, pixels = [], []
    for found in find_tags(picture, sorted({tag.family for tag in tags})):
        if (found.family, found.id) in place and not found.mirrored:
            tag, centre = place[found.family, found.id]
            unit = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
            points.append(centre + tag.size_mm / 2 * unit)
            pixels.append(found.corners_px)
    if not points:
        raise TagNotSeen("none of the board's tags is in the picture")
    raster = tag_board_raster(tags, margin_mm)
    return _fitted(picture, camera, np.concatenate(points), np.concatenate(pixels), [raster])


def _part(family: str, tag_id: int, size_mm: float, corner: Array) -> tuple[Array, Array, Array]:
    cells = marker_cells(family, tag_id)
    lines = size_mm * np.arange(len(cells) + 1) / len(cells)
    return cells, corner[0] + lines, corner[1] + lines


def _fitted(
    picture: Grey, camera: CameraModel, points: Array, pixels: Array, rasters: list[Raster]
) -> BoardFit:
    """Refine from rough points (n, 2) mm seen at pixels (n, 2), with the raster that fits best."""
    if len(points) < _LEAST_POINTS:
        raise TagNotSeen(f"{len(points)} points of the board are seen, {_LEAST_POINTS} are needed")
    H, _ = cv2.findHomography(
        points, camera.normalize(pixels), cv2.RANSAC, 1 / camera.matrix[0, 0]
    )
    if H is None:
        raise TagNotSeen("the points seen of the board do not lie on a plane")
    best: Refined | None = None
    for raster in rasters:
        rays = apply(np.asarray(H, dtype=np.float64), raster.corners)
        corners = camera.project(np.column_stack([rays, np.ones(4)]))
        refined = refine(picture, raster, corners, lens_vector(camera))
        if refined is not None and (best is None or _better(refined, best)):
            best = refined
    if best is None:
        raise TagNotSeen("the board is in the picture, but too blurred or covered to be measured")
    corners_in_board = np.column_stack([rasters[0].corners, np.zeros(4)])
    return BoardFit(best, planar_poses(camera, corners_in_board, best.corners_px, best.covariance))


def _better(one: Refined, other: Refined) -> bool:
    return bool(np.trace(one.covariance) < np.trace(other.covariance))
