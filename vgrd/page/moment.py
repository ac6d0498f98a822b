"""What was told of one moment: it is shown for a while, and no longer than the cell is as it was."""

from typing import Final

from vgrd.page.link import Link

FADE_S: Final = 0.5  # from one look at it to the next, also while another tab is open


class Moment:
    """When something was asked, of which version and of which calibration in use."""

    def __init__(self, link: Link, span_s: float) -> None:
        self._link, self._span_s = link, span_s
        self._begun_s, self._state = -1e9, self._now

    def begin(self) -> None:
        """It is asked now: before, not after, for the reply is of what is so at the earliest then."""
        self._begun_s, self._state = self._link.now_s, self._now

    @property
    def is_over(self) -> bool:
        """Whether it is too old, or somebody has changed something since."""
        return self._link.now_s - self._begun_s > self._span_s or self._state != self._now

    @property
    def _now(self) -> tuple[object, object]:
        version = self._link.reply("teaching").get("version")
        return version, self._link.reply("calibrations").get("active")
