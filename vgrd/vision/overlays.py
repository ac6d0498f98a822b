"""Pictures with what was found in them drawn over, and maps of what the measuring did not explain."""

from pathlib import Path

from vgrd.vision.alignment.photometric_fit import PhotometricFit
from vgrd.vision.images.drawing import draw_residuals, draw_tags, write_picture
from vgrd.vision.images.pictures import Picture
from vgrd.vision.inspection import PictureReport

_RESIDUAL_SIGMAS = 5.0  # that are shown in full colour: no noise does that among 10,000 pixels


def write_overlays(path: Path, picture: Picture, report: PictureReport) -> None:
    """Write the picture with its tags and boards, and beside it the residuals of each that was measured."""
    write_picture(path, draw_tags(picture.pixels, report.marks()))
    for number, sighting in enumerate(report.tags):
        if sighting.refined is not None:
            name = f"{path.stem}-{number}-tag{sighting.tag.id}.png"
            _write_residuals(path.with_name(name), picture, sighting.refined.fit)
    for number, board in enumerate(report.boards):
        if board.fit is not None:
            name = f"{path.stem}-{number}-board.png"
            _write_residuals(path.with_name(name), picture, board.fit.refined.fit)


def _write_residuals(path: Path, picture: Picture, fit: PhotometricFit | None) -> None:
    if fit is not None:
        region, residuals = fit.residual_map(picture.pixels.shape)
        drawn = draw_residuals(picture.pixels[region], residuals, _RESIDUAL_SIGMAS, "sigma")
        write_picture(path, drawn)
