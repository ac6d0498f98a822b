"""The rim of a circular hole in a picture, measured in sectors to a few thousandths of a pixel.

In every sector, the pixels near the rim are compared with a blurred step. A blur s pulls an edge of
curvature k inwards, so a pixel at distance d counts as one at d + k s^2 / 2 from a straight edge. One linear
solution per sector gives the levels on both sides and the offset of the rim. The blur is common to all
sectors, and the noise is measured on both sides. A circle of the plane is then fitted to the offsets,
robustly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vgrd.geometry import Array
from vgrd.vision.holes.view import Circle, Outline, PlaneView, on_circle, ring, turn_angles

_SECTOR_PX = 5.0  # of the rim: 60 pixels in a band of 6 px to either side, for 3 unknowns
_FEWEST_SECTORS = 24  # 8 for each number of the circle, so that outliers are outvoted
_MOST_SECTORS = 240  # a rim of 1200 px; longer sectors keep the time down
_WIDEST_PX = 6.0  # band to either side: 4 blurs of 1.5 px
_NARROWEST_PX = 3.0  # idem: nearly 4 usual blurs
_WIDTH_OF_RADIUS = 0.2  # of the band, so that small holes keep a middle, and next to no second rim
_COARSE_PX = (18.0, 9.0)  # bands of the approach, each from half a band away
_COARSE_EVERY = 3  # pixels; an approach needs a third of them
_APPROACHES = 6  # steps per band at most; a step below a third of the blur ends them
_BANDS = 6  # fits of the circle; it ends by _LINEAR_PX
_BLUR_STEPS = 3  # per band; each corrects the blur by Gauss-Newton
_OUTLINE_POINTS = 720  # whose chords are the rim's length to 1e-5
_LEAST_DEVIATION_PX = 1e-3  # keeps the weights of least absolute deviations finite
_LINEAR_PX = 0.03  # an offset that the linear model of an edge takes without any error
_USUAL_BLUR_PX = 0.8  # to start from: a sharp lens, 0.7 px, and the pixel's square, 0.29 px
_BLUR_RANGE_PX = (0.3, 4.0)  # the pixel's square alone; a band about as wide as the first approach
_MOST_BLUR_STEP_PX = 0.3  # per step, where the blur still depends on the offsets
_REACH_OF_BLUR = 4.0  # half a band, in blurs: 3 until _FLAT and one more for the noise
_FLAT = 3.0  # blurs from an edge where only noise is left: 0.13 % of the contrast
_COARSE_FLAT = 2.5  # idem, in the approach, whose bands end at 4 blurs
_LEAST_SIGMAS = 5.0  # contrast of a sector over a pixel's noise
_TUKEY = 4.7  # sigma without weight: 95 % efficiency for normal errors is 4.685 (Tukey's biweight)
_NORMAL_OF_MAD = 1.4826  # sigma of a normal law over its median absolute deviation, 1 / 0.6745
_REWEIGHTINGS = 8  # of the circle; a guess: twice those of the fit of edges
_MEDIAN_REWEIGHTINGS = 15  # of the start; least absolute deviations converge slowly
_QUANTISING = 1 / 12  # variance of rounding to whole grey levels
_LEAST_PIXELS = 6  # of a sector: twice its unknowns


@dataclass(frozen=True, slots=True, eq=False)
class Rim:
    """A measured rim.

    circle and its covariance (3, 3), mm^2, of (x, y, radius); offsets_px (k,): of each sector outwards
    from the circle; sigmas_px (k,): theirs, infinite where no edge is seen; weights (k,): 0 for a sector
    that does not belong to the circle; contrast (k,): level outside minus inside; blur_px; noise: sigma of
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


def measure_rim(view: PlaneView, start: Circle) -> Rim | None:
    """Fit the circle near `start`; None when hardly anything of a rim can be seen there."""
    circle: Circle | None = start
    for width in _COARSE_PX:
        circle = circle and _approach(view, circle, width)
    if circle is None:
        return None
    blur, rim = _USUAL_BLUR_PX, None
    for _ in range(_BANDS):
        band = _Band.around(view, circle, max(_WIDEST_PX, _REACH_OF_BLUR * blur))
        if band is None:
            return None
        for _ in range(_BLUR_STEPS):
            edges, blur = _edges(band, blur, _FLAT)
        if edges.count < _FEWEST_SECTORS // 2:
            return None
        rim, shift_px = _rim(band, edges, circle, blur)
        circle = rim.circle
        if shift_px < _LINEAR_PX:
            break
    return rim


def _approach(view: PlaneView, circle: Circle, width_px: float) -> Circle | None:
    """The circle after an approach from up to `width_px` / 2 away; None where no rim is.

    The model is blurred by as much as it may be off, so that it feels the rim from there.
    """
    for _ in range(_APPROACHES):
        band = _Band.around(view, circle, width_px, _COARSE_EVERY)
        if band is None:
            return None
        blur = band.width / 4
        edges, _ = _edges(band, blur, _COARSE_FLAT)
        if edges.count < _FEWEST_SECTORS // 2:
            return None
        # A sharp edge seen through a blurred model seems to be twice as far off as it is.
        shift = _least_absolute(band.slopes[edges.has_edge], edges.offsets[edges.has_edge]) / 2
        shift_px = float(np.abs(band.slopes @ shift).max())
        shift *= min(1.0, blur / shift_px) if shift_px > 0 else 1.0
        circle = Circle(circle.centre + shift[:2], circle.radius + float(shift[2]))
        if shift_px < blur / 3 or circle.radius <= 0:
            break
    return circle if circle.radius > 0 else None


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
        cls, view: PlaneView, circle: Circle, widest_px: float, every: int = 1
    ) -> "_Band | None":
        """Band around the image of a circle, of every n-th pixel; None where there is no picture."""
        outline = Outline.of(view, circle)
        points = outline.at(turn_angles(_OUTLINE_POINTS))
        if not np.isfinite(points).all():
            return None
        length = float(np.abs(np.diff(points, append=points[:1])).sum())
        thinnest = float(np.abs(points - points.mean()).min())
        width = float(np.clip(_WIDTH_OF_RADIUS * thinnest, _NARROWEST_PX, widest_px))
        pixels = view.pixels_near(np.column_stack([points.real, points.imag]), width)
        if pixels is None:
            return None
        places, levels = pixels[0][::every], pixels[1][::every]
        feet, distances = outline.feet(places[:, 0] + 1j * places[:, 1])
        count = int(np.clip(length / _SECTOR_PX, _FEWEST_SECTORS, _MOST_SECTORS))
        sectors = np.rint(feet / (2 * np.pi) * count).astype(np.intp) % count
        is_in_band = np.abs(distances) <= width
        return cls(
            levels[is_in_band],
            distances[is_in_band],
            outline.curvatures(feet[is_in_band]),
            sectors[is_in_band],
            _slopes(view, circle, outline, turn_angles(count)),
            width,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Offsets (k,) px with sigmas (k,), contrast (k,), and the sigma of a pixel's noise outside."""

    offsets: Array
    sigmas: Array
    contrast: Array
    noise: float

    @property
    def has_edge(self) -> NDArray[np.bool_]:
        """Sectors (k,) that show an edge."""
        return np.isfinite(self.sigmas)

    @property
    def count(self) -> int:
        """Number of sectors that show an edge."""
        return int(self.has_edge.sum())


def _edges(band: _Band, blur: float, flat: float) -> tuple[_Edges, float]:
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
        dark = max(_spread(residuals[distance < -flat * blur]), _QUANTISING)
        light = max(_spread(residuals[distance > flat * blur]), _QUANTISING)
        weights = 1 / (dark + (light - dark) * share)
        noise = float(np.sqrt(light))
    _, inverse = _solve_sectors(columns, band, weights, count)
    contrast = outside - inside
    has_edge = (np.abs(contrast) > _LEAST_SIGMAS * noise) & np.isfinite(inverse[:, 2, 2])
    divisor = np.where(has_edge, contrast, 1.0)
    offsets = np.where(has_edge, solution[:, 2] / divisor, 0.0)
    sigmas = np.where(has_edge, np.sqrt(np.abs(inverse[:, 2, 2])) / np.abs(divisor), np.inf)
    slope = -contrast[band.sectors] * bell * distance / blur**2
    good = has_edge[band.sectors] & (np.abs(offsets[band.sectors]) < blur)
    curvature = float((weights * slope**2)[good].sum())
    change = float((weights * slope * residuals)[good].sum()) / curvature if curvature > 0 else 0.0
    change = np.clip(change, -_MOST_BLUR_STEP_PX, _MOST_BLUR_STEP_PX)
    blur = float(np.clip(blur + change, *_BLUR_RANGE_PX))
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
    poor |= np.linalg.cond(normal) > 1e8  # pixels on one side of the rim only
    normal[poor] = np.eye(3)
    inverse = np.asarray(np.linalg.inv(normal), np.float64)
    inverse[poor] = np.nan
    return np.nan_to_num(np.einsum("kij,kj->ki", inverse, right)), inverse


def _rim(band: _Band, edges: _Edges, circle: Circle, blur: float) -> tuple[Rim, float]:
    """Robust circle through the edges, and the largest motion of the rim, px."""
    has_edge = edges.has_edge
    J = band.slopes[has_edge] / edges.sigmas[has_edge, None]
    r = edges.offsets[has_edge] / edges.sigmas[has_edge]
    step = _least_absolute(band.slopes[has_edge], edges.offsets[has_edge])
    biweight = np.ones(len(r))
    for _ in range(_REWEIGHTINGS):
        residual = r - J @ step
        scale = max(1.0, _NORMAL_OF_MAD * float(np.median(np.abs(residual))))
        biweight = np.maximum(1 - (residual / (_TUKEY * scale)) ** 2, 0.0) ** 2
        root = np.sqrt(biweight)[:, None]
        step = np.asarray(np.linalg.lstsq(J * root, r * root[:, 0], rcond=None)[0], np.float64)
    chi2 = float((biweight * (r - J @ step) ** 2).sum() / max(biweight.sum() - 3, 1))
    weights = np.zeros(len(has_edge))
    weights[has_edge] = biweight
    rim = Rim(
        circle=Circle(circle.centre + step[:2], circle.radius + float(step[2])),
        covariance=np.asarray(
            np.linalg.pinv((J * biweight[:, None]).T @ J) * max(chi2, 1.0), np.float64
        ),
        offsets_px=edges.offsets - band.slopes @ step,
        sigmas_px=edges.sigmas,
        weights=weights,
        contrast=edges.contrast,
        blur_px=blur,
        noise=edges.noise,
        chi2=chi2,
    )
    return rim, float(np.abs(band.slopes @ step).max())


def _least_absolute(slopes: Array, offsets: Array) -> Array:
    """Step (3,) of the circle with the least absolute deviations: a robust start, by reweighting."""
    weights = np.ones(len(offsets))
    step: Array = np.zeros(3)
    for _ in range(_MEDIAN_REWEIGHTINGS):
        root = np.sqrt(weights)[:, None]
        step = np.asarray(
            np.linalg.lstsq(slopes * root, offsets * root[:, 0], rcond=None)[0], np.float64
        )
        weights = 1 / np.maximum(np.abs(offsets - slopes @ step), _LEAST_DEVIATION_PX)
    return step


def _slopes(view: PlaneView, circle: Circle, outline: Outline, angles: Array) -> Array:
    """Derivative (k, 3), px / mm, of the rim's place, outwards, by the circle's x, y and radius."""
    _, J = view.image_of(on_circle(circle, angles))
    normals = outline.normals(angles)
    J_centre = np.einsum("ni,nij->nj", np.column_stack([normals.real, normals.imag]), J)
    return np.column_stack([J_centre, (J_centre * ring(angles)).sum(1)])


def _spread(residuals: Array) -> float:
    """Robust variance."""
    if residuals.size < _LEAST_PIXELS:
        return 0.0
    return float(_NORMAL_OF_MAD * np.median(np.abs(residuals))) ** 2
