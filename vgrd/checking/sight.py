"""What a picture of the cell's camera shows of the tags that the cell file wants."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgrd.config.cell_file import CellConfig, TagSection
from vgrd.devices import Pixels
from vgrd.geometry.camera import CameraModel
from vgrd.vision.images.drawing import draw_tags, write_picture
from vgrd.vision.images.pictures import Picture, as_8_bit
from vgrd.vision.inspection import PictureReport, TagReport, inspect_picture, remarks

FAMILIES = ("36h11", "25h9", "16h5")  # as of `TagSection`
_DARK, _BRIGHT = (
    0.05,
    0.9,
)  # mean grey level; guesses: black cloth, white paper that fills the picture


@dataclass(frozen=True, slots=True, eq=False)
class CellSight:
    """A picture, what was found in it, and the tags that were wanted, by "a" and "b"."""

    pixels: Pixels
    report: PictureReport
    wanted: dict[str, TagSection]
    size_px: tuple[int, int]

    def to_json(self) -> dict[str, object]:
        """Tags wanted and seen, and every remark with its remedy."""
        return {
            "size_px": list(self.pixels.shape[::-1]),
            "brightness": round(self._brightness(), 3),
            "tags": {
                name: {
                    "wanted": f"{tag.family} id {tag.id}",
                    "seen": (found := self._found(tag)) is not None,
                    "side_px": None if found is None else round(found.tag.side_px),
                }
                for name, tag in self.wanted.items()
            },
            "sees": _called(self.report.tags),
            "remarks": list(self._remarks()),
        }

    def draw(self, path: Path) -> None:
        """Write the picture with its tags; InputError where it cannot be written."""
        write_picture(path, draw_tags(self.pixels, self.report.marks()))

    def _found(self, wanted: TagSection) -> TagReport | None:
        tags = self.report.tags
        return next(
            (t for t in tags if (t.tag.family, t.tag.id) == (wanted.family, wanted.id)), None
        )

    def _brightness(self) -> float:
        return float(as_8_bit(self.pixels).mean()) / 255

    def _remarks(self) -> Iterator[str]:
        height, width = self.pixels.shape
        if (width, height) != self.size_px:
            yield (
                f"the picture has {width} x {height} px, the cell file says {self.size_px[0]} x {self.size_px[1]}: "
                "correct [camera] size_px and matrix"
            )
        seen = _called(self.report.tags) or "no tag"
        for name, tag in self.wanted.items():
            if self._found(tag) is None:
                yield f"sees {seen}; the cell file wants {tag.family} id {tag.id} as tag {name.upper()}"
        brightness = self._brightness()
        if not _DARK <= brightness <= _BRIGHT:
            how, less = ("dark", "more") if brightness < _DARK else ("bright", "less")
            yield f"the picture is {how} ({100 * brightness:.0f} % of white): expose {less}"
        own = [
            finding
            for tag in self.wanted.values()
            if (found := self._found(tag)) is not None
            for finding in found.to_json()["quality"]["findings"]  # type: ignore[index]
        ]
        yield from remarks(own)
        yield from (finding.message for finding in self.report.findings)


def look_at(pixels: Pixels, config: CellConfig) -> CellSight:
    """Find the tags in a whole picture; all families are looked for where a wanted tag is missing."""
    wanted = {"a": config.tags.a, "b": config.tags.b}
    fx, fy, cx, cy = config.camera.matrix
    width, height = config.camera.size_px
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    is_of_camera = pixels.shape == (height, width)
    camera = CameraModel(K, np.array(config.camera.distortion), (width, height))
    sizes = {tag.size_mm for tag in wanted.values()}
    size_mm = sizes.pop() if len(sizes) == 1 else None  # of all tags of a picture, or of none

    def sight(families: Sequence[str]) -> CellSight:
        picture, lens = Picture(pixels, is_turned=False), camera if is_of_camera else None
        report = inspect_picture(picture, families, size_mm, lens)
        return CellSight(pixels, report, wanted, (width, height))

    first = sight(sorted({tag.family for tag in wanted.values()}))
    ids = {(one.tag.family, one.tag.id) for one in first.report.tags}
    is_complete = all((tag.family, tag.id) in ids for tag in wanted.values())
    return first if is_complete else sight(FAMILIES)


def _called(tags: Sequence[TagReport]) -> str:
    """Tags by family: "36h11 ids 0, 1"; empty where there are none."""
    families: dict[str, list[int]] = {}
    for report in tags:
        families.setdefault(report.tag.family, []).append(report.tag.id)
    return "; ".join(
        f"{family} {'id' if len(ids) == 1 else 'ids'} {', '.join(map(str, sorted(ids)))}"
        for family, ids in sorted(families.items())
    )
