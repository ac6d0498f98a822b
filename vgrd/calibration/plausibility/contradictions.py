"""A touch against the other ones of its session, and which mistake would explain it.

The likelihood ratio of the touch given the others: by how much the least cost of all grows when it is added,
against chance for as many degrees of freedom as it adds. Nothing has to be known beforehand: two touches with one
wrist are as far apart as CAD says, four of a plate lie as its targets do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations

import numpy as np

from vgrd.calibration.plausibility.rigid import PlacedTouches, RigidFit, fit_rigidly
from vgrd.calibration.plausibility.stands import (
    Stands,
    placed_as_touched,
    placed_in_one,
    tied_camera,
)
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import PLAUSIBLE
from vgrd.model import Recording

_TELLS = 0.5  # degrees of freedom: with less than half of one direction nothing is foretold
_LEVEL_FREEDOM = 6.0  # from so many on the scatter so far tells more than the cell file
_AHEAD = 2.9  # degrees of freedom that a touch adds where the others say where each target is: all three


@dataclass(frozen=True, slots=True)
class Mistake:
    """What would make all touches fit: those of `indices` were of `targets`.

    targets: empty for one that is not where any name says.
    """

    indices: tuple[int, ...]
    targets: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """Touches that are held to be right, and the fit of them."""

    placed: PlacedTouches
    fit: RigidFit

    @property
    def level(self) -> float:
        """Variance of the touches over what was stated, as far as they scatter more."""
        if self.fit.freedom < _LEVEL_FREEDOM:
            return 1.0
        return max(1.0, self.fit.cost / self.fit.freedom)

    def admits(self, fit: RigidFit) -> bool:
        """Whether chance explains the fit with one touch more."""
        cost, freedom = fit.cost - self.fit.cost, fit.freedom - self.fit.freedom
        return _is_chance(cost, freedom, self.level)


def _is_chance(cost: float, freedom: float, level: float) -> bool:
    """Whether squares of so many degrees of freedom are explained; level: of their variance."""
    return freedom < _TELLS or cost <= level * chi2_quantile(PLAUSIBLE, freedom)


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What others say of the last one of touches.

    is_foretold: they tell where its target is. is_contradicted: chance does not explain where it is.
    """

    recording: Recording
    indices: Sequence[int]
    placed: PlacedTouches
    known: Others
    is_foretold: bool
    is_contradicted: bool

    def mistakes(self, level: float) -> tuple[Mistake, ...]:
        """Each of which explains everything, the likeliest first: wrong names, or what is nowhere.

        level: of the variance of the touches that are held to be right, over what was stated.
        """
        named = _wrong_names(self.recording, self.indices, self.placed)
        return _explaining(named, level) or _explaining(self._left_out(), level)

    def _left_out(self) -> Iterator[tuple[Mistake, RigidFit]]:
        """One touch that is not where its name says, with the fit of the others."""
        rows = range(len(self.indices))
        for row, index in enumerate(self.indices):
            others = self.placed.chosen([other for other in rows if other != row])
            yield Mistake((index,)), fit_rigidly(others)

    def off_mm(self) -> tuple[tuple[str, float], ...]:
        """By name of every target in CAD how far the tip is from it, the nearest first; () if not foretold."""
        return _off_mm(self.recording, self.placed, self.known) if self.is_foretold else ()


class Judge:
    """Holds touches of one recording against each other."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.stands = Stands.of_touches(recording)
        self._tied = cache(partial(tied_camera, recording))

    def judge(self, index: int, others: Sequence[int]) -> Judgement | None:
        """A touch against others; None of a bare target, or without tag B in its picture."""
        if not self._is_usable(index):
            return None
        usable = [i for i in others if i != index and self._is_usable(i)]
        together = [i for i in usable if self.stands.of[i] == self.stands.of[index]]
        as_touched = [*together, index]
        judged = self._judged(as_touched, placed_as_touched(self.recording, as_touched))
        tied = None if len(together) == len(usable) else self._tied()
        if judged.is_contradicted or tied is None:
            return judged
        every = [*usable, index]
        return self._judged(every, placed_in_one(self.recording, every, self.stands, tied))

    def _is_usable(self, index: int) -> bool:
        target = self.recording.facts.object.targets[self.recording.touches[index].target]
        return self.stands.of[index] >= 0 and target.point_in_object is not None

    def _judged(self, indices: Sequence[int], placed: PlacedTouches) -> Judgement:
        others = placed.chosen(range(len(placed) - 1))
        known, fit = Others(others, fit_rigidly(others)), fit_rigidly(placed)
        is_foretold = fit.freedom - known.fit.freedom >= _AHEAD
        return Judgement(
            self.recording, indices, placed, known, is_foretold, not known.admits(fit)
        )


def _off_mm(
    recording: Recording, placed: PlacedTouches, known: Others
) -> tuple[tuple[str, float], ...]:
    """How far the last tip is from every target in CAD by the other touches, the nearest first."""
    touches = placed.touches
    tip = touches.rotations[-1] @ known.fit.tip_in_wrist + touches.translations[-1]
    cad = _cad(recording)
    away = np.linalg.norm(known.fit.places(np.array(list(cad.values()))) - tip, axis=1)
    return tuple(sorted(zip(cad, map(float, away), strict=True), key=lambda one: one[1]))


def _cad(recording: Recording) -> dict[str, Array]:
    targets = recording.facts.object.targets
    return {name: t.cad for name, t in targets.items() if t.point_in_object is not None}


def _explaining(
    candidates: Iterator[tuple[Mistake, RigidFit]], level: float
) -> tuple[Mistake, ...]:
    """Those with which chance explains the rest, the likeliest first."""
    fitting = [
        (fit.cost, k, mistake)
        for k, (mistake, fit) in enumerate(candidates)
        if _is_chance(fit.cost, fit.freedom, level)
    ]
    return tuple(mistake for _, _, mistake in sorted(fitting, key=lambda one: one[:2]))


def _wrong_names(
    recording: Recording, indices: Sequence[int], placed: PlacedTouches
) -> Iterator[tuple[Mistake, RigidFit]]:
    """One touch of another target, or two targets exchanged, with the fit as it would be."""
    cad = _cad(recording)
    names = [recording.touches[i].target for i in indices]
    for row, index in enumerate(indices):
        for other in cad:
            if other != names[row]:
                meant = [*names[:row], other, *names[row + 1 :]]
                yield Mistake((index,), (other,)), _as_named(placed, cad, meant)
    for a, b in combinations(sorted(set(names)), 2):
        other_names = {a: b, b: a}
        rows = [row for row, name in enumerate(names) if name in other_names]
        meant = [other_names.get(name, name) for name in names]
        mistake = Mistake(tuple(indices[row] for row in rows), tuple(meant[row] for row in rows))
        yield mistake, _as_named(placed, cad, meant)


def _as_named(placed: PlacedTouches, cad: dict[str, Array], names: Sequence[str]) -> RigidFit:
    return fit_rigidly(placed.renamed(np.array([cad[name] for name in names])))
