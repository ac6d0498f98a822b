"""A photograph of one printed tag: print, lens, light and sensor together."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fakes.camera.foreign.optics import Spread, Window, bell, projected
from fakes.camera.foreign.sensor import Light, Sensor, exposed, lit
from fakes.camera.foreign.sheet import Printer, printed
from vgrd.geometry import Array, Pose

_SHARP_PX = 0.7  # sigma of a good lens, in focus


@dataclass(frozen=True, slots=True)
class Conditions:
    """How a photograph is made. spread: point spread of the lens, None: sharper than the pixels.

    reach_px: how far the spread is felt.
    """

    printer: Printer = field(default_factory=Printer)
    spread: Spread | None = field(default_factory=lambda: bell(_SHARP_PX))
    reach_px: float = 4.0
    light: Light = field(default_factory=Light)
    sensor: Sensor = field(default_factory=Sensor)


def photograph(
    dictionary: int,
    tag_id: int,
    size_mm: float,
    camera_from_tag: Pose,
    matrix: Array,
    size_px: tuple[int, int],
    conditions: Conditions,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Grey picture (height, width) of a tag on white paper that fills it; the same seed gives the same."""
    window = Window(0, 0, *size_px)
    across_px = matrix[0, 0] * size_mm / camera_from_tag.translation[2]
    cell_px = int(np.clip(8 * across_px / 10, 16, 64))
    sheet = printed(dictionary, tag_id, size_mm, conditions.printer, rng, cell_px)
    share = projected(
        sheet, camera_from_tag, matrix, window, conditions.spread, conditions.reach_px
    )
    return exposed(lit(share, conditions.light, rng), conditions.sensor, rng)
