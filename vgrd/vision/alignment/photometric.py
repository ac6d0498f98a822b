"""Photometric alignment: the homography of a printed raster from all of its pixels, at the noise limit.

Gauss-Newton over 8 parameters of the homography, 3 of the blur, bloom, and a gain and an offset that
vary over the target. The result is the four corners with their covariance. They carry all that
the picture tells: a pose is fitted to them, not to the pixels (`vgrd.vision.tags.planar_pose`).
Numbers in comments are the equations of docs/photometric.md.
"""

from dataclasses import replace

import numpy as np

from vgrd.devices import Grey
from vgrd.geometry import Array
from vgrd.vision.alignment.gathering import gather
from vgrd.vision.alignment.normal_equations import BLOOM, LIGHT, SHAPE, accumulate, side_scores
from vgrd.vision.alignment.photometric_fit import PhotometricFit
from vgrd.vision.alignment.scatter import FreeLines, scattered
from vgrd.vision.alignment.veil import no_veils, veils_at
from vgrd.vision.images.homography import apply, inverse, moved, normalised, to_pixels
from vgrd.vision.images.noise import UNKNOWN_NOISE, CameraNoise, noise_in, noise_left
from vgrd.vision.images.warp import LocalFrame
from vgrd.vision.print.raster import Raster
from vgrd.vision.print.tolerance import PrintTolerance

_SIGMA_PX = 0.8  # blur to start from: a sharp lens, 0.7 px, and the pixel's square, 0.29 px
_REACH_SIGMAS = 3.4  # beyond lie erfc(3.4) = 1.5e-6 of what an edge tells of its place (15)
_MARGIN_PX = 0.5  # error of the start; the fit of edges before errs by 0.07 at most, drawn tags
_QUADRATIC_LIGHT_PX = 400.0  # planes of light: 1.3 times the bound at 404 px, 2.9 times at 638 px
_MAX_STEPS = 14  # drawn clean tags need 2 or 3, so a fit that needs more runs away
_SPARSE = 4  # every fourth pixel, while there are many: twice the error, far below a first step's
_MANY = 4000  # edge pixels: a tag of 70 px; fewer take less than 0.3 ms a step, all of them
_UNEXPLAINED = 1.2  # chi-square from which veils are sought; ten sigma of it, clean tags have 1.1
_VEIL = 1.0  # of a share of light, sigma; as good as none, but it holds what no pixel tells
_HELD = 1e-4  # of the blur, sigma: veils are linear in it as it was when they were made
_FEWEST = 60  # edge pixels: 18 or 24 unknowns
_ENOUGH_FOR_LIGHT = 1500  # pixels for 6 or 12 numbers, which the next step corrects anyway
_SETTLED_PX = 0.2  # a step leaves about its square, in px: 0.04
_STILL_PX = 0.01  # idem: 1e-4, a tenth of the noise of a corner
_FARTHEST_PX = 6.0  # of one step; edges of the usual blur are felt over half of that
_LEAST_CONTRAST = 6.0  # grey levels; half of what a tag's code is read with (`tags.detection`)
_ANISOTROPY_PX2 = 0.5  # sigma of (18): the variance that a motion of 2.4 px adds, L^2 / 12
_MOST_INK_CELL = 0.03  # of the smallest cell: 0.01 mm of 0.33 mm; a tag of unknown size is 1 mm
_BLOOM_PX = (
    0.05  # sigma where lines are free: then it passes for a larger square; 0.005 mm at 0.1 mm/px
)
_MOST_CELLS = 150  # of a tag: 12 x 12 with its rim; the sides of a board are thousands: minutes
_LEAST_BLUR_PX = 0.35  # the pixel's square alone has 0.29
_MOST_BLUR_PX = 6.0  # felt over 20 px, a cell of a tag of 160 px; farther cells do not count
_MOST_SHRINKING = 0.7  # of a variance of the blur in one step, so that it stays positive
_MOST_BLOOM_STEP_PX = 0.5  # less than the usual blur, over which the model is about linear
_MOST_CORRELATION = 0.95  # of the blur's x and y: 6 times as long as wide, a motion of 16 px


def align(
    picture: Grey,
    raster: Raster,
    frame: LocalFrame,
    q_from_target: Array,
    noise: CameraNoise | None = None,
    sigma_px: float = _SIGMA_PX,
    ink_mm: float = PrintTolerance().ink_mm,
    lines: FreeLines | None = None,
) -> PhotometricFit | None:
    """Align a raster from a start good to about a pixel; None when the iteration finds no minimum.

    q_from_target: homography (3, 3) from the target's plane (mm) to the frame's q plane. ink_mm: how far
    ink may spread, as a standard deviation. lines: those whose place is to be found too.
    """
    H = normalised(q_from_target)
    corners = apply(H, raster.corners)
    scale = float(np.abs(corners - corners.mean(0)).max())
    return _Iteration(picture, raster, frame, H, scale, noise, sigma_px, ink_mm, lines).run()


class _Iteration:
    """The state of one Gauss-Newton iteration."""

    def __init__(
        self,
        picture: Grey,
        raster: Raster,
        frame: LocalFrame,
        H: Array,
        scale: float,
        noise: CameraNoise | None,
        sigma_px: float,
        ink_mm: float,
        lines: FreeLines | None,
    ) -> None:
        self.picture, self.raster, self.frame = picture, raster, frame
        self.H, self.scale = H, scale
        self.terms = 6 if 2 * scale > _QUADRATIC_LIGHT_PX else 3
        self.given_noise, self.lines = noise, lines
        self.ink_mm = min(ink_mm, _MOST_INK_CELL * raster.smallest_cell)
        self.px_per_mm = _perimeter(apply(H, raster.corners)) / _perimeter(raster.corners)
        if lines is not None:
            self.ink_mm = min(self.ink_mm, _BLOOM_PX / self.px_per_mm)
        self.S = np.array([1.0, 0.0, 1.0]) * sigma_px**2
        self.bloom = np.zeros(3)
        self.gain, self.offset = np.zeros(self.terms), np.zeros(self.terms)
        self._gather()

    def _gather(self) -> None:
        """Choose the pixels near the edges of the present homography, and measure the noise."""
        self.reach = _reach(self.S) + _MARGIN_PX  # 15
        self.gathered_corners = apply(self.H, self.raster.corners)
        frame, raster = self.frame, self.raster
        self.q, self.level, self.cell, self.pixel, self.edges, lost, flat = gather(
            self.picture,
            frame.lens,
            frame.r0,
            frame.F,
            self.H,
            inverse(self.H),
            (raster.x, raster.y, raster.cells),
            self.reach,
        )
        self.veils, self.veil = no_veils(len(self.level)), np.zeros(0)
        self.residual = np.zeros(len(self.level))
        self.seen = np.zeros((self.edges if self._has_few_cells else 0, 13))
        self.outside = lost / max(len(self.level) + lost, 1)
        told = self.given_noise or noise_in(flat)
        self.noise, self.is_noise_known = told or UNKNOWN_NOISE, told is not None

    def run(self) -> PhotometricFit | None:
        """Iterate to the minimum: first on a part of the pixels, in the end on all; with veils if they are needed."""
        fit = self._descend(self._sparse) if self._fit_light() else None
        if fit is None or fit.chi2 < _UNEXPLAINED or not self._has_few_cells:
            return fit
        self._add_veils()
        veiled = self._descend(1)
        return fit if veiled is None else replace(veiled, veiled=fit.flat_misfit)

    def _descend(self, every: int) -> PhotometricFit | None:
        for step in range(1, _MAX_STEPS + 1):
            equations = self._normal_equations(every)
            change = _solved(*equations[:2])
            if change is None:
                return None
            shift = self._take(change)
            if not shift < _FARTHEST_PX:
                return None
            if shift < _SETTLED_PX or step > _MAX_STEPS // 2:
                if self._strayed():
                    self._gather()
                    if not self._fit_light():
                        return None
                elif every == 1 and shift < _STILL_PX and not self.is_noise_known:
                    self._learn_noise()
                elif every == 1 and shift < _STILL_PX:
                    return self._result(equations, change, step)
                else:
                    every = 1
        return None

    @property
    def _has_few_cells(self) -> bool:
        """Whether the place of each side is told, as of a tag; not of a board."""
        return self.raster.cells.size <= _MOST_CELLS

    def _strayed(self) -> bool:
        """Whether the pixels were chosen for corners or a blur that no longer hold; with veils they stay."""
        if len(self.veil):
            return False
        shift = np.abs(apply(self.H, self.raster.corners) - self.gathered_corners).max()
        return bool(shift > _MARGIN_PX / 2 or _reach(self.S) > self.reach)

    @property
    def _sparse(self) -> int:
        return _SPARSE if self.edges > _MANY else 1

    def _normal_equations(self, every: int) -> tuple[Array, Array, float, int]:
        """Sums of `accumulate` (17), with a weak belief that the blur is round (18)."""
        raster = self.raster
        A, g, chi2, count = accumulate(
            self.q,
            self.level,
            self.cell,
            self.edges,
            every,
            inverse(self.H),
            raster.x,
            raster.y,
            raster.cells,
            self.scale,
            self.S,
            self.bloom,
            self.gain,
            self.offset,
            self.veils,
            self.veil,
            np.array([self.noise.shot, self.noise.read]),
            self.residual,
            self.seen,
        )
        # Where pixels err by more than noise, so much less they may overrule a belief.
        scale = max(chi2 / max(count - len(g), 1), 1.0)
        for row in np.array([[1.0, 0.0, -1.0], [0.0, 2.0, 0.0]]) / _ANISOTROPY_PX2:
            A[SHAPE:BLOOM, SHAPE:BLOOM] += scale * np.outer(row, row)
            g[SHAPE:BLOOM] -= scale * row * (row @ self.S)
        belief = scale / self.ink_mm**2
        A[BLOOM + 1 : LIGHT, BLOOM + 1 : LIGHT] += belief * np.eye(2)
        g[BLOOM + 1 : LIGHT] -= belief * self.bloom[1:]
        if len(self.veil):
            self._believe_veils(A, g, scale)
        if self.lines is not None:
            A[BLOOM, BLOOM] += scale / _BLOOM_PX**2
            g[BLOOM] -= scale * self.bloom[0] / _BLOOM_PX**2
        return A, g, chi2, count

    def _fit_light(self) -> bool:
        """Solve for gain and offset alone; false when there is nothing to see."""
        if self.edges < _FEWEST:
            return False
        self.gain, self.offset = np.zeros(self.terms), np.zeros(self.terms)
        A, g, _, _ = self._normal_equations(max(len(self.level) // _ENOUGH_FOR_LIGHT, 1))
        light = _solved(A[LIGHT:, LIGHT:], g[LIGHT:])
        if light is None:
            return False
        self.gain, self.offset = light[: self.terms], light[self.terms :]
        return bool(self.gain[0] > _LEAST_CONTRAST)

    def _learn_noise(self) -> None:
        """Take the noise from what the last step saw: small cells have no flat pixels."""
        rest = self.residual * np.sqrt(self.noise.read)  # UNKNOWN_NOISE has no other part
        middle = float(self.offset[0] + self.gain[0] / 2)
        told = noise_left(self.pixel, self.level - rest, rest, middle)
        self.noise, self.is_noise_known = told or self.noise, True

    def _believe_veils(self, A: Array, g: Array, scale: float) -> None:
        """Hold the blur that the veils are made of, and the veils that no pixel tells of."""
        weight = np.zeros(len(g))
        weight[SHAPE:BLOOM] = scale / (_HELD * float(self.S_held[[0, 2]].mean())) ** 2
        weight[-len(self.veil) :] = scale / _VEIL**2
        A += np.diag(weight)
        g[SHAPE:BLOOM] -= weight[SHAPE:BLOOM] * (self.S - self.S_held)
        g[-len(self.veil) :] -= weight[-len(self.veil) :] * self.veil

    def _add_veils(self) -> None:
        share = self.raster.cells[self.cell[:, 1], self.cell[:, 0]]
        share[: self.edges] = self.seen[:, 12]
        sigma = float(np.sqrt((self.S[0] + self.S[2]) / 2))
        self.veils = veils_at(self.frame, self.raster, self.H, self.pixel, share, sigma)
        self.veil, self.S_held = np.zeros(self.veils.shape[1]), self.S
        self.residual, self.seen = (
            self.residual.copy(),
            self.seen.copy(),
        )  # the plain fit keeps its own

    def _take(self, change: Array) -> float:
        """Apply a step; returns the largest change, px, of a corner, of the blur's sigma, of the bloom."""
        corners = apply(self.H, self.raster.corners)
        self.H = moved(self.H, change[:SHAPE], self.scale)
        shift = np.abs(apply(self.H, self.raster.corners) - corners).max()
        sigma = np.sqrt(self.S[[0, 2]])
        limit = _MOST_SHRINKING * self.S[[0, 0, 2]]
        self.S = _blur_within(self.S + np.clip(change[SHAPE:BLOOM], -limit, 2 * limit))
        limit = _MOST_BLOOM_STEP_PX / np.array([1.0, self.px_per_mm, self.px_per_mm])
        self.bloom = self.bloom + np.clip(change[BLOOM:LIGHT], -limit, limit)
        self.gain = self.gain + change[LIGHT : LIGHT + self.terms]
        self.offset = self.offset + change[LIGHT + self.terms : LIGHT + 2 * self.terms]
        self.veil = self.veil + change[LIGHT + 2 * self.terms :]
        blurred = np.abs(np.sqrt(self.S[[0, 2]]) - sigma).max()
        bloomed = np.abs(change[BLOOM] + self.px_per_mm * change[BLOOM + 1 : LIGHT]).max()
        return float(max(shift, blurred, bloomed))

    def _result(
        self, equations: tuple[Array, Array, float, int], change: Array, steps: int
    ) -> PhotometricFit:
        if self.lines is not None:  # they tell so little of some that the last step spoils it
            equations = self._normal_equations(1)
            last = _solved(*equations[:2])
            change = change if last is None else last
        A, g, chi2, count = equations
        count, chi2 = max(count - len(g), 1), float(chi2 - g @ change)
        inverted = _inverse(A)  # 19
        covariance = inverted[:SHAPE, :SHAPE]
        if self._has_few_cells:
            covariance, shift = scattered(self._scores(), inverted, change, self.lines)
            self.H = moved(self.H, shift, self.scale)
        else:
            covariance = covariance * max(chi2 / count, 1.0)
        q = apply(self.H, self.raster.corners)
        corners, covariance = to_pixels(self.frame, q, covariance, self.scale)
        return PhotometricFit(
            corners_px=corners,
            covariance=covariance,
            chi2=chi2 / count,
            steps=steps,
            blur=np.array([[self.S[0], self.S[1]], [self.S[1], self.S[2]]]),
            bloom_px=float(self.bloom[0] + self.px_per_mm * self.bloom[1:].mean()),
            ink_mm=self.bloom[1:],
            gain=self.gain,
            offset=self.offset,
            noise=self.noise,
            outside=self.outside,
            residuals=self.residual,
            q=self.q,
            cells=self.cell,
            edge_pixels=self.edges,
            q_from_target=self.H,
            frame=self.frame,
        )

    def _scores(self) -> tuple[Array, Array, Array]:
        """What the residuals tell of the place of each side of a cell."""
        raster = self.raster
        return side_scores(
            self.q,
            self.cell,
            self.edges,
            inverse(self.H),
            raster.x,
            raster.y,
            raster.cells,
            self.scale,
            self.gain,
            self.offset,
            self.veils,
            self.veil,
            np.array([self.noise.shot, self.noise.read]),
            self.residual,
            self.seen,
        )


def _perimeter(corners: Array) -> float:
    return float(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).sum())


def _reach(S: Array) -> float:
    """Distance from an edge, px, up to which its blur counts."""
    return float(_REACH_SIGMAS * np.sqrt(max(S[0], S[2])))


def _blur_within(S: Array) -> Array:
    """Blur (3,) with variances within bounds and less than full correlation."""
    xx, yy = np.clip(S[[0, 2]], _LEAST_BLUR_PX**2, _MOST_BLUR_PX**2)
    most = _MOST_CORRELATION * np.sqrt(xx * yy)
    return np.array([xx, np.clip(S[1], -most, most), yy])


def _solved(A: Array, g: Array) -> Array | None:
    """Solution of the normal equations; None when they are singular."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))  # an unknown that no pixel tells of
    try:
        x = scale * np.linalg.solve(A * np.outer(scale, scale), scale * g)
    except np.linalg.LinAlgError:
        return None
    return x if np.isfinite(x).all() else None


def _inverse(A: Array) -> Array:
    scale = 1 / np.sqrt(np.diag(A))
    return np.asarray(np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale))
