"""Boards as one photometric target: ChArUco boards and grids of tags, all of their pixels at once.

The raster ends at the board's rim; nothing is assumed about what lies around it. What contradicts the
board as it is stated is refused: a homography would follow a wrong board without a word.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass

import cv2
import numpy as np

from vgrd.devices import Grey
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.pose import hat
from vgrd.model import TagSpec
from vgrd.vision.alignment.refinement import Refined, refine
from vgrd.vision.boards.sizes import marker_excess, seen_share
from vgrd.vision.images.homography import apply
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.boards import Charuco, detect_board
from vgrd.vision.print.codes import marker_cells, square_corners
from vgrd.vision.print.raster import Raster, joined
from vgrd.vision.print.targets import TagGrid
from vgrd.vision.tags.causes import cause_for_target
from vgrd.vision.tags.detection import FoundTag, find_tags
from vgrd.vision.tags.planar_pose import PlanarPose, planar_poses

MeasurableBoard = Charuco | TagGrid

NO_JOINTS: Array = np.zeros((0, 2))  # a board without squares between its tags
_RIGHT_FILE = ": is its file the right one?"  # asked where nothing tells the cause
_LEAST_POINTS = 4  # of a homography
_POINT_PX = 4.0  # by which a point that was only detected, on a bent board, may be off
_AGREEING = 0.9  # share of points that are where the board has them; a guess: one of ten is wrong
_LEAST_EXCESS = 0.002  # of the markers' size, told; a real board had 0.003 to 0.01
_MOST_EXCESS = 0.02  # idem, refused: another board than its file says, not another print of it
_EXCESS_SIGMAS = 5.0  # of its own noise: chance does that once in 2 million
_MOST_SIGMA_PX = 1.0  # of the outline: beyond it a pose is not linear in the corners
_RANSAC_PX = 1.0  # of the points for the start; a guess: the better ones are enough


@dataclass(frozen=True, slots=True, eq=False)
class BoardFit:
    """A measured board: its refined outer corners and all poses, best first.

    outline (4, 3): those corners in the board's frame, mm; excess: share by which the ratio of its
    markers' size to their distances is larger than stated; 0 where the difference is not significant.
    seen: share of its edges that the picture shows, also where they were printed a little off.
    """

    refined: Refined
    poses: list[PlanarPose]
    outline: Array
    excess: float
    seen: float

    @property
    def covariance(self) -> Array:
        """Covariance (6, 6) of the best pose, widened by the outline's scatter and by the excess.

        Nothing tells which of two contradicting sizes is wrong. So the excess is taken as a sigma: of the
        distance and of the place as shares of the distance and of the board's size, of the direction in rad.
        """
        best = self.poses[0]
        t, extent = best.pose.translation, float(np.ptp(self.outline, axis=0).max())
        J_sizes = np.zeros((6, 7))
        J_sizes[:3] = np.hstack([t[:, None], extent * np.eye(3), hat(t)])
        J_sizes[3:, 4:] = np.eye(3)
        return np.asarray(best.inflated_covariance + self.excess**2 * J_sizes @ J_sizes.T)


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """One way to print a board: its raster, and its markers (n, 2, 2), lowest and highest (x, y), mm."""

    raster: Raster
    markers: Array


def fit_board(picture: Grey, board: MeasurableBoard, camera: CameraModel) -> BoardFit:
    """Measure a board, as `fit_charuco` or `fit_tag_board` do. Raises TagNotSeen."""
    if isinstance(board, Charuco):
        return fit_charuco(picture, board, camera)
    centres = {
        TagSpec(board.dictionary, tag_id, board.size_mm): corners[:, :2].mean(0)
        for tag_id, corners in board.corners().items()
    }
    joints = board.joints()
    try:
        return fit_tag_board(
            picture, centres, board.gap_mm if len(joints) else board.cell_mm, camera, joints
        )
    except TagNotSeen as error:
        cause = cause_for_target(picture, board)
        if cause is None:
            raise
        raise TagNotSeen(f"{str(error).removesuffix(_RIGHT_FILE)}; {cause}") from error


def charuco_raster(board: Charuco, *, legacy: bool = False) -> Raster:
    """Raster of a ChArUco board, origin in its outer corner, x along its columns, y along its rows.

    legacy: OpenCV's layout before 4.6, which differs for an even number of rows.
    """
    return _charuco_layout(board, legacy=legacy).raster


def tag_board_raster(tags: Mapping[TagSpec, Array], margin_mm: float) -> Raster:
    """Raster of tags at the places of their centres (2,) mm, with white paper of `margin_mm` around."""
    return _tags_layout(tags, margin_mm).raster


def fit_charuco(picture: Grey, board: Charuco, camera: CameraModel) -> BoardFit:
    """Measure a ChArUco board, in either of OpenCV's layouts.

    Raises TagNotSeen when it is not in the picture, is there twice, shows too little of itself, or has
    other sizes than stated.
    """
    markers = {(board.dictionary, tag_id) for tag_id in board.marker_ids}
    _single(find_tags(picture, [board.dictionary]), markers)
    try:
        detection = detect_board(picture, board)
    except TagNotSeen as error:
        cause = cause_for_target(picture, board)
        remedy = cause or "show more of it, or correct columns, rows and dictionary of its file"
        raise TagNotSeen(f"{error}: {remedy}") from error
    both = (False, True) if board.rows % 2 == 0 else (False,)
    layouts = [_charuco_layout(board, legacy=legacy) for legacy in both]
    return _fitted(picture, camera, detection.points_in_target[:, :2], detection.pixels, layouts)


def fit_tag_board(
    picture: Grey,
    tags: Mapping[TagSpec, Array],
    margin_mm: float,
    camera: CameraModel,
    joints: Array = NO_JOINTS,
) -> BoardFit:
    """Measure a board of tags at the places of their centres (2,) mm. Raises as `fit_charuco`.

    joints (n, 2): lowest corners of black squares of edge margin_mm, mm.
    """
    place = {(tag.family, tag.id): (tag, np.asarray(centre)) for tag, centre in tags.items()}
    points, pixels = [], []
    candidates = find_tags(picture, sorted({tag.family for tag in tags}))
    for marker in _single(candidates, place.keys()):
        tag, centre = place[marker.family, marker.id]
        points.append(centre + square_corners(tag.size_mm)[:, :2])
        pixels.append(marker.corners_px)
    if not points:
        raise TagNotSeen(f"none of the board's tags is in the picture{_RIGHT_FILE}")
    layout = _tags_layout(tags, margin_mm, joints)
    return _fitted(picture, camera, np.concatenate(points), np.concatenate(pixels), [layout])


def _single(tags: Iterable[FoundTag], ids: Set[tuple[str, int]]) -> list[FoundTag]:
    """The markers of a board; TagNotSeen when one is there twice, or all as in a mirror."""
    markers = [tag for tag in tags if (tag.family, tag.id) in ids]
    upright = [tag for tag in markers if not tag.mirrored]
    if markers and not upright:
        raise TagNotSeen("the board is seen as in a mirror: printed wrongly, or a flipped picture")
    counts = Counter(tag.id for tag in upright)
    twice = [str(tag_id) for tag_id, count in sorted(counts.items()) if count > 1]
    if twice:
        raise TagNotSeen(
            f"markers of the board are in the picture several times (ids {', '.join(twice)}): "
            "cover or remove the others"
        )
    return upright


def _charuco_layout(board: Charuco, *, legacy: bool) -> _Layout:
    shift = 1 if legacy and board.rows % 2 == 0 else 0
    squares: Array = (np.indices((board.rows, board.columns)).sum(0) + shift) % 2 * 1.0
    x = board.square_mm * np.arange(board.columns + 1.0)
    y = board.square_mm * np.arange(board.rows + 1.0)
    inset = (board.square_mm - board.marker_mm) / 2
    markers = [
        _part(
            board.dictionary,
            board.first_id + i,
            board.marker_mm,
            board.square_mm * np.array([column, row]) + inset,
        )
        for i, (row, column) in enumerate(np.argwhere(squares == 1).tolist())
    ]
    raster = joined([(squares, x, y), *markers], (x[[0, -1]], y[[0, -1]]))
    return _Layout(raster, _extents(markers))


def _tags_layout(
    tags: Mapping[TagSpec, Array], margin_mm: float, joints: Array = NO_JOINTS
) -> _Layout:
    parts = [
        _part(tag.family, tag.id, tag.size_mm, np.asarray(centre) - tag.size_mm / 2)
        for tag, centre in tags.items()
    ]
    extents = _extents(parts)
    low, high = extents[:, 0].min(0) - margin_mm, extents[:, 1].max(0) + margin_mm
    rim = (np.array([low[0], high[0]]), np.array([low[1], high[1]]))
    squares = [
        (np.zeros((1, 1)), x + margin_mm * np.arange(2.0), y + margin_mm * np.arange(2.0))
        for x, y in joints
    ]
    return _Layout(joined([*parts, *squares], rim), extents)


def _part(family: str, tag_id: int, size_mm: float, corner: Array) -> tuple[Array, Array, Array]:
    cells = marker_cells(family, tag_id)
    lines = size_mm * np.arange(len(cells) + 1) / len(cells)
    return cells, corner[0] + lines, corner[1] + lines


def _extents(parts: Sequence[tuple[Array, Array, Array]]) -> Array:
    return np.array([[[x[0], y[0]], [x[-1], y[-1]]] for _, x, y in parts])


def _fitted(
    picture: Grey, camera: CameraModel, points: Array, pixels: Array, layouts: Sequence[_Layout]
) -> BoardFit:
    """Refine from rough points (n, 2) mm seen at pixels (n, 2), with the layout that fits best."""
    if len(points) < _LEAST_POINTS:
        raise TagNotSeen(f"{len(points)} points of the board are seen, {_LEAST_POINTS} are needed")
    H, _ = cv2.findHomography(
        points, camera.normalize(pixels), cv2.RANSAC, _RANSAC_PX / camera.matrix[0, 0]
    )
    if H is None:
        raise TagNotSeen("the points seen of the board do not lie on a plane")
    rays_from_board = np.asarray(H, dtype=np.float64)
    _check_agreement(_projected(camera, rays_from_board, points) - pixels)
    lens = lens_vector(camera)
    fits: list[tuple[Refined, _Layout]] = []
    for layout in layouts:
        corners = _projected(camera, rays_from_board, layout.raster.corners)
        refined = refine(picture, layout.raster, corners, lens, lines_are_sure=True)
        if refined is not None:
            fits.append((refined, layout))
    if not fits:
        raise TagNotSeen("the board is in the picture, but too blurred or covered to be measured")
    best, layout = min(fits, key=lambda fit: float(np.trace(fit[0].covariance)))
    sigma = float(np.sqrt(np.diag(best.covariance).max()))
    if sigma > _MOST_SIGMA_PX:
        raise TagNotSeen(
            f"too little of the board is seen: its outline is uncertain by {sigma:.1f} px; "
            "uncover it, or bring it into the picture"
        )
    excess = _significant(
        *marker_excess(picture, layout.raster, layout.markers, best.corners_px, lens)
    )
    outline = np.column_stack([layout.raster.corners, np.zeros(4)])
    poses = planar_poses(camera, outline, best.corners_px, best.covariance)
    seen = seen_share(picture, layout.raster, best.corners_px, lens)
    return BoardFit(best, poses, outline, excess, seen)


def _projected(camera: CameraModel, rays_from_board: Array, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 2) mm of the board."""
    return camera.project(np.column_stack([apply(rays_from_board, points), np.ones(len(points))]))


def _check_agreement(residuals: Array) -> None:
    """Refuse a board whose points do not lie on one plane, by their residuals (n, 2), px."""
    agreeing = np.linalg.norm(residuals, axis=1) < _POINT_PX
    if agreeing.mean() < _AGREEING:
        raise TagNotSeen(
            f"{np.sum(~agreeing)} of {len(residuals)} points of the board are not where its file has them: "
            "are columns, rows and sizes those of this board, is it flat, is the camera file right?"
        )


def _significant(excess: float, sigma: float) -> float:
    """The excess of the markers' size, 0 where it is not significant; refuses one above 2 %."""
    if abs(excess) < max(_LEAST_EXCESS, _EXCESS_SIGMAS * sigma):
        return 0.0
    if abs(excess) > _MOST_EXCESS:
        raise TagNotSeen(sizes_remark(excess))
    return excess


def sizes_remark(excess: float) -> str:
    """The remark about markers whose size, against their distances, exceeds the stated one by a share."""
    return (
        f"its markers are about {abs(excess):.1%} {'larger' if excess > 0 else 'smaller'}, against "
        "their distances, than its file says: measure both, and correct the file"
    )
