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
        if (seen := _flange_tag(sight)) is not None:
            self._newest = (sight.stamp_s, seen)

    def place(self, sight: Sight) -> CameraPlace:
        """Where the camera may stand in a picture.

        Without tag A in it the newest earlier one counts, the less the older it is, but never for a
        camera that may stand anywhere. A camera that was seen a while ago stays where it was then and
        where it was taught, either give or take: both widen, so that together they say `stability`.
        """
        place = CameraPlace(self.stability, _flange_tag(sight))
        if place.flange_tag is not None or self._newest is None or place.is_free:
            return place
        stamp_s, seen = self._newest
        share = min(abs(sight.stamp_s - stamp_s) / MEMORY_S, 1.0)
        since = np.diag(2 * (share * self.stability) ** 2)
        faded = replace(seen.tag, covariance=seen.tag.covariance + since)
        return CameraPlace(
            math.sqrt(1 + share) * self.stability,
            FlangeTag(faded, seen.base_from_wrist),
            is_recalled=True,
        )


def _flange_tag(sight: Sight) -> FlangeTag | None:
    if sight.tag_a is None or sight.base_from_wrist is None:
        return None
    return FlangeTag(sight.tag_a, sight.base_from_wrist)
