"""Repeated touches of a file: how well the operator repeats a touch, and its use as sigma."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.touches import Repeatability, Sigma, TouchSet, repeatability
from vgrd.errors import TooFewObservations
from vgrd.geometry import Array
from vgrd.solving.touch_files.document import TouchFile, TouchKind

_ENOUGH = 4  # repeats: from there on the estimate is better than a figure out of the paper
_LEAST_MM = 0.01  # no hand and no arm repeats better


@dataclass(frozen=True, slots=True)
class Repeats:
    """Scatter of the repeated touches; along the tool only where all of them measured there.

    applied: it was taken as the sigma of the touches that gave none.
    """

    scatter: Repeatability
    has_axial: bool
    applied: bool = False

    def to_json(self) -> dict[str, Any]:
        """Sigma per direction and its 95 % confidence interval, mm."""
        axial = _plain(self.scatter.axial) if self.has_axial else None
        return {"lateral": _plain(self.scatter.lateral), "axial": axial, "applied": self.applied}


def _plain(sigma: Sigma) -> dict[str, float]:
    return {"sigma": sigma.value_mm, "low": sigma.low_mm, "high": sigma.high_mm}


def find_repeats(file: TouchFile, tcp_in_wrist: Array, used: NDArray[np.bool_]) -> Repeats | None:
    """From the touches in use (m,); None where no target was touched twice."""
    if file.kind not in (TouchKind.UNIVERSAL, TouchKind.FIXED_POINT):
        return None
    chosen = np.flatnonzero(used)
    touches = file.touches.subset(chosen)
    targets = [str(file.points_in_object[i].tolist()) for i in chosen]
    try:
        scatter = repeatability(touches, targets, tcp_in_wrist, tcp_is_fitted=True)
    except TooFewObservations:
        return None
    return Repeats(scatter, bool(np.isfinite(touches.axial_sigma_mm).all()))


def with_repeated_sigma(file: TouchFile, repeats: Repeats) -> TouchFile | None:
    """The file with that sigma where none was given; None where all were, or the repeats are few."""
    scatter, has_sigma = repeats.scatter, np.array(file.sigma_given)
    if has_sigma.all() or not repeats.has_axial or scatter.axial.degrees_of_freedom < _ENOUGH:
        return None
    old = file.touches
    lateral, axial = (max(s.value_mm, _LEAST_MM) for s in (scatter.lateral, scatter.axial))
    touches = TouchSet(
        old.rotations,
        old.translations,
        old.axis_in_wrist,
        np.where(has_sigma, old.lateral_sigma_mm, lateral),
        np.where(has_sigma, old.axial_sigma_mm, axial),
    )
    return replace(file, touches=touches)
