"""The object's holes as the fake camera sees them: dark, with a bright chamfer, drawn area-accurately."""

from dataclasses import dataclass

import numpy as np

from fakes.camera.blur import Blur
from fakes.camera.patterns import Disc
from fakes.camera.raster import coverage
from fakes.camera.sensor import (
    Picture,
    PixelRegion,
    Plane,
    light,
    quantised,
    region_around,
    with_noise,
)
from fakes.world.layout import Layout
from vgrd.geometry import Pose

_CHAMFER = 1.35  # radii of the hole
_CHAMFER_LEVEL, _HOLE_LEVEL = 214.0, 26.0  # of bare metal and of a bore; paper has 205, ink 14


@dataclass(frozen=True, slots=True, eq=False)
class _Hole:
    """Levels (height, width) in a region, and the share of each pixel that is not the hole's."""

    region: PixelRegion
    levels: Plane
    free: Plane


class HoleDrawer:
    """Draws the targets that are holes; remembers how they look at the last angle of the table."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._camera_from_base = layout.base_from_camera.inverse()
        self._angle_rad = np.nan
        self._holes: list[_Hole] = []

    def draw(
        self, picture: Picture, angle_rad: float, rng: np.random.Generator, window: PixelRegion
    ) -> None:
        """Draw all holes that reach into `window`, with fresh noise."""
        if angle_rad != self._angle_rad:
            self._holes, self._angle_rad = self._seen_at(angle_rad), angle_rad
        for hole in (hole for hole in self._holes if hole.region.meets(window)):
            background = picture[hole.region.slices]
            noisy = with_noise(hole.levels, rng)
            picture[hole.region.slices] = quantised(noisy + hole.free * (background - noisy))

    def _seen_at(self, angle_rad: float) -> list[_Hole]:
        camera_from_object = self._camera_from_base @ self._layout.base_from_object(angle_rad)
        holes = [
            self._seen(camera_from_object @ Pose(np.eye(3), target.cad), diameter / 2)
            for target in self._layout.targets.values()
            if (diameter := target.hole_diameter_mm) is not None
        ]
        return [hole for hole in holes if hole is not None]

    def _seen(self, camera_from_rim: Pose, radius_mm: float) -> _Hole | None:
        optics = self._layout.optics
        chamfer = Disc(np.zeros(2), _CHAMFER * radius_mm)
        low, high = chamfer.bounds_mm
        corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
        outline = optics.project(camera_from_rim.apply(corners))
        region = region_around(outline, optics.size_px, 6)
        if region is None:
            return None
        blur = Blur(optics.blur_px(float(camera_from_rim.translation[2])))
        free, not_hole = (
            coverage(optics, camera_from_rim, disc, region, blur)
            for disc in (chamfer, Disc(np.zeros(2), radius_mm))
        )
        inside = np.maximum(1 - free, np.float32(1e-6))
        share = np.clip((1 - not_hole) / inside, 0, 1)
        shade = _CHAMFER_LEVEL + (_HOLE_LEVEL - _CHAMFER_LEVEL) * share
        return _Hole(region, np.asarray(shade * light(optics.size_px, region), np.float32), free)
