"""Pictures for people of the holes that were looked for in a session, and why some were not seen."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vgrd.devices import Pixels
from vgrd.solving.hole_sightings import Images, SearchedPicture
from vgrd.vision.images.contact_sheet import Tile, contact_sheet
from vgrd.vision.images.drawing import DOUBTFUL, draw_hole, write_picture


def draw_searched(
    searched: Sequence[SearchedPicture], images: Images, folder: Path
) -> tuple[Path, ...]:
    """A PNG in the folder for every picture that was searched: its holes enlarged, with their fits.

    A hole that was not seen is shown where it should be, with the reason. Nothing is searched again.
    """
    indices = {picture.stamp_s: k for k, picture in enumerate(searched)}
    drawn = []
    for image in images(indices.keys()):
        k = indices[image.stamp_s]
        stands = searched[k].spin
        stance = "touched" if stands is None else f"spin-{stands + 1}"
        path = folder / f"holes-{k + 1:02d}-{stance}.png"
        write_picture(path, contact_sheet(_tiles(image.pixels, searched[k])))
        drawn.append(path)
    return tuple(sorted(drawn))


def _tiles(picture: Pixels, searched: SearchedPicture) -> list[Tile]:
    tiles = {}
    for sighting in searched.sightings:
        hole = sighting.hole
        caption = (
            f"{sighting.target}: sigma {sighting.sigma_px:.3f} px, radius {hole.radius_mm:.3f} mm, "
            f"{hole.rim:.0%} of the rim, chi2 {hole.chi2:.1f}"
        )
        drawing = draw_hole(picture, hole.rim_px, hole.outline_px, hole.center_px, sighting.target)
        tiles[sighting.target] = Tile(drawing, "; ".join((caption, *hole.findings)))
    for name, missed in searched.missed.items():
        centre = missed.outline_px.mean(axis=0)
        drawing = draw_hole(
            picture, np.empty((0, 2)), missed.outline_px, centre, f"{name} not seen", DOUBTFUL
        )
        tiles[name] = Tile(drawing, f"{name}: {missed.reason}")
    return [tiles[name] for name in sorted(tiles)]
