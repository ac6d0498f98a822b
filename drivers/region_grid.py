"""The regions that a camera can send: their edges lie on a grid of its own."""

from dataclasses import dataclass

from vgrd.devices import Region


@dataclass(frozen=True, slots=True)
class RegionGrid:
    """The whole picture, and the steps of offset and size, px."""

    whole: Region
    x_step: int = 1
    y_step: int = 1
    width_step: int = 1
    height_step: int = 1

    def around(self, region: Region) -> Region | None:
        """The smallest region of the grid that holds `region`; None where only the whole picture does.

        `region` counts in the whole picture as the driver delivers it, from (0, 0).
        """
        x, width = _span(region.x, region.width, self.x_step, self.width_step, self.whole.width)
        y, height = _span(
            region.y, region.height, self.y_step, self.height_step, self.whole.height
        )
        if width < 1 or height < 1:
            return None
        return Region(x, y, width, height)


def _span(
    start: int, length: int, start_step: int, length_step: int, most: int
) -> tuple[int, int]:
    """First pixel and length along one axis, on the grid and inside the picture; length 0: none fits."""
    end = min(start + length, most)
    first = max(start, 0) // start_step * start_step
    size = -(-(end - first) // length_step) * length_step
    while first + size > most and first >= start_step:
        first -= start_step
        size = -(-(end - first) // length_step) * length_step
    return first, size if 0 < size <= most - first else 0
