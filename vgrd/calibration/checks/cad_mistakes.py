"""Which mistake in a list of CAD points would explain touches that contradict each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np

from vgrd.calibration.observability import noise_scale
from vgrd.calibration.touches import TouchSet, fit_cad, kabsch
from vgrd.calibration.universal import (
    UniversalProblem,
    calibrate_universal,
    linear_rotation,
    reduced_cost,
)
from vgrd.errors import CalibrationError
from vgrd.geometry import Array
from vgrd.geometry.rotation_relaxation import relax
from vgrd.judging.findings import finding
from vgrd.model import Finding

_CLEARLY_BETTER = 0.3  # of the scatter as given: chance does not explain a third
_FITS = 3.0  # times the promised scatter
_RIVAL = 0.5  # of the next best: else two mistakes explain it, and none is told
_PROMISING = 5  # of the cheap costs, which get the full fit
_FEW = 6  # touches: with more the linear rotation is as good as the relaxed one


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """The CAD points (m, 3) as they may have been meant."""

    finding: Finding
    points: Array


class Wrists(Protocol):
    """How touches are held against CAD points (m, 3)."""

    def closed_form(self, points: Array) -> float:
        """Cost near the minimum, quickly."""

    def scatter(self, points: Array) -> float:
        """How many times as much as promised the touches scatter."""


@dataclass(frozen=True, slots=True, eq=False)
class VariedWrists:
    """By the universal method."""

    touches: TouchSet

    def closed_form(self, points: Array) -> float:
        """Cost near the minimum: the relaxed rotation, with many touches the linear one."""
        K = reduced_cost(points, self.touches)
        S = linear_rotation(K).T if len(points) > _FEW else relax(K.T @ K).rotation
        return float(np.sum((K[:, :9] @ S.ravel() + K[:, 9]) ** 2))

    def scatter(self, points: Array) -> float:
        """Infinite where the points determine nothing."""
        try:
            return noise_scale(calibrate_universal(UniversalProblem(points, self.touches)))
        except CalibrationError:
            return float("inf")


@dataclass(frozen=True, slots=True, eq=False)
class ConstantWrist:
    """By a rigid fit of the flange's positions."""

    touches: TouchSet

    def closed_form(self, points: Array) -> float:
        """Sum of squares of the unweighted fit."""
        flanges = self.touches.translations
        return float(np.sum((kabsch(points, flanges) @ points - flanges) ** 2))

    def scatter(self, points: Array) -> float:
        """Infinite where the points determine nothing."""
        degrees_of_freedom = self.touches.equations() - 6
        try:
            residuals_mm = fit_cad(points, self.touches).residuals_mm
        except CalibrationError:
            return float("inf")
        whitened = np.einsum("mij,mj->mi", self.touches.base_sqrt_informations(), residuals_mm)
        return (
            float(np.sqrt(np.sum(whitened**2) / degrees_of_freedom))
            if degrees_of_freedom > 0
            else 1.0
        )


def misinterpretation(
    names: Sequence[str],
    points_in_object: Array,
    wrists: Wrists,
    scale: float,
    places: Sequence[int] | None = None,
) -> Finding | None:
    """The one mistake with which all m touches agree, None where none or several explain them.

    scale: how many times as much as promised they scatter as given. Mirrored points in one plane
    fit as well as before: turning the plane over is a rotation, nothing in the touches shows it.
    places: (m,) where each touch's target stands in the list; None: listed as first touched.
    """
    readings = sorted(
        _readings(names, points_in_object, places),
        key=lambda reading: wrists.closed_form(reading.points),
    )
    tried = [
        (wrists.scatter(reading.points), reading.finding) for reading in readings[:_PROMISING]
    ]
    tried.sort(key=lambda pair: pair[0])
    if not tried or not tried[0][0] < min(_FITS, _CLEARLY_BETTER * scale):
        return None
    if len(tried) > 1 and tried[0][0] > _RIVAL * tried[1][0]:
        return None
    return tried[0][1]


def _readings(
    names: Sequence[str], points: Array, places: Sequence[int] | None
) -> Iterator[_Reading]:
    yield _Reading(
        finding(
            "points_mirrored",
            "the touches fit the mirror image of the CAD points: one axis of the targets has the "
            "wrong sign, or two axes are exchanged",
            fatal=True,
        ),
        points * (1, 1, -1),
    )
    yield from _other_orders(points, places)
    distinct, inverse = np.unique(points, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    for a, b in combinations(range(len(distinct)), 2):
        swapped = np.where(inverse == a, b, np.where(inverse == b, a, inverse))
        touched = sorted(np.flatnonzero(inverse == k).tolist() for k in (a, b))
        first, second = (", ".join(repr(names[i]) for i in rows) for rows in touched)
        yield _Reading(
            finding(
                "targets_swapped",
                f"the targets of touch {first} and {second} are swapped: all touches fit when "
                "they are exchanged",
                fatal=True,
            ),
            distinct[swapped],
        )


def _other_orders(points: Array, places: Sequence[int] | None) -> Iterator[_Reading]:
    """The list of targets, each named once, backwards or begun elsewhere."""
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    list_order = np.argsort(first if places is None else np.asarray(places)[first])
    place = np.argsort(list_order)[inverse.ravel()]
    listed, m = points[first[list_order]], len(first)
    for backwards in (False, True):
        for shift in range(m):
            order = np.roll(np.arange(m)[:: -1 if backwards else 1], -shift)
            if np.array_equal(order, np.arange(m)) or np.sum(order != np.arange(m)) == 2:
                continue
            way = " backwards" if backwards else ""
            begin = f" from the {shift + 1}. on" if shift else ""
            yield _Reading(
                finding(
                    "points_order",
                    f"the targets stand in the wrong order, the touches fit the list read{way}{begin}",
                    fatal=True,
                ),
                listed[order][place],
            )
