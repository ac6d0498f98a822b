"""Circles of a plane as one camera sees them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Pixels
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel

_SAMPLES = 32  # of an outline, for a Fourier series of 13 orders: more than twice as many
_ORDERS = np.arange(-6, 7)  # of that series: exact to 1e-9 px
_FITS_POINTS = 64  # of an outline, whose extent is to lie in the picture
_FEET_POINTS = 720  # of an outline, as starts of Newton's method: 0.5 degrees apart
_FEET_STEPS = 2  # of Newton's method, which squares the error of the start
_MOST_FOOT_STEP_RAD = 0.3  # for places near the middle, where the nearest point is undetermined
_REMAP_ROW = 4096  # OpenCV's remap takes sides below 32768
_BLUR_MARGIN_PX = 4  # around a crop: bilinear samples, and the blur before them


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """In a plane: centre (2,) and radius, mm."""

    centre: Array
    radius: float


class PlaneView:
    """Looks at circles of one plane in one picture: grey (h, w), camera_from_plane in mm."""

    def __init__(self, grey: Pixels, camera: CameraModel, camera_from_plane: Pose) -> None:
        self._grey = grey
        self._camera = camera
        self._pose = camera_from_plane

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) of points (n, 2) of the plane, and their derivative (n, 2, 2), px / mm."""
        flat = np.column_stack([points, np.zeros(len(points))])
        pixels, J = self._camera.linearize(self._pose.apply(flat))
        return pixels, J @ self._pose.rotation[:, :2]

    def fits(self, circle: Circle, margin_px: float) -> bool:
        """Whether the image of a circle with a margin is inside of the picture."""
        outline = self.image_of(on_circle(circle, turn_angles(_FITS_POINTS)))[0]
        low, high = outline.min(0) - margin_px, outline.max(0) + margin_px
        size = np.array(self._grey.shape[::-1])
        return bool(np.isfinite(outline).all() and (low >= 0).all() and (high < size).all())

    def px_per_mm(self, place: Array) -> float:
        """Largest magnification at a place (2,) of the plane."""
        return float(np.linalg.norm(self.image_of(place[None])[1][0], 2))

    def levels_at(self, places: Array, apart_mm: float) -> Array:
        """Levels (n,) at places (n, 2), mm, blurred for samples `apart_mm` apart.

        Outside of the picture the level is that of its border.
        """
        pixels, _ = self.image_of(places)
        pixels = np.nan_to_num(pixels, nan=-1e6)
        low = np.clip(np.floor(pixels.min(0)) - _BLUR_MARGIN_PX, 0, None).astype(int)
        end = np.ceil(pixels.max(0)) + _BLUR_MARGIN_PX + 1
        high = np.minimum(end, self._grey.shape[::-1]).astype(int)
        if (high <= low).any():
            return np.zeros(len(places))
        crop = self._grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
        px_apart = apart_mm * self.px_per_mm(places.mean(0))
        if px_apart > 1:
            crop = np.asarray(cv2.GaussianBlur(crop, (0, 0), px_apart / 2), np.float32)
        x, y = np.ascontiguousarray((pixels - low).astype(np.float32).T)
        return _sampled(crop, x, y)

    def pixels_near(self, outline: Array, width_px: float) -> tuple[Array, Array] | None:
        """Places (n, 2) and levels (n,) of the pixels within a width of a closed outline (m, 2)."""
        size = np.array(self._grey.shape[::-1])
        low = np.maximum(np.floor(outline.min(0) - width_px - 2), 0).astype(int)
        high = np.minimum(np.ceil(outline.max(0) + width_px + 3), size).astype(int)
        if (low >= high).any():
            return None
        mask = np.zeros(high[::-1] - low[::-1], np.uint8)
        corners = np.rint((outline - low) * 16).astype(np.int32)
        cv2.polylines(mask, [corners], True, 255, int(2 * np.ceil(width_px)) + 1, shift=4)
        y, x = np.nonzero(mask)
        crop = self._grey[low[1] : high[1], low[0] : high[0]]
        return np.column_stack([x, y]) + low.astype(np.float64), crop[y, x].astype(np.float64)


class Outline:
    """The image of a circle: a short Fourier series of the angle on the circle; a pixel is x + iy."""

    def __init__(self, coefficients: NDArray[np.complex128]) -> None:
        self._series = coefficients
        spin = np.vdot(coefficients, _ORDERS * coefficients).real
        self._outwards = -1j if spin > 0 else 1j

    @classmethod
    def of(cls, view: PlaneView, circle: Circle) -> "Outline":
        """The outline of a circle, exact to 1e-9 px.

        Each harmonic is smaller than the one before by about the circle's size over its distance.
        """
        pixels, _ = view.image_of(on_circle(circle, turn_angles(_SAMPLES)))
        spectrum = np.fft.fft(pixels[:, 0] + 1j * pixels[:, 1]) / _SAMPLES
        return cls(spectrum[_ORDERS])

    def at(self, angles: Array, derivative: int = 0) -> NDArray[np.complex128]:
        """Points (n,) or their derivatives by the angle."""
        coefficients = self._series * (1j * _ORDERS) ** derivative
        turn = np.exp(1j * angles)
        total = np.full(len(angles), coefficients[-1])
        for coefficient in coefficients[-2::-1]:
            total = total * turn + coefficient
        return np.asarray(total * turn ** int(_ORDERS[0]))

    def normals(self, angles: Array) -> NDArray[np.complex128]:
        """Unit normals (n,) that point outwards."""
        tangents = self.at(angles, 1)
        return np.asarray(self._outwards * tangents / np.abs(tangents))

    def curvatures(self, angles: Array) -> Array:
        """1 / px (n,), positive for a convex outline."""
        tangents, bends = self.at(angles, 1), self.at(angles, 2)
        return np.asarray(np.abs((tangents.conj() * bends).imag) / np.abs(tangents) ** 3)

    def feet(self, places: NDArray[np.complex128]) -> tuple[Array, Array]:
        """Angles (n,) of the nearest points, and the distances (n,) outwards, px."""
        table = turn_angles(_FEET_POINTS)
        points = self.at(table)
        middle = points.mean()
        order = np.argsort(np.angle(points - middle))
        nearest = np.interp(
            np.angle(places - middle),
            np.angle(points - middle)[order],
            np.arange(len(table), dtype=np.float64),
        )
        angles = table[order[np.rint(nearest).astype(np.intp)]]
        for _ in range(_FEET_STEPS):
            tangents = self.at(angles, 1)
            change = ((places - self.at(angles)) * tangents.conj()).real / np.abs(tangents) ** 2
            angles = angles + np.clip(change, -_MOST_FOOT_STEP_RAD, _MOST_FOOT_STEP_RAD)
        outwards = (places - self.at(angles)) * self.normals(angles).conj()
        return angles, np.asarray(outwards.real)


def turn_angles(count: int) -> Array:
    """Equally spaced angles (count,) of a whole turn, from 0."""
    return np.linspace(0, 2 * np.pi, count, endpoint=False)


def ring(angles: Array) -> Array:
    """Unit vectors (n, 2)."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


def on_circle(circle: Circle, angles: Array) -> Array:
    """Points (n, 2) of a circle."""
    return circle.centre + circle.radius * ring(angles)


def _sampled(crop: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> Array:
    """Bilinear levels (n,) of a crop at x, y (n,)."""
    padded = [
        np.pad(part, (0, -len(part) % _REMAP_ROW)).reshape(-1, _REMAP_ROW) for part in (x, y)
    ]
    levels = cv2.remap(
        crop, padded[0], padded[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(levels, np.float64).ravel()[: len(x)]
