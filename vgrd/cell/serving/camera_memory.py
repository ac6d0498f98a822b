"""What pictures have told of the camera's place: tag A in this picture, or a while ago in another one."""

from dataclasses import replace

import numpy as np

from vgrd.cell.measuring import Sight
from vgrd.geometry import Array
from vgrd.model import CameraPlace, FlangeTag

MEMORY_S = 60.0  # a guess: over it what tag A said of the camera has faded to its stability


class CameraMemory:
    """Remembers the newest picture of tag A with the arm at rest.

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

        Without tag A in it an earlier one counts, the less the older it is, but never for a camera that
        may stand anywhere.
        """
        if sight.tag_a is not None and sight.base_from_wrist is not None:
            return CameraPlace(self.stability, FlangeTag(sight.tag_a, sight.base_from_wrist))
        if self._newest is None or not np.isfinite(self.stability).all():
            return CameraPlace(self.stability)
        stamp_s, seen = self._newest
        age_s = abs(sight.stamp_s - stamp_s)
        if age_s > MEMORY_S:
            return CameraPlace(self.stability)
        since = np.diag((self.stability * age_s / MEMORY_S) ** 2)
        faded = replace(seen.tag, covariance=seen.tag.covariance + since)
        return CameraPlace(self.stability, FlangeTag(faded, seen.base_from_wrist))

    def forget(self) -> None:
        """Another calibration serves, or a person has been at the cell."""
        self._newest = None
