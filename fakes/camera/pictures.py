"""Pictures of tags, boards and holes for tests and benchmarks, with what spoils real ones.

Only the regions of the figures are drawn. Light falls on figure and surroundings, lens and motion
blur, the sensor adds noise; shadow, glare and things in front come as in a real cell. The same
seed gives the same picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.special import ndtr

from fakes.camera.blur import Blur
from fakes.camera.patterns import Figure, Pattern
from fakes.camera.raster import coverage
from fakes.camera.sensor import (
    BLACK,
    READ,
    SHOT,
    WHITE,
    Picture,
    PixelRegion,
    Plane,
    light,
    quantised,
    region_around,
    with_noise,
)
from fakes.world.optics import Optics
from vgrd.geometry import Array, Pose

_FULL_SCALE = 255.0  # of 8 bits


@dataclass(frozen=True, slots=True)
class Band:
    """A straight band across a picture, px from the middle of the region, with soft edges.

    direction_rad: of its normal; from_px to to_px along that, infinite allowed.
    """

    direction_rad: float = 0.0
    from_px: float = 0.0
    to_px: float = np.inf
    softness_px: float = 1.0

    def share(self, region: PixelRegion) -> Plane:
        """How much of each pixel is in the band (height, width)."""
        x, y = _from_middle(region)
        along = np.cos(self.direction_rad) * x + np.sin(self.direction_rad) * y
        soft = max(self.softness_px, 1e-6)
        band_share = ndtr((along - self.from_px) / soft) - ndtr((along - self.to_px) / soft)
        return np.asarray(band_share, np.float32)


@dataclass(frozen=True, slots=True)
class Spot:
    """A highlight: a Gaussian of so many grey levels, px from the middle of the region."""

    levels: float = 90.0  # of 255: a highlight that clips paper and not ink
    x_px: float = 0.0
    y_px: float = 0.0
    sigma_px: float = 40.0  # about a cell of the fake cell's tags (34 px)

    def levels_in(self, region: PixelRegion) -> Plane:
        """Grey levels (height, width)."""
        x, y = _from_middle(region)
        squared = (x - self.x_px) ** 2 + (y - self.y_px) ** 2
        return np.asarray(self.levels * np.exp(-squared / (2 * self.sigma_px**2)), np.float32)


@dataclass(frozen=True, slots=True)
class Look:
    """Lens, light, sensor and what may be wrong with them.

    psf_px: Gaussian sigma of lens and sensor. white, black: grey levels in full light. vignetting,
    slope: as `fakes.camera.sensor.light`. shot, read: noise variance per grey level, and sigma. around:
    white share of what surrounds the paper; paper_mm: its margin around the figure.

    Faults: ink_mm moves every black edge outwards; scale prints everything larger; gamma bends grey
    levels after the noise (level ~ light**gamma); exposure multiplies the light, so that white is
    clipped; defocus_px: radius of a blur disc; motion_px along motion_rad; shadow takes
    `shadow_depth` of the light; glare adds light; in_front hides, with `in_front_level`; bayer:
    gains of R, G, G, B behind a mosaic that is then interpolated to grey.
    """

    psf_px: float = 0.7  # as of `Optics`
    white: float = WHITE
    black: float = BLACK
    vignetting: float = 0.25  # as of `light`
    slope: tuple[float, float] = (0.10, -0.06)  # as of `light`
    shot: float = SHOT
    read: float = READ
    around: float = 0.45  # grey, so that the paper's edge shows against it
    paper_mm: float | None = None
    ink_mm: float = 0.0
    scale: float = 1.0
    gamma: float = 1.0
    exposure: float = 1.0
    defocus_px: float = 0.0
    motion_px: float = 0.0
    motion_rad: float = 0.0
    shadow: Band | None = None
    shadow_depth: float = 0.45  # paper in shadow stays brighter than ink in light
    glare: Spot | None = None
    in_front: Band | None = None
    in_front_level: float = 60.0  # between ink and paper, as a sleeve or a cable
    bayer: tuple[float, float, float, float] | None = None

    @property
    def blur(self) -> Blur:
        """Everything that blurs."""
        return Blur(self.psf_px, self.defocus_px, self.motion_px, self.motion_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A figure and where its plane is."""

    figure: Figure
    camera_from_plane: Pose


@dataclass(frozen=True, slots=True, eq=False)
class RegionPicture:
    """A region of a camera's picture: pixels (height, width), 8 bit.

    `camera` sees just this region: its pixel (0, 0) is pixel (region.x, region.y) of the whole.
    """

    pixels: Picture
    region: PixelRegion
    camera: Optics

    def in_frame(
        self,
        size_px: tuple[int, int],
        level: int = 90,  # as the darkest of the bench (`fakes.camera.scenery`)
    ) -> Picture:
        """The whole picture, even grey outside of the region."""
        frame = np.full(size_px[::-1], level, np.uint8)
        frame[self.region.slices] = self.pixels
        return frame


def pinhole(matrix: Array, distortion: Array, size_px: tuple[int, int]) -> Optics:
    """A camera that is sharp everywhere; distortion: up to 5 numbers in OpenCV's order."""
    five = np.zeros(5)
    five[: len(distortion)] = distortion
    return Optics(matrix, five, size_px, focus_mm=1.0, aperture_mm=0.0)


def draw(
    camera: Optics,
    placed: Sequence[Placed],
    look: Look | None = None,
    *,
    seed: int | np.random.Generator = 0,
    margin_px: float = 10.0,  # a sharp picture's blur reaches 5 px
) -> RegionPicture:
    """Draw figures, which must not overlap, in the smallest region that holds them.

    Raises ValueError when they are outside of the picture.
    """
    look = look or Look()
    levels, region = clean_levels(camera, placed, look, margin_px=margin_px)
    pixels = sense(levels, look, np.random.default_rng(seed))
    return RegionPicture(pixels, region, camera_of(camera, region))


def clean_levels(
    camera: Optics,
    placed: Sequence[Placed],
    look: Look,
    *,
    margin_px: float = 10.0,  # a sharp picture's blur reaches 5 px
    region: PixelRegion | None = None,
) -> tuple[Plane, PixelRegion]:
    """Grey levels (height, width) that reach the sensor, without noise, and their region."""
    figures = [replace(each, figure=_made(each.figure, look)) for each in placed]
    if region is None:
        outline = np.concatenate([_outline(camera, each) for each in figures])
        region = region_around(outline, camera.size_px, margin_px)
    if region is None:
        raise ValueError("nothing of the figures is in the picture: change their poses")
    white = np.full((region.height, region.width), np.float32(look.around))
    for each in figures:
        shares = coverage(camera, each.camera_from_plane, each.figure, region, look.blur)
        white += shares - np.float32(look.around)
    levels = look.black + (look.white - look.black) * white
    if look.in_front:
        hidden = look.in_front.share(region)
        levels += hidden * (look.in_front_level - levels)
    levels *= light(camera.size_px, region, look.vignetting, look.slope)
    if look.shadow:
        levels *= 1 - look.shadow_depth * look.shadow.share(region)
    if look.glare:
        levels += look.glare.levels_in(region)
    return np.asarray(levels, np.float32), region


def sense(levels: Plane, look: Look, rng: np.random.Generator) -> Picture:
    """What the sensor makes of grey levels (height, width): mosaic, exposure, noise, gamma, 8 bits."""
    lit = levels * np.float32(look.exposure)
    if look.bayer:
        gains = np.array(look.bayer, np.float32).reshape(2, 2)
        lit = lit * np.tile(gains, (lit.shape[0] // 2, lit.shape[1] // 2))
    noisy = with_noise(lit, rng, look.shot, look.read)
    if look.gamma != 1:
        share = np.clip(noisy / _FULL_SCALE, 0, 1)
        noisy = np.asarray(_FULL_SCALE * share**look.gamma, np.float32)
    pixels = quantised(noisy)
    if look.bayer:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BayerRGGB2GRAY), np.uint8)
    return pixels


def camera_of(camera: Optics, region: PixelRegion) -> Optics:
    """The camera that sees only a region."""
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= region.x, region.y
    return replace(camera, matrix=matrix, size_px=(region.width, region.height))


def _made(figure: Figure, look: Look) -> Figure:
    """The figure as it is printed on its paper, or drilled into what is around."""
    if not isinstance(figure, Pattern):
        return replace(figure, outside=look.around)
    cell = float(np.diff(figure.x_mm).min())
    paper = cell if look.paper_mm is None else look.paper_mm
    printed = figure.scaled(look.scale).with_ink_spread(look.ink_mm)
    return printed.on_paper(paper, look.around)


def _outline(camera: Optics, placed: Placed) -> Array:
    (x0, y0), (x1, y1) = placed.figure.bounds_mm
    corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    return camera.project(placed.camera_from_plane.apply(corners))


def _from_middle(region: PixelRegion) -> tuple[Plane, Plane]:
    """Distances x (1, width) and y (height, 1) from the middle of a region, px."""
    x = np.arange(region.width, dtype=np.float32) - (region.width - 1) / 2
    y = np.arange(region.height, dtype=np.float32) - (region.height - 1) / 2
    return x[None].astype(np.float32), y[:, None].astype(np.float32)
