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

BORDER_CELLS = {"36h11_border2": 2}  # as Kalibr prints AprilGrids; all others have 1
APRILTAG_FAMILIES = (
    *("16h5", "25h9", "36h10", "36h11"),
    *BORDER_CELLS,
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
LIBRARY_FAMILIES = {  # found by pyapriltags, by its name; their black square is not the outer edge
    "circle21h7": "tagCircle21h7",
    "circle49h12": "tagCircle49h12",
    "standard41h12": "tagStandard41h12",
    "standard52h13": "tagStandard52h13",
}


def family_named(name: str) -> str:
    """The family that a user means: "36h11", "tag36h11", "DICT_4X4_50", "4x4_50", "DICT_ARUCO_ORIGINAL".

    Raises InputError naming the known ones.
    """
    plain = plain_family(name)
    if plain in LIBRARY_FAMILIES:
        raise InputError(
            f"tag family {name!r} is found in pictures as single tags only, at the library's corners; "
            f"for this, take one of {', '.join(SQUARE_FAMILIES)}"
        )
    if plain not in SQUARE_FAMILIES:
        raise InputError(f"tag family {name!r} is unknown; known: {', '.join(SQUARE_FAMILIES)}")
    return plain


def detectable_family(name: str) -> str:
    """As `family_named`, and the families whose border lies inside of the tag: "standard41h12"."""
    plain = plain_family(name)
    if plain in LIBRARY_FAMILIES:
        return plain
    if plain not in SQUARE_FAMILIES:
        known = ", ".join((*SQUARE_FAMILIES, *LIBRARY_FAMILIES))
        raise InputError(f"tag family {name!r} is unknown; known: {known}")
    return plain


def plain_family(name: str) -> str:
    """The name without what libraries put before it: "DICT_4X4_50" is 4x4_50, "tagStandard41h12" standard41h12."""
    return name.lower().removeprefix("dict_").removeprefix("tag").removeprefix("aruco_")


@cache
def dictionary_of(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary with the codes of a square family."""
    code = family.removesuffix("_border2")
    name = f"apriltag_{code}" if family in APRILTAG_FAMILIES else family
    return cv2.aruco.getPredefinedDictionary(ARUCO_DICTIONARIES[name])


def border_cells(family: str) -> int:
    """How wide the black border of a marker is, cells."""
    return BORDER_CELLS.get(family, 1)


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
    border = border_cells(family)
    side = dictionary.markerSize + 2 * border
    drawn = cv2.aruco.generateImageMarker(dictionary, tag_id, side, borderBits=border)
    upright = drawn[::-1, ::-1] if family in APRILTAG_FAMILIES else drawn
    cells = np.array(upright > 127, dtype=np.float64)
    cells.setflags(write=False)
    return cells


def square_corners(size_mm: float) -> Array:
    """Corners (4, 3) of a marker's black square in its own frame: (-,-), (+,-), (+,+), (-,+), mm."""
    return size_mm / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
