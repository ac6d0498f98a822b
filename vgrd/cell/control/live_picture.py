"""The newest whole picture, small, with its tags: what the operator's page shows."""

import asyncio
import base64
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from vgrd.cell.measuring import Measuring, Sight
from vgrd.clock import Clock
from vgrd.errors import DeviceUnavailable
from vgrd.geometry import Array
from vgrd.model import TagObservation, TagSpec
from vgrd.niceness import give_way
from vgrd.vision.images.previews import preview

WIDTH_PX, NARROWEST_PX, WIDEST_PX = 1024, 160, 1600  # the widest still fits a reply (1 MB)
WAIT_S, LONGEST_WAIT_S = 0.0, 2.0  # for a picture that the asker has not got yet
_POLL_S = 0.01  # a tenth of the time from one picture to the next that a person can follow


class LivePicture:
    """Makes one JPEG of each picture that somebody asks for, in a thread of its own."""

    def __init__(self, measuring: Measuring, clock: Clock) -> None:
        self._measuring, self._clock = measuring, clock
        self._thread = ThreadPoolExecutor(1, "preview", initializer=give_way)
        self._made: tuple[tuple[int, float, int], Mapping[str, object]] | None = None

    async def newest(self, after: int | None, wait_s: float, width_px: int) -> dict[str, object]:
        """The newest picture. DeviceUnavailable where there is none.

        after: number of the frame that the asker has; another one is waited for, as long as wait_s.
        No picture is taken for it: those who look do not change what the cell does.
        """
        end_s = self._clock.monotonic() + wait_s
        while (sight := self._measuring.sight) is None or sight.image.frame == after:
            if self._clock.monotonic() >= end_s:
                break
            await asyncio.sleep(_POLL_S)
        if sight is None:
            raise DeviceUnavailable(
                f"no picture yet: {self._measuring.camera_trouble() or 'the camera is slow'}"
            )
        shown = await self._shown(sight, width_px)
        age_s = self._clock.monotonic() - sight.stamp_s
        return {
            **shown,
            "age_s": round(age_s, 3),
            "period_s": self._measuring.period_s,
            "robot_at_rest": sight.unpaired is None,
        }

    async def _shown(self, sight: Sight, width_px: int) -> Mapping[str, object]:
        image = sight.image
        key = (image.frame, image.stamp_s, width_px)
        if self._made is None or self._made[0] != key:
            loop = asyncio.get_running_loop()
            jpeg, size = await loop.run_in_executor(self._thread, preview, image.pixels, width_px)
            self._made = key, self._described(sight, jpeg, size)
        return self._made[1]

    def _described(self, sight: Sight, jpeg: bytes, size: tuple[int, int]) -> Mapping[str, object]:
        facts, (height, width) = self._measuring.facts, sight.image.pixels.shape
        scale = size[0] / width
        wanted = ("a", facts.tag_a, sight.tag_a), ("b", facts.tag_b, sight.tag_b)
        return {
            "frame": sight.image.frame,
            "taken_unix_s": self._clock.wall() - (self._clock.monotonic() - sight.stamp_s),
            "width_px": size[0],
            "height_px": size[1],
            "full_px": [width, height],
            "jpeg": base64.b64encode(jpeg).decode(),
            "tags": {
                name: _tag(tag, seen, scale) for name, tag, seen in wanted if tag is not None
            },
        }


def _tag(tag: TagSpec, seen: TagObservation | None, scale: float) -> dict[str, object]:
    """A tag that is wanted; corners: [[x, y] * 4] in pixels of the small picture, None where it is not seen."""
    corners: Array | None = None if seen is None else (seen.corners_px + 0.5) * scale - 0.5
    return {
        "wanted": f"{tag.family} id {tag.id}",
        "corners": None if corners is None else corners.round(2).tolist(),
        "fit_px": None if seen is None else round(seen.rms_px, 3),
        "side_px": None if seen is None else round(side_px(seen.corners_px)),
    }


def side_px(corners_px: Array) -> float:
    """Mean length of the four sides (4, 2) of a tag."""
    return float(np.linalg.norm(corners_px - np.roll(corners_px, 1, axis=0), axis=1).mean())
