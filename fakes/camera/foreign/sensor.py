"""From light to grey levels: lamps, electrons, response, colour filters, files."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array

_FULL_WELL = 11_000.0  # electrons at level 255: a pixel of 3.45 um at low gain
_READ = 5.0  # electrons
_MOSAIC = (0.55, 1.0, 0.65)  # what red, green and blue let through of a white lamp


@dataclass(frozen=True, slots=True)
class Light:
    """What lights the print.

    exposure: level of full white, as a share of full scale; slope: change of the lamp across the
    window, in x and y; gloss: a reflex on the paper, as a share of full scale; gloss_px: its sigma.
    """

    exposure: float = 0.85
    slope: tuple[float, float] = (0.05, -0.03)
    gloss: float = 0.0
    gloss_px: float = 60.0


@dataclass(frozen=True, slots=True)
class Sensor:
    """gamma: exponent of the response (1: linear); bayer: colour filters, read back as grey; jpeg: quality."""

    gamma: float = 1.0
    bayer: bool = False
    jpeg: int | None = None


def lit(share: Array, light: Light, rng: np.random.Generator) -> Array:
    """Light on the pixels (height, width), as a share of full scale."""
    height, width = share.shape
    y, x = np.mgrid[:height, :width]
    across, down = x / width - 0.5, y / height - 0.5
    lamp = light.exposure * (1 + light.slope[0] * across + light.slope[1] * down)
    out = lamp * share
    if light.gloss:
        middle = rng.uniform(-0.3, 0.3, 2)
        square = ((across - middle[0]) * width) ** 2 + ((down - middle[1]) * height) ** 2
        out = out + light.gloss * np.exp(-square / (2 * light.gloss_px**2))
    return np.asarray(out)


def exposed(light: Array, sensor: Sensor, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Grey levels of the picture that the camera gives of such light."""
    filters = np.ones(light.shape)
    if sensor.bayer:
        filters[:] = _MOSAIC[1]
        filters[::2, ::2], filters[1::2, 1::2] = _MOSAIC[0], _MOSAIC[2]
    electrons = rng.poisson(np.maximum(light * filters, 0) * _FULL_WELL)
    share = (electrons + rng.normal(0, _READ, light.shape)) / _FULL_WELL
    level = 255 * np.clip(share, 0, 1) ** sensor.gamma
    grey = np.clip(np.rint(level), 0, 255).astype(np.uint8)
    if sensor.bayer:
        colour = cv2.cvtColor(grey, cv2.COLOR_BayerRGGB2BGR)
        grey = np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), np.uint8)
    if sensor.jpeg is not None:
        _, file = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg])
        grey = np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8)
    return grey
