"""The rim of a circular hole in a picture, measured in sectors to a few thousandths of a pixel.

In every sector the pixels near the rim are compared with a blurred step at their exact distance from the
image of the circle: d + k s^2 / 2, because a blur s pulls an edge of curvature k inwards. One linear
solution gives the levels on both sides and how far the rim is off; the blur is common to all sectors and
the noise is measured on both sides. A circle in the plane is then fitted to the sectors, robustly.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel

Grey = NDArray[np.uint8] | NDArray[np.uint16]

_SECTOR_PX = 5.0
_FEWEST_SECTORS, _MOST_SECTORS = 24, 240
_WIDEST_PX, _NARROWEST_PX = 6.0, 3.0
_WIDTH_OF_RADIUS = 0.2
_COARSE_PX = (18.0, 9.0)
_COARSE_EVERY = 3
_APPROACHES = 6
_BANDS, _BLUR_STEPS = 6, 3
_LINEAR_PX = 0.03  # an offset that the linear model of an edge takes without any error
_USUAL_BLUR_PX = 0.8
_REACH_OF_BLUR = 4.0
_TUKEY = 4.7
_QUANTISING = 1 / 12
_LEAST_PIXELS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """In a plane: centre (2,) and radius, mm."""

    centre: Array
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class Rim:
    """What was measured.

    circle and its covariance (3, 3), mm^2, of (x, y, radius); offsets_px (k,): of each sector outwards
    from the circle, infinite sigmas_px (k,) where it cannot be seen; weights (k,): 0 for a sector that
    does not belong to the circle; contrast (k,): level outside minus inside; blur_px; noise: sigma of
    a pixel; chi2: of the sectors, per degree of freedom.
    """

    circle: Circle
    covariance: Array
    offsets_px: Array
    sigmas_px: Array
    weights: Array
    contrast: Array
    blur_px: float
    noise: float
    chi2: float


class RimView:
    """Looks at circles of one plane in one picture: grey (h, w), camera_from_plane in mm."""

    def __init__(self, grey: Grey, camera: CameraModel, camera_from_plane: Pose) -> None:
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
        outline = self.image_of(_on_circle(circle, _angles(64)))[0]
        low, high = outline.min(0) - margin_px, outline.max(0) + margin_px
        size = np.array(self._grey.shape[::-1])
        return bool(np.isfinite(outline).all() and (low >= 0).all() and (high < size).all())

    def measure(self, start: Circle) -> Rim | None:
        """Fit the circle near `start`; None when hardly anything of a rim can be seen there."""
        circle: Circle | None = start
        for width in _COARSE_PX:
            circle = circle and self._approach(circle, width)
        if circle is None:
            return None
        blur, rim = _USUAL_BLUR_PX, None
        for _ in range(_BANDS):
            band = _Band.around(self, circle, max(_WIDEST_PX, _REACH_OF_BLUR * blur))
            if band is None:
                return None
            for _ in range(_BLUR_STEPS):
                edges, blur = _edges(band, blur)
            if edges.count < _FEWEST_SECTORS // 2:
                return None
            rim, moved = _rim(band, edges, circle, blur)
            circle = rim.circle
            if moved < _LINEAR_PX:
                break
        return rim

    def _approach(self, circle: Circle, width_px: float) -> Circle | None:
        """Come near from some `width_px` / 2 away, with a step as blurred as that; None: no rim."""
        for _ in range(_APPROACHES):
            band = _Band.around(self, circle, width_px, _COARSE_EVERY)
            if band is None:
                return None
            blur = band.width / 3
            edges, _ = _edges(band, blur)
            if edges.count < _FEWEST_SECTORS // 2:
                return None
            shift = _most_agreed(band.slopes[edges.seen], edges.offsets[edges.seen])
            moved = float(np.abs(band.slopes @ shift).max())
            shift *= min(1.0, blur / moved) if moved > 0 else 1.0
            circle = Circle(circle.centre + shift[:2], circle.radius + float(shift[2]))
            if moved < blur / 10 or circle.radius <= 0:
                break
        return circle if circle.radius > 0 else None

    def px_per_mm(self, place: Array) -> float:
        """Largest magnification at a place (2,) of the plane."""
        return float(np.linalg.norm(self.image_of(place[None])[1][0], 2))

    def levels_at(self, places: Array, apart_mm: float) -> Array:
        """Grey levels (n,) at places (n, 2) that are `apart_mm` apart; 0 outside of the picture."""
        pixels, _ = self.image_of(places)
        pixels = np.nan_to_num(pixels, nan=-1e6)
        low = np.clip(np.floor(pixels.min(0)) - 4, 0, None).astype(int)
        high = np.minimum(np.ceil(pixels.max(0)) + 5, self._grey.shape[::-1]).astype(int)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """Pixels near the image of a circle.

    levels (n,), distances (n,) outwards in px, curvatures (n,) 1 / px, sectors (n,) indices;
    slopes (k, 3): how far, px, each sector's rim moves with the circle's (x, y, radius); width: of the
    band to either side, px.
    """

    levels: Array
    distances: Array
    curvatures: Array
    sectors: NDArray[np.intp]
    slopes: Array
    width: float

    @classmethod
    def around(
        cls, view: RimView, circle: Circle, widest_px: float, every: int = 1
    ) -> "_Band | None":
        """Band around the image of a circle, of every n-th pixel; None where there is no picture."""
        angles = _angles(720)
        outline, _ = view.image_of(_on_circle(circle, angles))
        if not np.isfinite(outline).all():
            return None
        ways = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
        length = float(np.linalg.norm(ways, axis=1).sum() / 2)
        thinnest = float(np.linalg.norm(outline - outline.mean(0), axis=1).min())
        width = float(np.clip(_WIDTH_OF_RADIUS * thinnest, _NARROWEST_PX, widest_px))
        near = view.pixels_near(outline, width)
        if near is None:
            return None
        places, levels = near[0][::every], near[1][::every]
        feet, distances = _feet(view, circle, places)
        count = int(np.clip(length / _SECTOR_PX, _FEWEST_SECTORS, _MOST_SECTORS))
        middle = _angles(count)
        sectors = np.rint(feet / (2 * np.pi) * count).astype(np.intp) % count
        kept = np.abs(distances) <= width
        bends = np.interp(feet % (2 * np.pi), angles, _curvature(outline), period=2 * np.pi)
        slopes = _slopes(view, circle, middle)
        return cls(levels[kept], distances[kept], bends[kept], sectors[kept], slopes, width)


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Offsets (k,) px with sigmas (k,), contrast (k,), and the sigma of a pixel's noise outside."""

    offsets: Array
    sigmas: Array
    contrast: Array
    noise: float

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Sectors (k,) that show an edge."""
        return np.isfinite(self.sigmas)

    @property
    def count(self) -> int:
        """How many these are."""
        return int(self.seen.sum())


def _edges(band: _Band, blur: float) -> tuple[_Edges, float]:
    """Edge of every sector by one linear least-squares step, and the blur after one step."""
    distance = band.distances + band.curvatures * blur**2 / 2
    share = ndtr(distance / blur)
    bell = np.exp(-0.5 * (distance / blur) ** 2) / np.sqrt(2 * np.pi)
    count = len(band.slopes)
    columns = np.stack([1 - share, share, -bell / blur])
    weights = np.ones(len(share))
    noise = 1.0
    for _ in range(2):
        solution, inverse = _solve_sectors(columns, band, weights, count)
        inside, outside = solution[:, 0], solution[:, 1]
        residuals = band.levels - np.einsum("ni,in->n", solution[band.sectors], columns)
        dark = max(_spread(residuals[distance < -3 * blur]), _QUANTISING)
        light = max(_spread(residuals[distance > 3 * blur]), _QUANTISING)
        weights = 1 / (dark + (light - dark) * share)
        noise = float(np.sqrt(light))
    _, inverse = _solve_sectors(columns, band, weights, count)
    contrast = outside - inside
    seen = (np.abs(contrast) > 5 * noise) & np.isfinite(inverse[:, 2, 2])
    safe = np.where(seen, contrast, 1.0)
    offsets = np.where(seen, solution[:, 2] / safe, 0.0)
    sigmas = np.where(seen, np.sqrt(np.abs(inverse[:, 2, 2])) / np.abs(safe), np.inf)
    slope = -contrast[band.sectors] * bell * distance / blur**2
    good = seen[band.sectors] & (np.abs(offsets[band.sectors]) < blur)
    down = float((weights * slope**2)[good].sum())
    change = float((weights * slope * residuals)[good].sum()) / down if down > 0 else 0.0
    blur = float(np.clip(blur + np.clip(change, -0.3, 0.3), 0.3, 4.0))
    return _Edges(offsets, sigmas, contrast, noise), blur


def _solve_sectors(columns: Array, band: _Band, weights: Array, count: int) -> tuple[Array, Array]:
    """Solutions (k, 3) and inverse normal matrices (k, 3, 3); NaN where a sector has too few pixels."""
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for i in range(3):
        weighted = weights * columns[i]
        right[:, i] = np.bincount(band.sectors, weighted * band.levels, count)
        for j in range(i + 1):
            total = np.bincount(band.sectors, weighted * columns[j], count)
            normal[:, i, j] = normal[:, j, i] = total
    poor = np.bincount(band.sectors, minlength=count) < _LEAST_PIXELS
    poor |= np.linalg.cond(normal) > 1e8
    normal[poor] = np.eye(3)
    inverse = np.linalg.inv(normal)
    inverse[poor] = np.nan
    return np.nan_to_num(np.einsum("kij,kj->ki", inverse, right)), inverse


def _rim(band: _Band, edges: _Edges, circle: Circle, blur: float) -> tuple[Rim, float]:
    """Robust circle through the edges, and how far it moved anywhere, px."""
    seen = edges.seen
    J = band.slopes[seen] / edges.sigmas[seen, None]
    r = edges.offsets[seen] / edges.sigmas[seen]
    step = _most_agreed(band.slopes[seen], edges.offsets[seen])
    kept = np.ones(len(r))
    for _ in range(8):
        left = r - J @ step
        scale = max(1.0, 1.4826 * float(np.median(np.abs(left))))
        kept = np.maximum(1 - (left / (_TUKEY * scale)) ** 2, 0.0) ** 2
        half = np.sqrt(kept)[:, None]
        step = np.linalg.lstsq(J * half, r * half[:, 0], rcond=None)[0]
    chi2 = float((kept * (r - J @ step) ** 2).sum() / max(kept.sum() - 3, 1))
    weights = np.zeros(len(seen))
    weights[seen] = kept
    found = Rim(
        circle=Circle(circle.centre + step[:2], circle.radius + float(step[2])),
        covariance=np.linalg.pinv((J * kept[:, None]).T @ J) * max(chi2, 1.0),
        offsets_px=edges.offsets - band.slopes @ step,
        sigmas_px=edges.sigmas,
        weights=weights,
        contrast=edges.contrast,
        blur_px=blur,
        noise=edges.noise,
        chi2=chi2,
    )
    return found, float(np.abs(band.slopes @ step).max())


def _most_agreed(slopes: Array, offsets: Array) -> Array:
    """Robust start: least absolute deviations by reweighting."""
    weights = np.ones(len(offsets))
    step = np.zeros(3)
    for _ in range(15):
        half = np.sqrt(weights)[:, None]
        step = np.linalg.lstsq(slopes * half, offsets * half[:, 0], rcond=None)[0]
        weights = 1 / np.maximum(np.abs(offsets - slopes @ step), 1e-3)
    return step


def _feet(view: RimView, circle: Circle, places: Array) -> tuple[Array, Array]:
    """Angles (n,) of the nearest points of the rim's image, and the distances (n,) outwards, px."""
    middle, J = view.image_of(circle.centre[None])
    near = np.linalg.solve(J[0], (places - middle).T)
    angles = np.arctan2(near[1], near[0])
    for _ in range(3):
        on_rim, J = view.image_of(_on_circle(circle, angles))
        tangents = circle.radius * np.einsum("nij,nj->ni", J, _ring(angles + np.pi / 2))
        along = ((places - on_rim) * tangents).sum(1) / (tangents**2).sum(1)
        angles = angles + np.clip(along, -0.3, 0.3)
    on_rim, J = view.image_of(_on_circle(circle, angles))
    tangents = np.einsum("nij,nj->ni", J, _ring(angles + np.pi / 2))
    normals = _outwards(tangents, J, angles)
    return angles, ((places - on_rim) * normals).sum(1)


def _slopes(view: RimView, circle: Circle, angles: Array) -> Array:
    """How far (k, 3), px, the rim moves outwards per mm of the circle's x, y and radius."""
    _, J = view.image_of(_on_circle(circle, angles))
    tangents = np.einsum("nij,nj->ni", J, _ring(angles + np.pi / 2))
    normals = _outwards(tangents, J, angles)
    by_centre = np.einsum("ni,nij->nj", normals, J)
    return np.column_stack([by_centre, (by_centre * _ring(angles)).sum(1)])


def _outwards(tangents: Array, J: Array, angles: Array) -> Array:
    """Unit normals (n, 2) to the rim's image that point out of it."""
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    out = np.einsum("nij,nj->ni", J, _ring(angles))
    return normals * np.sign((normals * out).sum(1))[:, None]


def _curvature(outline: Array) -> Array:
    """Curvature (m,), 1 / px, of a closed convex outline (m, 2)."""
    first = (np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)) / 2
    second = np.roll(outline, -1, axis=0) - 2 * outline + np.roll(outline, 1, axis=0)
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return np.abs(cross) / np.linalg.norm(first, axis=1) ** 3


def _sampled(crop: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> Array:
    """Bilinear levels (n,) of a crop at x, y (n,), 0 outside; in rows, because OpenCV limits a map's sides."""
    row = 4096
    padded = [np.pad(part, (0, -len(part) % row)).reshape(-1, row) for part in (x, y)]
    levels = cv2.remap(crop, padded[0], padded[1], cv2.INTER_LINEAR)
    return np.asarray(levels, np.float64).ravel()[: len(x)]


def _spread(residuals: Array) -> float:
    """Robust variance."""
    if residuals.size < _LEAST_PIXELS:
        return 0.0
    return float(1.4826 * np.median(np.abs(residuals))) ** 2


def _angles(count: int) -> Array:
    return np.linspace(0, 2 * np.pi, count, endpoint=False)


def _ring(angles: Array) -> Array:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _on_circle(circle: Circle, angles: Array) -> Array:
    return circle.centre + circle.radius * _ring(angles)
