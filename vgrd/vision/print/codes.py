"""Printed codes: the families and dictionaries by name, and the raster of cells of every marker.

Frame of a marker: x right, y down, z into the paper, origin in its centre. AprilTags are upright as
their library publishes them; OpenCV draws the same codes turned by 180 degrees. A dictionary that
is named as OpenCV names it ("DICT_APRILTAG_36h11") keeps OpenCV's turn.
"""

from functools import cache
from itertools import product

import cv2
import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array

APRILTAG_FAMILIES = (
    "16h5",
    "25h9",
    "36h10",
    "36h11",
)  # those whose outer edge is the black square
ARUCO_DICTIONARIES = {
    f"{bits}x{bits}_{count}": getattr(cv2.aruco, f"DICT_{bits}X{bits}_{count}")
    for bits, count in product((4, 5, 6, 7), (50, 100, 250, 1000))  # as OpenCV predefines them
} | {
    "original": cv2.aruco.DICT_ARUCO_ORIGINAL,
    "mip_36h12": cv2.aruco.DICT_ARUCO_MIP_36H12,
    "apriltag_16h5": cv2.aruco.DICT_APRILTAG_16H5,
    "apriltag_25h9": cv2.aruco.DICT_APRILTAG_25H9,
    "apriltag_36h10": cv2.aruco.DICT_APRILTAG_36H10,
    "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36H11,
}
SQUARE_FAMILIES = (*APRILTAG_FAMILIES, *ARUCO_DICTIONARIES)


def family_named(name: str) -> str:
    """The family that a user means: "36h11", "tag36h11", "DICT_4X4_50", "4x4_50", "DICT_ARUCO_ORIGINAL".

    Raises InputError naming the known ones.
    """
    plain = name.lower().removeprefix("dict_").removeprefix("tag").removeprefix("aruco_")
    if plain not in SQUARE_FAMILIES:
        raise InputError(f"tag family {name!r} is unknown; known: {', '.join(SQUARE_FAMILIES)}")
    return plain


@cache
def dictionary_of(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary with the codes of a square family."""
    name = f"apriltag_{family}" if family in APRILTAG_FAMILIES else family
    return cv2.aruco.getPredefinedDictionary(ARUCO_DICTIONARIES[name])


def code_count(family: str) -> int:
    """How many ids a square family has."""
    return len(dictionary_of(family).bytesList)


@cache
def marker_cells(family: str, tag_id: int) -> Array:
    """Raster (n, n) of a marker with its black border, 0 black to 1 white, row 0 at the smallest y.

    Read-only. Raises InputError when the family has no such id.
    """
    if not 0 <= tag_id < code_count(family):
        raise InputError(f"tag {tag_id}: {family} has the ids 0 to {code_count(family) - 1}")
    dictionary = dictionary_of(family)
    side = dictionary.markerSize + 2
    drawn = cv2.aruco.generateImageMarker(dictionary, tag_id, side, borderBits=1)
    upright = drawn[::-1, ::-1] if family in APRILTAG_FAMILIES else drawn
    cells = np.array(upright > 127, dtype=np.float64)
    cells.setflags(write=False)
    return cells


def square_corners(size_mm: float) -> Array:
    """Corners (4, 3) of a marker's black square in its own frame: (-,-), (+,-), (+,+), (-,+), mm."""
    return size_mm / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
