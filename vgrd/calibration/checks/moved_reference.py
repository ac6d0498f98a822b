"""Touches of which the first ones and the later ones are of two places: what was touched moved in between.

The place from some touch on is an unknown of its own, a jump of three numbers; for every touch it is asked
how much that explains. A single bad touch is set against it and left out where that explains more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from vgrd.calibration.levels import Levels
from vgrd.calibration.tcp import TouchKind, TouchRows, find_touch_levels
from vgrd.geometry import Array
from vgrd.judging.thresholds import CHANCE, OUTLIER_SIGMA

_EACH_SIDE = 2  # touches: one alone is a bad touch
_MOST_BAD = 1 / 3  # of the touches: where more are bad nobody can say which
_AT_ONCE = 25  # of so many touches one is left out at a time
_ROUNDS = 4  # of jump and linearisation; the fixed point needs one
_HOPELESS = (
    0.5  # chance: a ball that moved by a fifth of its radius has 0.02 before it is linearised anew
)
_AS_STATED = 1.5  # times what was stated: with the jump the touches are as good as promised
_CHANCE_WHERE_IT_EXPLAINS = (
    0.02  # one in 50, of files that scatter far more than stated: few of the good
)
_SETTLED = 0.05  # sigmas of a touch: a smaller change of the jump decides nothing
_TOLD_APART = 1e-3  # of a jump's length: less of it is left where the wrists take it up
_SIGMAS = 3.5  # of a touch: a smaller jump is told by the level of the touches


@dataclass(frozen=True, slots=True, eq=False)
class Jump:
    """From touch `first` on what was touched stood elsewhere by shift_in_base (3,), mm.

    chance: that touches without a jump look so.
    """

    first: int
    shift_in_base: Array
    chance: float

    @property
    def length_mm(self) -> float:
        """How far."""
        return float(np.linalg.norm(self.shift_in_base))


Relinearize = Callable[[Array], TouchRows]


def find_jump(
    relinearize: Relinearize,
    kinds: Sequence[TouchKind],
    count: int,
    sigma_mm: float,
    *,
    is_noisy: bool = False,
) -> Jump | None:
    """The jump that explains the touches (m) beyond chance; None without one.

    relinearize(shifts (m, 3)): rows by kind of the fit to all touches, what was touched having stood elsewhere by
    these, whitened with the stated sigmas. sigma_mm: of the roughest direction as stated. is_noisy: without a jump
    the touches scatter far more than was stated.
    """
    shifts = np.zeros((count, 3))
    jump: Jump | None = None
    levels = Levels.stated(len(kinds))
    for _ in range(_ROUNDS):
        search = _Search(relinearize(shifts), shifts, count)
        step, levels = search.run(kinds, levels)
        if step is None or step.chance > _HOPELESS:
            return None
        jump = step
        change = np.where(np.arange(count)[:, None] >= jump.first, jump.shift_in_base, 0) - shifts
        shifts = shifts + change
        if np.abs(change).max() < _SETTLED * sigma_mm:
            break
    explains = is_noisy and float(levels.scales.max()) < _AS_STATED
    if jump is None or jump.chance > (_CHANCE_WHERE_IT_EXPLAINS if explains else CHANCE):
        return None
    if jump.length_mm < _SIGMAS * sigma_mm * float(levels.scales.max()):
        return None
    return jump


class _Search:
    """One linearisation: jumps and single bad touches against each other."""

    def __init__(self, rows: TouchRows, shifts: Array, count: int) -> None:
        # Residuals as if there had been no shift: a jump is then sought as a whole.
        back = np.einsum("rj,rj->r", rows.shift, shifts[rows.touch_of])
        self._rows = replace(rows, residuals=rows.residuals - back)
        self._count = count
        self._kept = np.ones(count, dtype=bool)

    def run(self, kinds: Sequence[TouchKind], levels: Levels) -> tuple[Jump | None, Levels]:
        """The likeliest jump, and the levels beside it."""
        most_bad = int(_MOST_BAD * self._count)
        while True:
            rows = self._whitened(levels)
            first = self._best_jump(rows)[0]
            if first is None:
                return None, levels
            levels = find_touch_levels(
                self._with_jump(first), kinds, self._kept, np.zeros(len(kinds))
            )
            rows = self._whitened(levels)
            first, gain = self._best_jump(rows)
            gains = self._gains(rows)
            equations = len(rows.touch_of) / len(np.unique(rows.touch_of))  # the mean of chi2
            bad = gains > max(gain, OUTLIER_SIGMA**2 + equations)
            worst = np.argsort(-gains)[: max(1, self._count // _AT_ONCE)]
            if first is None or not bad.any() or int(np.sum(~self._kept)) >= most_bad:
                break
            self._kept[worst[bad[worst]]] = False
        if first is None:
            return None, levels
        return self._judged(first, levels), levels

    def _judged(self, first: int, levels: Levels) -> Jump | None:
        rows = self._whitened(levels)
        later, told = self._jump_columns(rows, first)
        columns = _left_of(later @ told, rows.jacobian)
        if not columns.shape[1]:
            return None
        gain = np.linalg.pinv(columns)
        step = -gain @ rows.residuals
        squares = float(np.sum((columns @ step) ** 2))
        freedom = levels.freedom_of(np.sum(gain**2, axis=0) @ rows.shares)
        trials = int(self._kept.sum()) - 2 * _EACH_SIDE + 1
        chance = trials * float(fisher.sf(squares / len(step), len(step), freedom))
        return Jump(first, told @ step, chance)

    def _jump_columns(self, rows: TouchRows, first: int) -> tuple[Array, Array]:
        """How a jump acts (r, 3), and the directions (3, k) of it that the touches tell: of a plane its normal."""
        later = rows.shift * (rows.touch_of >= first)[:, None]
        left = _left_of(later, rows.jacobian)
        w, V = np.linalg.eigh(left.T @ left)
        return later, V[:, w > _TOLD_APART * np.sum(later**2)]

    def _whitened(self, levels: Levels, rows: TouchRows | None = None) -> TouchRows:
        """The rows of the touches that are kept, with these levels."""
        some = (rows or self._rows).some_of(self._kept)
        parts = some.shares * np.exp(levels.log_variances)
        scale = 1 / np.sqrt(parts.sum(axis=1))
        return TouchRows(
            some.residuals * scale,
            some.jacobian * scale[:, None],
            some.touch_of,
            parts * scale[:, None] ** 2,
            some.shift * scale[:, None],
        )

    def _with_jump(self, first: int) -> TouchRows:
        later, told = self._jump_columns(self._rows, first)
        return replace(self._rows, jacobian=np.hstack([self._rows.jacobian, later @ told]))

    def _best_jump(self, rows: TouchRows) -> tuple[int | None, float]:
        """First touch after the jump that lowers the sum of squares most, and by how much."""
        U = _column_space(rows.jacobian)
        r = rows.residuals - U @ (U.T @ rows.residuals)
        S = rows.shift
        seen = _sums_from(np.einsum("ra,rj->raj", U, S), rows.touch_of, self._count)
        own = _sums_from(np.einsum("ri,rj->rij", S, S), rows.touch_of, self._count)
        pull = _sums_from(S * r[:, None], rows.touch_of, self._count)
        left = own - np.einsum("kai,kaj->kij", seen, seen)
        order = np.flatnonzero(self._kept)
        firsts = order[_EACH_SIDE : len(order) - _EACH_SIDE + 1]
        if not len(firsts):
            return None, 0.0
        w, V = np.linalg.eigh(left[firsts])
        told = w > _TOLD_APART * np.trace(own[firsts], axis1=1, axis2=2)[:, None]
        parts = np.einsum("kij,ki->kj", V, pull[firsts]) ** 2
        gains = np.sum(np.where(told, parts / np.where(told, w, 1.0), 0.0), axis=1)
        best = int(np.argmax(gains))
        return int(firsts[best]), float(gains[best])

    def _gains(self, rows: TouchRows) -> Array:
        """By how much (m,) the sum of squares falls without each touch."""
        U = _column_space(rows.jacobian)
        r = rows.residuals - U @ (U.T @ rows.residuals)
        gains = np.zeros(self._count)
        starts = np.flatnonzero(np.diff(rows.touch_of, prepend=-1))
        for start, stop in zip(starts, [*starts[1:], len(r)], strict=True):
            own = U[start:stop]
            left = np.eye(stop - start) - own @ own.T
            gains[rows.touch_of[start]] = r[start:stop] @ np.linalg.pinv(left) @ r[start:stop]
        return gains


def _left_of(columns: Array, J: Array) -> Array:
    """What of the columns (r, k) those of a fit (r, n) do not take up."""
    U = _column_space(J)
    return columns - U @ (U.T @ columns)


def _column_space(J: Array) -> Array:
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    return np.asarray(U[:, s > s.max(initial=0) * 1e-10])  # rounding


def _sums_from(values: Array, touch_of: NDArray[np.intp], count: int) -> Array:
    """Sums (count, ...) of the values (r, ...) of a touch and all later ones."""
    sums = np.zeros((count, *values.shape[1:]))
    np.add.at(sums, touch_of, values)
    return np.asarray(np.cumsum(sums[::-1], axis=0)[::-1])
