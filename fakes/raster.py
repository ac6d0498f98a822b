"""Exact drawing of a tag: the share of white in every pixel, through perspective, distortion and blur."""

import cv2
import numpy as np

from fakes.layout import Layout
from fakes.sensor import Plane, Region
from fakes.visibility import PLATE_CELLS
from vgrd.geometry import Array, Pose
from vgrd.model import TagSpec

BLOCK = 4  # px between exactly projected points; bilinear between them is exact to 5e-4 px
_FINE = 3  # fine samples per pixel and axis
_REACH = 0.03  # cells by which the box of a sample may stick out of its block


def tag_cells(tag: TagSpec) -> Plane:
    """Raster (10, 10) of a tag with its white border, 0 black to 1 white, row 0 at y = -size/2."""
    dictionary = cv2.aruco.getPredefinedDictionary(
        getattr(cv2.aruco, f"DICT_APRILTAG_{tag.family}")
    )
    marker = cv2.aruco.generateImageMarker(dictionary, tag.id, 8, borderBits=1)
    as_published = marker[::-1, ::-1]  # OpenCV draws AprilTags turned by 180 deg
    return np.pad((as_published > 127).astype(np.float32), 1, constant_values=1.0)


def coverage(layout: Layout, camera_from_tag: Pose, tag: TagSpec, region: Region) -> Plane:
    """Share of white (height, width) that each pixel of a region receives, blur included.

    Outside of the plate all is white. Area-accurate; blur after `Optics.blur_px` at the tag's
    centre. The region's sides are whole blocks.
    """
    sigma = layout.optics.blur_px(float(camera_from_tag.translation[2]))
    pad = BLOCK * int(np.ceil((4 * sigma + 1) / BLOCK))
    corners = _cells_at_corners(layout, camera_from_tag, tag, region, pad)
    fine = _white_share(tag_cells(tag), corners)
    size = 2 * int(np.ceil(4 * sigma * _FINE)) + 1
    fine = np.asarray(
        cv2.GaussianBlur(fine, (size, size), sigma * _FINE, borderType=cv2.BORDER_REPLICATE),
        np.float32,
    )
    inner = fine[pad * _FINE : -pad * _FINE, pad * _FINE : -pad * _FINE]
    return np.asarray(
        cv2.resize(inner, (region.width, region.height), interpolation=cv2.INTER_AREA)
    )


def _cells_at_corners(
    layout: Layout, camera_from_tag: Pose, tag: TagSpec, region: Region, pad: int
) -> Array:
    """Cell coordinates (rows + 1, columns + 1, 2), (u right, v down), exact at the corners of the blocks."""
    x = region.x - pad - 0.5 + BLOCK * np.arange((region.width + 2 * pad) // BLOCK + 1)
    y = region.y - pad - 0.5 + BLOCK * np.arange((region.height + 2 * pad) // BLOCK + 1)
    rays = layout.optics.rays(np.stack(np.meshgrid(x, y), -1))
    R, t = camera_from_tag.rotation, camera_from_tag.translation
    plane_from_ray = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    mapped = rays @ plane_from_ray[:, :2].T + plane_from_ray[:, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:] * (8 / tag.size_mm) + PLATE_CELLS / 2)


def _white_share(cells: Plane, corners: Array) -> Plane:
    """Share of white in the box of each fine sample of all blocks.

    A block in which nothing changes takes its cell's value; in the others an edge line that cuts
    the box of a sample weighs the cells on both sides by their share of the box.
    """
    raster = np.pad(cells, 2, constant_values=1.0)
    four = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]])
    last = len(raster) - 1
    low = np.clip(np.floor(four.min(0) - _REACH) + 2, 0, last).astype(np.intp)
    high = np.clip(np.floor(four.max(0) + _REACH) + 2, 0, last).astype(np.intp)
    first = raster[low[..., 1], low[..., 0]]
    mixed = (
        (raster[low[..., 1], high[..., 0]] != first)
        | (raster[high[..., 1], low[..., 0]] != first)
        | (raster[high[..., 1], high[..., 0]] != first)
        | (high - low > 1).any(-1)
    )
    side = BLOCK * _FINE
    rows, columns = first.shape
    fine = np.repeat(np.repeat(first, side, 0), side, 1)
    samples = _mixed_samples(raster, four[:, mixed])
    fine.reshape(rows, side, columns, side).transpose(0, 2, 1, 3)[mixed] = samples
    return fine


def _mixed_samples(raster: Plane, four: Array) -> Plane:
    """Shares (n, side, side) in blocks with the cell coordinates `four` (4, n, 2) at their corners.

    A block is smaller than half a cell, so one edge line in u and one in v can cut it.
    """
    side = BLOCK * _FINE
    a = (np.arange(side) + 0.5) / side
    ramp = np.stack([1 - a, a])
    weights = np.einsum("pi,qj->pqij", ramp, ramp).reshape(4, -1).astype(np.float32)
    step_x = (four[1] - four[0] + four[3] - four[2]) / (2 * side)
    step_y = (four[2] - four[0] + four[3] - four[1]) / (2 * side)
    edge = np.rint(four.mean(0))
    beyond = ((four - edge) / (np.abs(step_x) + np.abs(step_y)) + 0.5).astype(np.float32)
    right, below = (np.clip(beyond[..., axis].T @ weights, 0, 1) for axis in (0, 1))
    u, v = np.clip(edge.T.astype(np.intp) + 2, 1, len(raster) - 1)
    here, to_right = raster[v - 1, u - 1], raster[v - 1, u] - raster[v - 1, u - 1]
    to_below = raster[v, u - 1] - here
    twist = raster[v, u] - raster[v, u - 1] - to_right
    share = here[:, None] + right * to_right[:, None]
    share += below * (to_below[:, None] + right * twist[:, None])
    return np.asarray(share).reshape(-1, side, side)
