"""What surrounds the tags in the fake camera's pictures: bench, turntable, arm, a hand.

Scenery is to look right and to hide what it stands in front of; nothing is measured on it (but the
holes: `fakes.camera.holes`).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from fakes.camera.sensor import Picture, PixelRegion, light, quantised, with_noise
from fakes.world.layout import Layout
from fakes.world.visibility import Body
from vgrd.geometry import Array, Pose

_SHADES = {  # grey levels that are told apart by eye
    "forearm": 78,
    "wrist": 58,
    "bracket": 36,
    "tool": 92,
    "tip": 70,
}
_SPIKE_FOOT_RADIUS_MM = 7.0  # a slim cone, only for the looks
_SHIFT = 6  # fractional bits of cv2's drawing coordinates
_NOISE_TILE = 2**20  # fewer draws than pixels (12 million); random starts hide it


class Scenery:
    """Draws everything but the tags and holes of one camera's pictures."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._camera_from_base = layout.base_from_camera.inverse()
        rng = np.random.default_rng(7)
        noise = np.rint(rng.standard_normal(_NOISE_TILE, dtype=np.float32) * 1.2).astype(np.int8)
        width, height = layout.optics.size_px
        self._noise_bank = np.resize(noise, width * height + _NOISE_TILE)
        self._background = self._draw_background(rng)

    def background(self) -> Picture:
        """Copy of the empty cell."""
        return self._background.copy()

    def darkness(self) -> Picture:
        """Draw the cell without light."""
        return np.asarray(cv2.convertScaleAbs(self._background, alpha=0.015, beta=2))

    def draw_bodies(
        self, picture: Picture, parts: Sequence[Body], rng: np.random.Generator
    ) -> None:
        """Draw parts of the arm, far ones first, out of focus; at half resolution, being smooth."""
        if not parts:
            return
        window = _window(np.concatenate([self._outline(part) for part in parts]), picture.shape)
        if window is None:
            return
        crop = picture[window]
        half = (crop.shape[0] // 2 + 1, crop.shape[1] // 2 + 1)
        shade, mask = np.zeros(half, np.uint8), np.zeros(half, np.uint8)
        origin = np.array([window[1].start, window[0].start]) + 0.5
        for part in parts:
            for share, gain in ((1.0, 1.0), (0.8, 1.12), (0.6, 1.22), (0.35, 1.3)):
                outline = (self._outline(part, share) - origin) / 2
                _fill_polygon(shade, outline, round(_SHADES[part.name] * gain))
            _fill_polygon(mask, (self._outline(part) - origin) / 2, 255)
        depth = float(self._camera_from_base.apply(parts[-1].ends).mean(0)[2])
        sigma = self._layout.optics.blur_px(depth) / 2
        self._blend(crop, _blurred(shade, sigma), mask, sigma, rng)

    def draw_hand(self, picture: Picture, base_from_tag: Pose, rng: np.random.Generator) -> None:
        """Lay something soft and grey over a tag."""
        blob = self._project(base_from_tag.apply(_circle(np.zeros(3), 26.0)))
        window = _window(blob, picture.shape)
        if window is None:
            return
        crop = picture[window]
        mask = np.zeros((crop.shape[0] // 2 + 1, crop.shape[1] // 2 + 1), np.uint8)
        _fill_polygon(mask, (blob - (window[1].start, window[0].start)) / 2, 255)
        shade = _blurred(mask // 2, 2.0)
        self._blend(crop, shade, mask, 2.0, rng)

    def _blend(
        self, crop: Picture, shade: Picture, mask: Picture, sigma: float, rng: np.random.Generator
    ) -> None:
        """Put a blurred half-size layer over a crop: `shade` on black, `mask` 255 where it hides."""
        height, width = crop.shape
        free = _blurred(255 - mask, sigma)
        doubled = (2 * mask.shape[1], 2 * mask.shape[0])
        free = np.asarray(cv2.resize(free, doubled)[:height, :width], np.uint8)
        layer = cv2.resize(shade, doubled)[:height, :width]
        mixed = cv2.add(cv2.multiply(crop, free, scale=1 / 255), layer)
        start = int(rng.integers(0, self._noise_bank.size - crop.size))
        noise = self._noise_bank[start : start + crop.size].reshape(crop.shape)
        cv2.add(mixed, noise, dst=mixed, mask=(free < 128).view(np.uint8), dtype=cv2.CV_8U)
        crop[:] = mixed

    def _outline(self, body: Body, share: float = 1.0) -> Array:
        """Silhouette (n, 2) of a tapered capsule, px; `share` narrows it."""
        ends = self._camera_from_base.apply(body.ends)
        focal = float(self._layout.optics.matrix[0, 0])
        circle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        unit = np.stack([np.cos(circle), np.sin(circle)], -1)
        centres = self._layout.optics.project(ends)
        radii = share * body.radii * focal / ends[:, 2]
        points = np.concatenate(
            [c + r * unit for c, r in zip(centres, radii, strict=True)]
        ).astype(np.float32)
        return np.asarray(cv2.convexHull(points)[:, 0].astype(np.float64))

    def _project(self, points_in_base: Array) -> Array:
        return self._layout.optics.project(self._camera_from_base.apply(points_in_base))

    def _fill(self, picture: Picture, points_in_base: Array, shade: int) -> None:
        _fill_polygon(picture, self._project(points_in_base), shade)

    def _draw_background(self, rng: np.random.Generator) -> Picture:
        """Draw bench, turntable and spike with their noise, once."""
        width, height = self._layout.optics.size_px
        coarse = rng.integers(90, 106, (height // 160, width // 160), dtype=np.uint8)
        grain = rng.integers(0, 9, (height // 5, width // 5), dtype=np.uint8)
        cloudy = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        picture: Picture = np.asarray(
            cv2.add(cloudy, cv2.resize(grain, (width, height))), np.uint8
        )
        table, disc_mm = self._layout.base_from_table, self._layout.disc_radius_mm
        for radius, height_mm, shade in (
            (disc_mm + 9, -14.0, 44),
            (disc_mm + 2, -6.0, 60),
            (disc_mm, 0.0, 152),
            (disc_mm - 3, 0.0, 166),
        ):
            self._fill(picture, table.apply(_circle(np.array([0, 0, height_mm]), radius)), shade)
        tip = self._layout.fixed_point_in_base
        foot = tip * (1, 1, 0)
        spike = Body("tip", np.array([foot, tip]), np.array([_SPIKE_FOOT_RADIUS_MM, 0.4]))
        _fill_polygon(picture, self._outline(spike), 58)
        _fill_polygon(picture, self._outline(spike, 0.4), 96)
        return self._expose(_blurred(picture, 0.9), rng)

    def _expose(self, picture: Picture, rng: np.random.Generator) -> Picture:
        """Apply light and noise in strips, which keeps the memory small."""
        strip = 128
        for top in range(0, picture.shape[0], strip):
            rows = picture[top : top + strip]
            region = PixelRegion(0, top, rows.shape[1], rows.shape[0])
            rows[:] = quantised(with_noise(rows * light(self._layout.optics.size_px, region), rng))
        return picture


def _circle(centre: Array, radius: float) -> Array:
    """Points (64, 3) of a circle parallel to the xy plane."""
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], -1)
    return np.asarray(centre + radius * ring)


def _blurred(picture: Picture, sigma: float) -> Picture:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)


def _fill_polygon(picture: Picture, outline: Array, shade: int) -> None:
    points = np.rint(np.clip(outline, -20000, 20000) * 2**_SHIFT).astype(np.int32)
    cv2.fillConvexPoly(picture, points, shade, cv2.LINE_AA, shift=_SHIFT)


def _window(outline: Array, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns around an outline (n, 2), cut to the picture; None when nothing is left."""
    low = np.maximum(np.floor(outline.min(0)).astype(int) - 12, 0)
    high = np.minimum(np.ceil(outline.max(0)).astype(int) + 12, (shape[1], shape[0]))
    if (high <= low).any():
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
