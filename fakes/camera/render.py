"""The fake camera's pictures: only what changes is drawn, over a cached background.

Tags and holes are drawn exactly (`fakes.camera.raster`), with fresh noise and 8 bits. Everything else (arm,
tool, a covering hand: `fakes.camera.scenery`) is there to look right and to hide what it stands in front
of.
"""

from dataclasses import replace

import cv2
import numpy as np

from fakes.camera.blur import Blur
from fakes.camera.holes import HoleDrawer
from fakes.camera.patterns import tag_pattern
from fakes.camera.raster import coverage
from fakes.camera.scenery import Scenery
from fakes.camera.sensor import (
    BLACK,
    WHITE,
    Picture,
    PixelRegion,
    Plane,
    light,
    quantised,
    region_around,
    with_noise,
)
from fakes.world.layout import Layout
from fakes.world.visibility import (
    PLATE_CELLS,
    TAG_NAMES,
    Visibility,
    bodies,
    hides,
    plate_points,
    visible,
)
from fakes.world.world import UNMOVED, TagName, WorldSnapshot
from vgrd.geometry import Array, Pose
from vgrd.model import TagSpec


class Renderer:
    """Draws the pictures of one fake camera; holds a background of the size of one picture.

    Not for use by several threads at once.
    """

    def __init__(self, layout: Layout) -> None:
        self._unmoved = layout
        self._shift = UNMOVED
        self._stand(layout)

    def _stand(self, layout: Layout) -> None:
        """Draw from where the camera stands in `layout`."""
        self.layout = layout
        self._camera_from_base = layout.base_from_camera.inverse()
        self._scenery = Scenery(layout)
        self._holes = HoleDrawer(layout)

    def visible(self, name: TagName, snapshot: WorldSnapshot) -> Visibility:
        """Judge how the camera sees tag "a" or "b"."""
        return visible(self.layout, name, snapshot)

    def render(self, snapshot: WorldSnapshot, region: PixelRegion | None = None) -> Picture:
        """Draw the picture (height, width) of a snapshot, or a region of it.

        The same snapshot and region give the same picture.
        """
        rng = np.random.default_rng(snapshot.exposure)
        if snapshot.camera_shift != self._shift:
            self._shift = snapshot.camera_shift
            shift = Pose.from_rotvec(self._shift[3:], self._shift[:3])
            place = self._unmoved.base_from_camera @ shift
            self._stand(replace(self._unmoved, base_from_camera=place))
        scenery = self._scenery
        window = region or PixelRegion(0, 0, *self.layout.optics.size_px)
        if not snapshot.lights:
            return np.ascontiguousarray(scenery.darkness()[window.slices])
        picture = scenery.background()
        self._holes.draw(picture, snapshot.table_angle_rad, rng, window)
        parts = bodies(self.layout, snapshot.base_from_wrist)
        tag_a = snapshot.base_from_tag("a", self.layout)
        points = tag_a.apply(plate_points(self.layout.tag_a.size_mm, n=7))
        eye = self.layout.base_from_camera.translation
        in_front = [hides(body, points, eye) for body in parts]
        tag_b = snapshot.base_from_tag("b", self.layout)
        self._draw_tag(picture, self.layout.tag_b, tag_b, rng, window)
        background = [body for body, front in zip(parts, in_front, strict=True) if not front]
        scenery.draw_bodies(picture, background, rng)
        self._draw_tag(picture, self.layout.tag_a, tag_a, rng, window)
        foreground = [body for body, front in zip(parts, in_front, strict=True) if front]
        scenery.draw_bodies(picture, foreground, rng)
        for name in TAG_NAMES:
            if name in snapshot.covered:
                scenery.draw_hand(picture, snapshot.base_from_tag(name, self.layout), rng)
        return np.ascontiguousarray(picture[window.slices])

    def _draw_tag(
        self,
        picture: Picture,
        tag: TagSpec,
        base_from_tag: Pose,
        rng: np.random.Generator,
        window: PixelRegion,
    ) -> None:
        camera_from_tag = self._camera_from_base.compose(base_from_tag)
        toward_camera = camera_from_tag.rotation[:, 2] @ camera_from_tag.translation
        if toward_camera <= 0:
            return
        optics = self.layout.optics
        outline = optics.project(camera_from_tag.apply(_plate_outline(tag)))
        region = region_around(outline, optics.size_px, 10)
        if region is None or not region.meets(window):
            return
        blur = Blur(optics.blur_px(float(camera_from_tag.translation[2])))
        printed = tag_pattern(tag).with_ink_spread(self.layout.ink_mm)
        white = coverage(optics, camera_from_tag, printed, region, blur)
        plate = _polygon_share(outline, region, blur.sigma_px)
        paper = light(optics.size_px, region)
        clean = paper * (np.float32(BLACK) + np.float32(WHITE - BLACK) * white)
        background = picture[region.slices].astype(np.float32)
        picture[region.slices] = quantised(
            background + plate * (with_noise(clean, rng) - background)
        )


def _plate_outline(tag: TagSpec) -> Array:
    half = tag.size_mm * PLATE_CELLS / 16
    return half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


def _polygon_share(outline: Array, region: PixelRegion, sigma: float) -> Plane:
    """Blurred share (height, width), 0 to 1, of a polygon's inside."""
    mask = np.zeros((region.height, region.width), np.uint8)
    corners = np.rint((outline - (region.x, region.y)) * 256).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, 255, cv2.LINE_AA, shift=8)
    blurred = cv2.GaussianBlur(mask, (0, 0), sigma)
    return np.asarray(blurred.astype(np.float32) / np.float32(255))
