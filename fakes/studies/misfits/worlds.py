"""How a cell differs from its file: one row of the catalogue each, and the names that tell it rightly.

Sizes are the issue's. What a clean cell still is off its file stands here too, so that truth and estimate share
no constant.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

EXACT_CENTER_MM = 0.02  # a bored centre; what "stated" rows say of it
USUAL_CENTER_MM = 0.2  # a centre measured by hand; what a file says that says nothing


class Touching(StrEnum):
    """Distribution of what touches miss by."""

    NORMAL = "normal"
    TAILS = "t3"  # Student's t of 3 degrees of freedom, as wide as stated in variance
    OUTLIERS = "outliers"  # one of ten is a blunder


class Move(StrEnum):
    """When the camera is knocked."""

    NEVER = "never"
    BEFORE = "before"  # the object is taught: between the looks and what follows
    DURING = "during"  # before any one of the later pictures
    AFTER = "after"  # teaching, before the answers


@dataclass(frozen=True, slots=True)
class World:
    """What differs; the defaults are a cell that is as its file says. Signs and directions are drawn.

    touch_times, field_times, vision_times: sigma over the stated one. center_sigma_mm: per axis, drawn and
    stated; center_mm: how far the stated centre is off beyond that. cad_mm: sigma of every coordinate of a
    target. size_a, size_b: of a tag, relative; ink_x_mm, ink_y_mm: by which every black edge of both tags
    lies farther out. camera_mm: and as many mrad. focal: relative. skew_s: between pictures and poses of
    an arm that is filmed on its way.
    """

    touch_times: float = 1.0
    touching: Touching = Touching.NORMAL
    center_sigma_mm: float = EXACT_CENTER_MM
    center_mm: float = 0.0
    cad_mm: float = 0.0
    size_a: float = 0.0
    size_b: float = 0.0
    ink_x_mm: float = 0.0
    ink_y_mm: float = 0.0
    move: Move = Move.NEVER
    camera_mm: float = 0.0
    field_times: float = 1.0
    axis_tilt_deg: float = 0.0
    focal: float = 0.0
    vision_times: float = 1.0
    skew_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MisfitRow:
    """A row of the catalogue. causes: codes of findings and names of links that tell it rightly; none: clean."""

    world: World
    causes: frozenset[str] = frozenset()


_TOUCHES = frozenset({"touch_outlier", "touches_scatter"})
_CENTER = frozenset({"pivot_disagrees"})

ROWS: Mapping[str, MisfitRow] = MappingProxyType(
    {
        "clean, centre 0.02 stated": MisfitRow(World()),
        "touch sigma x 2": MisfitRow(World(touch_times=2), _TOUCHES),
        "centre 1 mm off, 0.02 stated": MisfitRow(World(center_mm=1.0), _CENTER),
    }
)
