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
USUAL_CAD_MM = 0.03  # a milled part; the same
USUAL_EDGE_MM = 0.05  # a tag measured with a caliper; the same


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

    touch_times, field_times, vision_times: sigma over the stated one. center_sigma_mm: stated of each axis;
    center_drawn_mm: sigma that it is drawn with; center_mm: how far it is off beyond that. cad_mm: sigma of
    every coordinate of a target. size_a, size_b: of a tag, relative; ink_x_mm, ink_y_mm: by which every
    black edge of both tags lies farther out. camera_mm: and as many mrad. focal: relative. skew_s: between
    pictures and poses of an arm that is filmed on its way.
    """

    touch_times: float = 1.0
    touching: Touching = Touching.NORMAL
    center_sigma_mm: float = EXACT_CENTER_MM
    center_drawn_mm: float = EXACT_CENTER_MM
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
    """A row of the catalogue. causes: codes of findings and names of links that tell it rightly; none: clean.

    turned: whether half of the touches were taken after the object was turned half round, as advised.
    """

    world: World
    causes: frozenset[str] = frozenset()
    turned: bool = True


# Which codes (vgrd/judging/findings.py) and links tell a misfit rightly: edit with the findings.
_TOUCHES = frozenset({"touch_outlier", "touches_scatter", "touch_noise"})
_CENTER = frozenset({"pivot_disagrees", "center_off"})
_CAD = frozenset({"points_order", "touch_outlier", "touch_noise", "cad_off", "cad_noise"})
_TAG_A = frozenset({"tag_size"})
_TAG_B = frozenset({"tag_size"})
_PRINT = frozenset({"tag_size", "tag_stretched", "tag_noise"})
_CAMERA = frozenset({"camera_moved", "camera"})
_ARM = frozenset({"hand_eye_noise", "noisy", "arm_noise"})
_AXIS = frozenset({"spins_not_about_one_axis"})
_LENS = frozenset({"lens_off", "tag_size"})  # the remedy of the latter names the focal length
_VISION = frozenset({"noisy", "hand_eye_noise", "tag_noise"})
_TIME = frozenset({"time_offset", "picture_delay"})

BEFORE = (
    "clean, centre 0.02 stated, one turn"  # as all sessions were before any noise was estimated
)

ROWS: Mapping[str, MisfitRow] = MappingProxyType(
    {
        "clean, centre 0.02 stated": MisfitRow(World()),
        BEFORE: MisfitRow(World(), turned=False),
        "clean": MisfitRow(
            World(center_sigma_mm=USUAL_CENTER_MM, center_drawn_mm=USUAL_CENTER_MM)
        ),
        "touch sigma x 0.5": MisfitRow(World(touch_times=0.5), _TOUCHES),
        "touch sigma x 2": MisfitRow(World(touch_times=2), _TOUCHES),
        "touches of t3 tails": MisfitRow(World(touching=Touching.TAILS), _TOUCHES),
        "10 % of touches outliers": MisfitRow(World(touching=Touching.OUTLIERS), _TOUCHES),
        "centre 0.1 mm off, 0.02 stated": MisfitRow(World(center_mm=0.1), _CENTER),
        "centre 1 mm off, 0.02 stated": MisfitRow(World(center_mm=1.0), _CENTER),
        "centre 0.1 mm off": MisfitRow(
            World(center_mm=0.1, center_drawn_mm=0.0, center_sigma_mm=USUAL_CENTER_MM), _CENTER
        ),
        "centre 1 mm off": MisfitRow(
            World(center_mm=1.0, center_drawn_mm=0.0, center_sigma_mm=USUAL_CENTER_MM), _CENTER
        ),
        "centre 1 mm off, 0.02 stated, one turn": MisfitRow(
            World(center_mm=1.0), _CENTER, turned=False
        ),
        "CAD 0.1 mm off": MisfitRow(World(cad_mm=0.1), _CAD),
        "tag A 1 % off": MisfitRow(World(size_a=0.01), _TAG_A),
        "tag B 1 % off": MisfitRow(World(size_b=0.01), _TAG_B),
        "ink 0.01 mm in x": MisfitRow(World(ink_x_mm=0.01), _PRINT),
        "ink 0.01 mm in y": MisfitRow(World(ink_y_mm=0.01), _PRINT),
        "ink 0.01 mm in both": MisfitRow(World(ink_x_mm=0.01, ink_y_mm=0.01), _PRINT),
        **{
            f"camera {mm:g} mm {move.value} teaching": MisfitRow(
                World(move=move, camera_mm=mm), _CAMERA
            )
            for move in (Move.BEFORE, Move.DURING, Move.AFTER)
            for mm in (0.2, 0.5, 1.0)
        },
        "arm field x 3": MisfitRow(World(field_times=3), _ARM),
        "axis tilted by 0.3 deg": MisfitRow(World(axis_tilt_deg=0.3), _AXIS),
        "intrinsics 0.3 % off": MisfitRow(World(focal=0.003), _LENS),
        "tag noise x 3": MisfitRow(World(vision_times=3), _VISION),
        "time skew 20 ms": MisfitRow(World(skew_s=0.02), _TIME),
    }
)
