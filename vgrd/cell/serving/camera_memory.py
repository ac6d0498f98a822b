"""What pictures have told of the camera's place: tag A in this picture, or a while ago in another one."""

import math
from dataclasses import replace

import numpy as np

from vgrd.cell.measuring import Sight
from vgrd.geometry import Array
from vgrd.model import CameraPlace, FlangeTag

MEMORY_S = 60.0  # a guess: in it a camera may have moved again as far as its stability says


class CameraMemory:
    """Remembers the newest picture of tag A with the arm at rest, so that no knock is ever forgotten.

    stability: (6,) sigmas (mm, rad) as in `CameraPlace`.
    """

    def __init__(self, stability: Array) -> None:
        self.stability = stability
        self._newest: tuple[float, FlangeTag] | None = None

    def see(self, sight: Sight) -> None:
        """Note what a picture tells of the camera, if it tells anything."""
        if sight.tag_a is not None and sight.base_from_wrist is not None:
            self._newest = (sight.stamp_s, FlangeTag(sight.tag_a, sight.base_from_wrist))

    def place(self, sight: Sight) -> CameraPlace:
        """Where the camera may stand in a picture.

        Without tag A in it the newest earlier one counts, the less the older it is, but never for a
        camera that may stand anywhere. A camera that was seen a while ago stays where it was then and
        where it was taught, either give or take: both widen, so that together they say `stability`.
        """
        if sight.tag_a is not None and sight.base_from_wrist is not None:
            return CameraPlace(self.stability, FlangeTag(sight.tag_a, sight.base_from_wrist))
        if self._newest is None or not np.isfinite(self.stability).all():
            return CameraPlace(self.stability)
        stamp_s, seen = self._newest
        share = min(abs(sight.stamp_s - stamp_s) / MEMORY_S, 1.0)
        since = np.diag(2 * (share * self.stability) ** 2)
        faded = replace(seen.tag, covariance=seen.tag.covariance + since)
        return CameraPlace(
            math.sqrt(1 + share) * self.stability, FlangeTag(faded, seen.base_from_wrist)
        )
