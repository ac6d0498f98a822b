"""Which picture is taken when: whole ones at the camera's rate, regions around tag B at the watch rate."""

import math

from vgrd.devices import Region
from vgrd.model import CellFacts, TagObservation

WATCH_MARGIN = 0.5  # of the tag's extent, around its last place: a tag that leaves it has moved


class PictureSchedule:
    """Decides by the clock and by the newest picture; `watching` is set while an answer stands."""

    def __init__(self, facts: CellFacts, rate_hz: float, watch_rate_hz: float) -> None:
        self.period_s = 1.0 / rate_hz
        self.watch_period_s = 1.0 / max(rate_hz, watch_rate_hz)
        self.watching = False
        self._facts = facts
        self._last_trigger_s = self._last_whole_s = -self.period_s
        self._tag_b: TagObservation | None = None  # in the newest picture
        self._is_region_tried = self._sends_regions = False

    def note(self, tag_b: TagObservation | None, *, whole: bool) -> None:
        """A picture was evaluated; tag_b: what it shows of tag B."""
        self._tag_b = tag_b
        self._sends_regions |= not whole

    def is_whole_due(self, now_s: float) -> bool:
        """Whether to take a whole picture.

        While an answer stands and tag B is seen, no whole picture may delay the watch by regions.
        """
        is_watched_by_regions = self.watching and self._tag_b is not None and self._sends_regions
        return now_s - self._last_whole_s >= self.period_s and not is_watched_by_regions

    def is_watch_due(self, now_s: float) -> bool:
        """While an answer stands; and once in advance, to learn how fast the camera sends regions."""
        if self._tag_b is not None and not self._is_region_tried:
            self._is_region_tried = True
            return True
        return self.watching and now_s - self._last_trigger_s >= self.watch_period_s

    def take_whole(self, now_s: float) -> None:
        """A whole picture is taken now."""
        self._last_trigger_s = self._last_whole_s = now_s

    def take_watch_picture(self, now_s: float) -> Region | None:
        """The region around tag B is taken now; None: the whole picture, since tag B is not seen."""
        self._last_trigger_s = now_s
        return None if self._tag_b is None else region_around(self._tag_b, self._facts)


def region_around(tag: TagObservation, facts: CellFacts) -> Region | None:
    """Where a tag may be in the next watch picture; None where it is cut by the picture's edge."""
    low, high = tag.corners_px.min(0), tag.corners_px.max(0)
    reach = WATCH_MARGIN * float((high - low).max())
    width, height = facts.image_size_px
    x0, y0 = (max(0, math.floor(value - reach)) for value in low)
    x1 = min(width, math.ceil(high[0] + reach))
    y1 = min(height, math.ceil(high[1] + reach))
    return Region(x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None
