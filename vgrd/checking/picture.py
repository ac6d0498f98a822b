"""Camera and tags: intrinsics that fit the picture, tags that the lens can read."""

from collections.abc import Iterator

import numpy as np

from vgrd.checking.remarks import Remark, doubt, fault
from vgrd.config.cell_file import CameraSection, TagSection, TagsSection
from vgrd.geometry.camera import CameraModel, implausible_distortion
from vgrd.vision.inspection import LEAST_CELL_PX
from vgrd.vision.print.codes import code_count, marker_cells

_OFF_CENTRE = 0.1  # of the size; a guess: lenses are centred within 3 %, a region may be cut aside
_NEAREST_MM = 300.0  # a guess: an arm with a tag at its flange needs so much room before a camera
_MOST_RATIO = 8.0  # of two tags' sizes; a guess: below the ten of a decimal point that slipped


def camera_remarks(camera: CameraSection) -> Iterator[Remark]:
    """On the intrinsics."""
    width, height = camera.size_px
    fx, fy, cx, cy = camera.matrix
    off = _off_centre(cx, cy, width, height)
    if off > _OFF_CENTRE > _off_centre(cx, cy, height, width):
        yield doubt(
            f"{width} x {height} has its middle far from cx, cy = {cx:g}, {cy:g} of the matrix: swapped? Write "
            f"[{height}, {width}] (width, height)",
            "camera",
            "size_px",
        )
    elif off > _OFF_CENTRE:
        yield doubt(
            f"cx, cy = {cx:g}, {cy:g} lie {100 * off:.0f} % of the picture from its middle: of another picture size, "
            "or a region of the sensor? Calibrate with pictures of this size (vgrd intrinsics)",
            "camera",
            "matrix",
        )
    if camera.distortion:
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        lens = CameraModel(K, np.array(camera.distortion), (width, height))
        if problem := implausible_distortion(lens):
            yield fault(problem, "camera", "distortion")


def _off_centre(cx: float, cy: float, width: int, height: int) -> float:
    return max(abs(cx / width - 0.5), abs(cy / height - 0.5))


def tag_remarks(tags: TagsSection) -> Iterator[Remark]:
    """On ids and sizes."""
    for name, tag in (("a", tags.a), ("b", tags.b)):
        count = code_count(tag.family)
        if tag.id >= count:
            words = f"family {tag.family} has the ids 0 to {count - 1}: read it off the print"
            yield fault(words, "tags", name, "id")
        if tag.size_sigma_mm >= tag.size_mm:
            words = (
                f"{tag.size_sigma_mm:g} mm is as much as the tag: how well the size is known, 0.05"
            )
            yield doubt(words, "tags", name, "size_sigma_mm")
    small, large = sorted((tags.a, tags.b), key=lambda tag: tag.size_mm)
    if large.size_mm >= _MOST_RATIO * small.size_mm:
        name = "a" if small is tags.a else "b"
        yield doubt(
            f"{small.size_mm:g} mm, and the other tag has {large.size_mm:g}: did the decimal point slip? Measure the "
            "black square",
            "tags",
            name,
            "size_mm",
        )


def lens_remarks(camera: CameraSection, tags: TagsSection) -> Iterator[Remark]:
    """On tags that this lens reads from too near only, or sees whole from too far only."""
    focal_px = min(camera.matrix[:2])
    for name, tag in (("a", tags.a), ("b", tags.b)):
        farthest_mm = focal_px * _cell_mm(tag) / LEAST_CELL_PX
        if farthest_mm < _NEAREST_MM:
            yield doubt(
                f"{tag.size_mm:g} mm: its cells have {LEAST_CELL_PX:g} px only nearer than {farthest_mm:.0f} mm to "
                "this camera: in another unit? Else take a larger tag or a longer lens",
                "tags",
                name,
                "size_mm",
            )


def _cell_mm(tag: TagSection) -> float:
    return tag.size_mm / len(marker_cells(tag.family, 0))
