"""What the measuring loop asks of a detector of tags."""

from collections.abc import Mapping
from typing import Protocol

from vgrd.devices import Pixels, Region
from vgrd.model import TagObservation


class Detector(Protocol):
    """Finds the known tags in grey pixels; `vgrd.vision.tags.tag_finder.TagDetector` in the product."""

    def detect(
        self,
        pixels: Pixels,
        previous: Mapping[int, TagObservation] | None = None,
        region: Region | None = None,
    ) -> dict[int, TagObservation]:
        """Tags by id, looked for first near where they were seen before; region: of these pixels."""
        ...
