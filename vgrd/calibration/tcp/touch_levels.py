"""How well the touches were made, found in what they leave over: levels of noise across and along the tool."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.levels import Level, Levels, Whitened, find_levels
from vgrd.calibration.touches import TouchSet
from vgrd.geometry import Array

_DIRECTION_FACTOR = 1.5  # the same of one direction, beside that: a guess
_HAND_FACTOR = (
    3.0  # within which hands are as rough as stated: little is known of one before it touched
)
_ENOUGH = 200  # touches tell a level to 4 %: more would cost time only


@dataclass(frozen=True, slots=True, eq=False)
class TouchKind:
    """One kind of noise: of which touches (m,), across or along the tool, and what was stated of it."""

    name: str
    of_touches: NDArray[np.bool_]
    is_axial: bool
    stated_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class TouchRows:
    """Whitened rows of a fit: residuals (r,), jacobian (r, n), touch_of (r,) index of the touch.

    shares: (r, k), of each row's variance as it was whitened, by the kinds; a row sums to 1. shift:
    (r, 3), how the residuals change when what was touched moves in the base.
    """

    residuals: Array
    jacobian: Array
    touch_of: NDArray[np.intp]
    shares: Array
    shift: Array

    def whiten(self, log_variances: Array) -> Whitened:
        """The rows as if the variances of the kinds were larger by exp of these (k,)."""
        parts = self.shares * np.exp(log_variances)
        variances = parts.sum(axis=1)
        scale = 1 / np.sqrt(variances)
        factors = np.sqrt(parts) * scale[:, None]
        return Whitened(
            self.residuals * scale,
            self.jacobian * scale[:, None],
            [np.diag(factor)[:, factor > 0] for factor in factors.T],
        )

    def some_of(self, chosen: NDArray[np.bool_]) -> "TouchRows":
        """The rows of the touches (m,)."""
        kept = chosen[self.touch_of]
        return TouchRows(
            self.residuals[kept],
            self.jacobian[kept],
            self.touch_of[kept],
            self.shares[kept],
            self.shift[kept],
        )


def touch_kinds(touches: TouchSet, is_stated: NDArray[np.bool_]) -> tuple[TouchKind, ...]:
    """The kinds of noise of touches (m,): stated or not, across and along the tool, where measured."""
    kinds = []
    for stated, of in ((True, is_stated), (False, ~is_stated)):
        for is_axial, sigmas in (
            (False, touches.lateral_sigma_mm),
            (True, touches.axial_sigma_mm),
        ):
            chosen = of & np.isfinite(sigmas)
            if not chosen.any():
                continue
            name = f"touches {'along' if is_axial else 'across'} the tool"
            if is_stated.any() and not is_stated.all():
                name += "" if stated else ", without sigma_mm"
            rms = float(np.sqrt(np.mean(sigmas[chosen] ** 2)))
            kinds.append(TouchKind(name, chosen, is_axial, rms))
    return tuple(kinds)


def point_rows(
    touches: TouchSet, whitened: Array, jacobian: Array, turns: Array, sign: int
) -> TouchRows:
    """Rows of touches of points, in the frame of the tool: whitened (m, 3), jacobian (3 m, n).

    turns: (m, 3, 3), from the frame in which they were whitened to that of the wrist. sign: 1 where residuals are
    the place less the tip, -1 where they are the tip less the place. Two kinds: across, along.
    """
    m = len(touches)
    tool = np.linalg.svd(touches.axis_in_wrist[None])[2][[1, 2, 0]]  # across, across, along
    T = tool @ turns
    r = np.einsum("mij,mj->mi", T, whitened)
    J = T @ jacobian.reshape(m, 3, -1)
    measured = np.isfinite(
        np.column_stack([touches.lateral_sigma_mm] * 2 + [touches.axial_sigma_mm])
    )
    shares = np.broadcast_to([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (m, 3, 2))
    touch_of = np.broadcast_to(np.arange(m)[:, None], (m, 3))
    shift = sign * tool @ touches.base_sqrt_informations()
    return TouchRows(
        r[measured], J[measured], touch_of[measured], shares[measured], shift[measured]
    )


def surface_rows(touches: TouchSet, whitened: Array, jacobian: Array, normals: Array) -> TouchRows:
    """Rows of touches of a surface: whitened (m, 1), jacobian (m, n), normals (m, 3) in the base."""
    total = touches.sigma_along(normals) ** 2
    along = np.einsum("mi,mij,j->m", normals, touches.rotations, touches.axis_in_wrist) ** 2
    measured = np.isfinite(total)
    with np.errstate(invalid="ignore"):
        axial = np.where(along > 0, along * touches.axial_sigma_mm**2, 0.0) / total
    axial = np.clip(axial[measured], 0, 1)
    shares = np.column_stack([1 - axial, axial])
    rows = np.flatnonzero(measured)
    shift = -normals[measured] / np.sqrt(total[measured])[:, None]
    return TouchRows(whitened[measured, 0], jacobian[measured], rows, shares, shift)


def by_kind(rows: TouchRows, kinds: Sequence[TouchKind]) -> TouchRows:
    """The rows with their shares (r, 2) across and along dealt to the kinds (k) of their touches."""
    shares = np.column_stack(
        [rows.shares[:, int(kind.is_axial)] * kind.of_touches[rows.touch_of] for kind in kinds]
    )
    return replace(rows, shares=shares)


def find_touch_levels(
    rows: TouchRows, kinds: Sequence[TouchKind], used: NDArray[np.bool_], whitened_at: Array
) -> Levels:
    """Levels of the kinds over the stated ones, by the rows (`by_kind`) of the touches in use (m,).

    whitened_at: (k,), log variances over the stated ones at which the rows were whitened.
    """
    chosen = np.flatnonzero(used)
    few = chosen[np.unique(np.linspace(0, len(chosen) - 1, _ENOUGH).astype(int))]
    mask = np.zeros(len(used), dtype=bool)
    mask[few] = True
    some = rows.some_of(mask)
    return find_levels(
        lambda x: some.whiten(x - whitened_at),
        len(kinds),
        prior_factors=np.full(len(kinds), _DIRECTION_FACTOR),
        common_factor=_HAND_FACTOR,
        start=whitened_at,
    )


def with_levels(touches: TouchSet, kinds: Sequence[TouchKind], scales: Array) -> TouchSet:
    """The touches, the sigmas of each kind times its scale (k,)."""
    lateral, axial = touches.lateral_sigma_mm.copy(), touches.axial_sigma_mm.copy()
    for kind, scale in zip(kinds, scales, strict=True):
        sigmas = axial if kind.is_axial else lateral
        sigmas[kind.of_touches] *= scale
    return TouchSet(touches.rotations, touches.translations, touches.axis_in_wrist, lateral, axial)


def named_levels(levels: Levels, kinds: Sequence[TouchKind]) -> tuple[Level, ...]:
    """The levels in words, mm."""
    return levels.named([(kind.name, "mm", kind.stated_mm) for kind in kinds])


def freedom_of_unknowns(
    rows: TouchRows, used: NDArray[np.bool_], levels: Levels, unknowns: slice
) -> float:
    """Degrees of freedom of the variance of some unknowns, the rows (`by_kind`) whitened with the levels."""
    some = rows.some_of(used)
    gain = np.linalg.pinv(some.jacobian)[unknowns]
    return levels.freedom_of(np.sum(gain**2, axis=0) @ some.shares)
